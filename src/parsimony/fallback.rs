//! What a shot falls back on where its own evidence says that a term would do harm.

use crate::{
    develop::Development,
    radiometry::LinearImage,
    relight::{Relit, enlarge::Mix},
    shot::Shot,
    verdict::Verdict,
};
use drivers::{DepthFrame, Plane};

/// How an answer leans on the photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hedge {
    /// Share of the photograph, [0, 0.8].
    pub share: f32,
    /// The photograph is made as bright as this quantile of the pixels' answers, [0, 1].
    pub quantile: f32,
}

/// Failures after which nothing of a relit picture is sure, and how far the answer leans on the photograph
/// then: distances that are wrong leave less than light that is. Wrapped distances make things darker
/// than they are, so the brighter ones are believed.
const HEDGED: [(&str, Hedge); 4] = [
    ("flash-saturation", leaning(0.5, 0.5)),
    ("wrong-transfer", leaning(0.5, 0.5)),
    ("phase-wrap", leaning(0.8, 0.8)),
    ("mirror", leaning(0.8, 0.5)),
];

const fn leaning(share: f32, quantile: f32) -> Hedge {
    Hedge { share, quantile }
}

/// Score from which a failure is beyond doubt: clean captures reach 1.8 (rendered validation captures).
const SURE: f32 = 2.0;
/// Pixels that brightness is asked of, about.
const SAMPLES: usize = 60_000;

/// The shot without the depth at the `wrong` pixels of the working grid, its depth on the photograph's
/// grid.
pub(super) fn without(shot: &Shot, development: &Development, wrong: &Plane<bool>) -> Shot {
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
                *metres = f32::NAN;
            }
        }
    }
    shot
}

/// How an answer leans on the photograph: `None` where nothing is wrong, the more the worse it is.
pub(super) fn hedge(verdict: &Verdict) -> Option<Hedge> {
    let leanings = verdict.findings.iter().filter_map(|finding| {
        let (_, most) = HEDGED.iter().find(|(mode, _)| *mode == finding.mode)?;
        let share = most.share * (1.0 - SURE / finding.score.max(SURE));
        (share > 0.0).then_some(Hedge { share, ..*most })
    });
    leanings.max_by(|a, b| a.share.total_cmp(&b.share))
}

/// Mixes an answer with the photograph, made about as bright as the answer.
pub(super) fn hedged(relit: &mut Relit, photograph: &LinearImage, hedge: Hedge) {
    let brightness = |pixel: &[f32; 3]| pixel[0] + pixel[1] + pixel[2];
    let pixels = relit.light.0.samples().iter().zip(photograph.0.samples());
    let stride = photograph.0.len().div_ceil(SAMPLES).max(1);
    let mut ratios: Vec<f32> = pixels
        .step_by(stride)
        .map(|(answer, photo)| brightness(answer) / brightness(photo))
        .filter(|ratio| ratio.is_finite() && *ratio >= 0.0)
        .collect();
    if ratios.is_empty() {
        return;
    }
    let rank = (hedge.quantile * (ratios.len() - 1) as f32) as usize;
    let exposure = *ratios.select_nth_unstable_by(rank, f32::total_cmp).1;
    let samples = relit.light.0.samples_mut().iter_mut();
    for (answer, photo) in samples.zip(photograph.0.samples()) {
        if photo.is_known() {
            *answer = std::array::from_fn(|c| {
                answer[c] + hedge.share * (exposure * photo[c].max(0.0) - answer[c])
            });
        }
    }
}
