//! Patches of depth without an answer.

use super::{
    CorruptionError,
    depth_grid::{metres, scale, with_metres},
    field::patches,
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// About the width of a patch, pixels at 256×256.
const PATCH_PIXELS: f32 = 16.0;

/// `percent` of the answered samples lost, in patches that grow with it.
pub(super) fn on_shot(shot: &Shot, percent: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let hole = patches(clean, percent, PATCH_PIXELS * scale(clean.size()), chance);
    let holed = Plane::from_fn(width, height, |x, y| {
        if hole[(x, y)] {
            f32::NAN
        } else {
            clean[(x, y)]
        }
    });
    Ok(with_metres(shot, holed))
}
