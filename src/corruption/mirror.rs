//! Surfaces that mirror infrared.

use super::{
    CorruptionError,
    depth_grid::{metres, scale, with_metres},
    field::patches,
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// About the width of a mirror, pixels at 256×256.
const PATCH_PIXELS: f32 = 48.0;
/// What comes back of the amplitude by the longer way.
const LEFT: f32 = 0.3;

/// Patches over `percent` of the answered samples become mirrors: their depth is their own plus that
/// of what they show, which is taken to be what lies at the other side of the picture. Where that is
/// unknown there is no answer. The photograph stays as it is.
pub(super) fn on_shot(shot: &Shot, percent: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let mirror = patches(clean, percent, PATCH_PIXELS * scale(clean.size()), chance);
    let mirrored = Plane::from_fn(width, height, |x, y| {
        if mirror[(x, y)] {
            clean[(x, y)] + clean[(width - 1 - x, y)]
        } else {
            clean[(x, y)]
        }
    });
    let mut worse = with_metres(shot, mirrored);
    if let Some(amplitude) = &mut worse.depth.amplitude {
        for (amplitude, mirror) in amplitude.samples_mut().iter_mut().zip(mirror.samples()) {
            if *mirror {
                *amplitude *= LEFT;
            }
        }
    }
    Ok(worse)
}
