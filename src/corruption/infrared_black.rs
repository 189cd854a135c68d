//! Surfaces that swallow infrared.

use super::{
    CorruptionError,
    depth_grid::{NEAREST_METRES, metres, reflectance, scale, with_metres},
    field::{field, upper},
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// About the width of a patch of one dye, pixels at 256×256.
const PATCH_PIXELS: f32 = 40.0;
/// What is left of the amplitude.
const LEFT: f32 = 0.02;
/// Share of the samples that lose their answer.
const LOST: f64 = 0.7;
/// Standard deviation of the answers that remain, as a share of depth.
const ERROR: f32 = 0.05;

/// `percent` of the answered samples, those that send least infrared back, in patches where all
/// send alike: nearly no amplitude, most without an answer, the rest wrong. The photograph stays as
/// it is: what swallows infrared may have any color.
pub(super) fn on_shot(shot: &Shot, percent: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let patches = field(
        clean.size(),
        PATCH_PIXELS * scale(clean.size()),
        chance.of(1),
    );
    let sent = reflectance(shot);
    let dark = Plane::from_fn(width, height, |x, y| {
        patches[(x, y)] - 0.5 * sent[(x, y)].clamp(0.05, 20.0).ln()
    });
    let least = upper(dark.samples().iter().copied(), percent).unwrap_or(f32::INFINITY);
    let (lost, error) = (chance.of(2), chance.of(3));
    let spoiled = Plane::from_fn(width, height, |x, y| {
        let (z, at) = (clean[(x, y)], (y * width + x) as u64);
        let swallowed = dark[(x, y)] >= least;
        if !swallowed || z.is_nan() {
            z
        } else if lost.unit(at) < LOST {
            f32::NAN
        } else {
            (z * (1.0 + ERROR * error.normal(at))).max(NEAREST_METRES)
        }
    });
    let mut worse = with_metres(shot, spoiled);
    if let Some(amplitude) = &mut worse.depth.amplitude {
        for (amplitude, dark) in amplitude.samples_mut().iter_mut().zip(dark.samples()) {
            if *dark >= least {
                *amplitude *= LEFT;
            }
        }
    }
    Ok(worse)
}
