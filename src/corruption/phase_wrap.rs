//! Distances beyond the camera's range.

use super::{
    CorruptionError,
    depth_grid::{NEAREST_METRES, lens, metres, ray, with_metres},
    field::upper,
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// A range such that `percent` of the answered samples lie beyond it; these come back as what is
/// left of their distance.
pub(super) fn on_shot(shot: &Shot, percent: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let lens = lens(shot);
    let distance = Plane::from_fn(width, height, |x, y| {
        ray(&lens, x, y).map_or(f32::NAN, |ray| ray.length() * clean[(x, y)])
    });
    let range = upper(distance.samples().iter().copied(), percent);
    let range = range.ok_or(CorruptionError::NoDepth)?;
    let wrapped = Plane::from_fn(width, height, |x, y| {
        let (z, distance) = (clean[(x, y)], distance[(x, y)]);
        if distance >= range {
            (z * (distance % range) / distance).max(NEAREST_METRES)
        } else {
            z
        }
    });
    Ok(with_metres(shot, wrapped))
}
