//! What a shot falls back on where its own evidence says that a term would do harm.

use crate::{
    develop::Development,
    radiometry::LinearImage,
    relight::{Relit, enlarge::Mix},
    shot::Shot,
    verdict::{Verdict, contradicted},
};
use drivers::{DepthFrame, Plane};

/// Failures after which nothing of a relit picture is sure; what is left of it is mixed with the photograph.
const HEDGED: [&str; 4] = ["flash-saturation", "wrong-transfer", "phase-wrap", "mirror"];
/// Score from which a failure is beyond doubt: clean captures reach 1.8 (rendered validation captures).
const SURE: f32 = 2.0;
/// Largest share of the photograph.
const MOST_HEDGE: f32 = 0.5;

/// The shot without depth that its photograph contradicts, on the photograph's grid; `None` where
/// there is none.
pub(super) fn without_contradicted(shot: &Shot, development: &Development) -> Option<Shot> {
    let wrong = contradicted(shot, development)?;
    let (width, height) = shot.flash.pixels.size();
    let registered = &development.registered;
    let at = |x: usize, y: usize| {
        let (columns, rows) = wrong.size();
        (x * columns / width, y * rows / height)
    };
    let spread = |plane: &Plane<f32>| {
        Plane::from_fn(width, height, |x, y| {
            let at = at(x, y);
            if wrong[at] { f32::NAN } else { plane[at] }
        })
    };
    let own_grid = shot.rig.depth.is_none();
    let depth = DepthFrame {
        metres: if own_grid {
            let metres = &shot.depth.metres;
            Plane::from_fn(width, height, |x, y| {
                if wrong[at(x, y)] {
                    f32::NAN
                } else {
                    metres[(x, y)]
                }
            })
        } else {
            spread(&registered.metres)
        },
        sigma: if own_grid {
            shot.depth.sigma.clone()
        } else {
            Some(spread(&registered.sigma_metres))
        },
        amplitude: if own_grid {
            shot.depth.amplitude.clone()
        } else {
            registered.amplitude.as_ref().map(spread)
        },
        ..shot.depth
    };
    let mut shot = Shot {
        depth,
        ..shot.clone()
    };
    shot.rig.depth = None;
    Some(shot)
}

/// The share of the photograph that an answer is mixed with, [0, 0.5]: none where nothing is wrong, the
/// more the worse it is.
pub(super) fn hedge(verdict: &Verdict) -> f32 {
    let worst = verdict
        .findings
        .iter()
        .filter(|finding| HEDGED.contains(&finding.mode));
    let worst = worst.map(|finding| finding.score).fold(0.0, f32::max);
    MOST_HEDGE * (1.0 - SURE / worst.max(SURE))
}

/// Mixes an answer with the photograph, made as bright as the answer.
pub(super) fn hedged(relit: &mut Relit, photograph: &LinearImage, share: f32) {
    let brightness = |pixel: &[f32; 3]| f64::from(pixel[0] + pixel[1] + pixel[2]);
    let pixels = || relit.light.0.samples().iter().zip(photograph.0.samples());
    let (mut answered, mut photographed) = (0.0, 0.0);
    for (answer, photo) in pixels().filter(|(a, b)| a.is_known() && b.is_known()) {
        answered += brightness(answer);
        photographed += brightness(photo);
    }
    let exposure = (answered / photographed.max(1e-9)) as f32;
    let samples = relit.light.0.samples_mut().iter_mut();
    for (answer, photo) in samples.zip(photograph.0.samples()) {
        if photo.is_known() {
            *answer = std::array::from_fn(|c| {
                answer[c] + share * (exposure * photo[c].max(0.0) - answer[c])
            });
        }
    }
}
