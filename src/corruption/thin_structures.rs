//! Things too thin for the depth camera.

use super::{
    CorruptionError,
    depth_grid::{metres, scale, with_metres},
    flying_pixels::windowed,
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// Least step that makes a thing stand before its background, as a share of its depth.
const STEP: f32 = 0.02;

/// Whatever is at most `pixels` wide and stands before something else gets the depth of what is
/// around it (a morphological closing of depth); what has no answer stays without.
pub(super) fn on_shot(shot: &Shot, pixels: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let radius = (0.5 * pixels * scale(clean.size())).round().max(1.0) as usize;
    let closed = windowed(&windowed(clean, radius, f32::max), radius, f32::min);
    let thinned = Plane::from_fn(width, height, |x, y| {
        let (z, behind) = (clean[(x, y)], closed[(x, y)]);
        if behind - z > STEP * z { behind } else { z }
    });
    Ok(with_metres(shot, thinned))
}
