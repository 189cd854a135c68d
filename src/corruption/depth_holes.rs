//! Patches of depth without an answer.

use super::{
    CorruptionError,
    depth_grid::{metres, scale, with_metres},
    field::{field, upper},
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// About the width of a patch, pixels at 256×256.
const PATCH_PIXELS: f32 = 16.0;

/// `percent` of the answered samples lost, in patches that grow with it.
pub(super) fn on_shot(shot: &Shot, percent: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let field = field(clean.size(), PATCH_PIXELS * scale(clean.size()), chance);
    let answered = field.samples().iter().zip(clean.samples());
    let answered = answered.filter_map(|(value, z)| z.is_finite().then_some(*value));
    let least = upper(answered, percent).unwrap_or(f32::INFINITY);
    let holed = Plane::from_fn(width, height, |x, y| {
        if field[(x, y)] >= least {
            f32::NAN
        } else {
            clean[(x, y)]
        }
    });
    Ok(with_metres(shot, holed))
}
