//! What a shot falls back on where its own evidence says that a term would do harm.

use crate::{
    develop::Development,
    radiometry::LinearImage,
    relight::{Relit, enlarge::Mix},
    shot::Shot,
    verdict::{Verdict, Wrapped},
};
use drivers::{DepthFrame, Plane};
use glam::DVec2;

/// Failures after which nothing of a relit picture is sure, and the largest share of the photograph that
/// the answer is mixed with then, once what could be mended is.
const HEDGED: [(&str, f32); 3] = [
    ("wrong-transfer", 0.8),
    ("phase-wrap", 0.8),
    ("mirror", 0.9),
];

/// Score from which a failure is beyond doubt: clean captures reach 1.8 (rendered validation captures).
pub(super) const SURE: f32 = 2.0;
/// Pixels that brightness is asked of, about.
const SAMPLES: usize = 60_000;

/// The shot without the depth at the `wrong` pixels of the working grid.
pub(super) fn without(shot: &Shot, development: &Development, wrong: &Plane<bool>) -> Shot {
    with_depth(shot, development, wrong, |_, _| f32::NAN)
}

/// The shot with its wrapped depth a range further away.
pub(super) fn unwrapped(shot: &Shot, development: &Development, wrapped: &Wrapped) -> Shot {
    let lens = shot.rig.color;
    with_depth(shot, development, &wrapped.pixels, |at, metres| {
        let ray = lens.ray(at).map_or(1.0, |ray| ray.length() as f32);
        metres + wrapped.range_metres / ray
    })
}

/// The shot with other depth at the `wrong` pixels of the working grid, on the photograph's grid.
/// `right` is told the pixel of the photograph and its depth there, metres.
fn with_depth(
    shot: &Shot,
    development: &Development,
    wrong: &Plane<bool>,
    right: impl Fn(DVec2, f32) -> f32,
) -> Shot {
    let (width, height) = shot.flash.pixels.size();
    let (columns, rows) = wrong.size();
    let on_grid = |x: usize, y: usize| (x * columns / width, y * rows / height);
    let mut shot = shot.clone();
    // Depth of another camera comes as it was registered on the photograph.
    if shot.rig.depth.take().is_some() {
        let spread =
            |plane: &Plane<f32>| Plane::from_fn(width, height, |x, y| plane[on_grid(x, y)]);
        let registered = &development.registered;
        shot.depth = DepthFrame {
            metres: spread(&registered.metres),
            sigma: Some(spread(&registered.sigma_metres)),
            amplitude: registered.amplitude.as_ref().map(spread),
            ..shot.depth
        };
    }
    for y in 0..height {
        for (x, metres) in shot.depth.metres.row_mut(y).iter_mut().enumerate() {
            if wrong[on_grid(x, y)] {
                *metres = right(DVec2::new(x as f64, y as f64), *metres);
            }
        }
    }
    shot
}

/// The share of the photograph that answers are mixed with, [0, 0.9]; `None` where nothing is wrong, the
/// more the worse it is.
pub(super) fn hedge(verdict: &Verdict) -> Option<f32> {
    let shares = HEDGED.iter().map(|(mode, most)| {
        let score = verdict.score(mode).max(SURE);
        most * (1.0 - (SURE / score).powi(2))
    });
    shares.max_by(f32::total_cmp).filter(|share| *share > 0.0)
}

/// Mixes an answer with a `share` of the photograph, which is made as bright as comes nearest to the
/// answer (least squares): bright things count, as they do in what is seen.
pub(super) fn hedged(relit: &mut Relit, photograph: &LinearImage, share: f32) {
    let pixels = relit.light.0.samples().iter().zip(photograph.0.samples());
    let stride = photograph.0.len().div_ceil(SAMPLES).max(1);
    let (mut both, mut squares) = (0.0f64, 0.0f64);
    for (answer, photo) in pixels.step_by(stride) {
        for (answer, photo) in answer.iter().zip(photo) {
            let product = answer.clamp(0.0, 1.0) * photo;
            if product.is_finite() {
                both += f64::from(product);
                squares += f64::from(photo * photo);
            }
        }
    }
    let exposure = (both / squares.max(f64::MIN_POSITIVE)) as f32;
    let samples = relit.light.0.samples_mut().iter_mut();
    for (answer, photo) in samples.zip(photograph.0.samples()) {
        if photo.is_known() {
            *answer = std::array::from_fn(|c| {
                answer[c] + share * (exposure * photo[c].max(0.0) - answer[c])
            });
        }
    }
}
