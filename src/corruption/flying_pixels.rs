//! Samples that see two surfaces at once.

use super::{
    CorruptionError,
    depth_grid::{metres, scale, with_metres},
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// How far from a step samples fly, pixels at 256×256.
const BAND_PIXELS: f32 = 2.0;
/// Least step, as a share of the front's depth.
const STEP: f32 = 0.05;

/// `percent` of the samples beside a depth step are put somewhere between its front and its back.
pub(super) fn on_shot(shot: &Shot, percent: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let radius = (BAND_PIXELS * scale(clean.size())).round().max(1.0) as usize;
    let front = windowed(clean, radius, f32::min);
    let back = windowed(clean, radius, f32::max);
    let (flies, place) = (chance.of(1), chance.of(2));
    let mixed = Plane::from_fn(width, height, |x, y| {
        let at = (y * width + x) as u64;
        let (front, back) = (front[(x, y)], back[(x, y)]);
        let chosen = 100.0 * flies.unit(at) < f64::from(percent);
        if back - front > STEP * front && chosen && clean[(x, y)].is_finite() {
            front + (back - front) * place.unit(at) as f32
        } else {
            clean[(x, y)]
        }
    });
    Ok(with_metres(shot, mixed))
}

/// The least or the largest (by `choose`, which must pass over NaN) of the square window that
/// reaches `radius` samples to each side.
pub(super) fn windowed(
    plane: &Plane<f32>,
    radius: usize,
    choose: fn(f32, f32) -> f32,
) -> Plane<f32> {
    let (width, height) = plane.size();
    let reach = |at: usize, end: usize| at.saturating_sub(radius)..(at + radius + 1).min(end);
    let rows = Plane::from_fn(width, height, |x, y| {
        let row = &plane.row(y)[reach(x, width)];
        row.iter().copied().fold(f32::NAN, choose)
    });
    Plane::from_fn(width, height, |x, y| {
        reach(y, height)
            .map(|y| rows[(x, y)])
            .fold(f32::NAN, choose)
    })
}
