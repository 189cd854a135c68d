//! Surfaces that mirror infrared.

use super::{
    CorruptionError,
    depth_grid::{metres, scale, with_metres},
    field::{field, upper},
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
    let field = field(clean.size(), PATCH_PIXELS * scale(clean.size()), chance);
    let answered = field.samples().iter().zip(clean.samples());
    let answered = answered.filter_map(|(value, z)| z.is_finite().then_some(*value));
    let least = upper(answered, percent).unwrap_or(f32::INFINITY);
    let mirrored = Plane::from_fn(width, height, |x, y| {
        if field[(x, y)] >= least {
            clean[(x, y)] + clean[(width - 1 - x, y)]
        } else {
            clean[(x, y)]
        }
    });
    let mut worse = with_metres(shot, mirrored);
    if let Some(amplitude) = &mut worse.depth.amplitude {
        for (amplitude, value) in amplitude.samples_mut().iter_mut().zip(field.samples()) {
            if *value >= least {
                *amplitude *= LEFT;
            }
        }
    }
    Ok(worse)
}
