//! What a shot falls back on where its own evidence says that a term would do harm.

use crate::{
    develop::Development,
    radiometry::LinearImage,
    relight::{Relit, enlarge::Mix},
    shot::Shot,
    verdict::{Verdict, contradicted},
};
use drivers::{DepthFrame, Plane};

/// Failures after which nothing of a relit picture is sure, and the largest share of the photograph that
/// is mixed into it then: distances that are wrong leave less than light that is.
const HEDGED: [(&str, f32); 4] = [
    ("flash-saturation", 0.5),
    ("wrong-transfer", 0.5),
    ("phase-wrap", 0.8),
    ("mirror", 0.8),
];
/// Score from which a failure is beyond doubt: clean captures reach 1.8 (rendered validation captures).
const SURE: f32 = 2.0;

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

/// The share of the photograph that an answer is mixed with, [0, 0.8]: none where nothing is wrong, the
/// more the worse it is.
pub(super) fn hedge(verdict: &Verdict) -> f32 {
    let shares = verdict.findings.iter().filter_map(|finding| {
        let (_, most) = HEDGED.iter().find(|(mode, _)| *mode == finding.mode)?;
        Some(most * (1.0 - SURE / finding.score.max(SURE)))
    });
    shares.fold(0.0, f32::max)
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
