//! Depth that lies beside the photograph.

use super::{
    CorruptionError,
    depth_grid::{metres, scale},
};
use crate::shot::Shot;
use drivers::{DepthFrame, Plane, chance::Chance};
use std::f64::consts::TAU;

/// Least step that is not smoothed over, as a share of the front's depth.
const STEP: f32 = 0.05;

/// Depth, amplitude and sigma moved by `pixels`, all in one direction; what would come from beyond
/// the border has no answer.
pub(super) fn on_shot(shot: &Shot, pixels: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let metres = metres(shot)?;
    let shift = pixels * scale(metres.size());
    let (down, right) = (TAU * chance.unit(0)).sin_cos();
    let shift = [shift * right as f32, shift * down as f32];
    let depth = DepthFrame {
        metres: moved(metres, shift),
        amplitude: shot
            .depth
            .amplitude
            .as_ref()
            .map(|plane| moved(plane, shift)),
        sigma: shot.depth.sigma.as_ref().map(|plane| moved(plane, shift)),
        ..shot.depth.clone()
    };
    Ok(Shot {
        depth,
        ..shot.clone()
    })
}

/// The plane moved right and down by `shift`; across a step, and beside an unknown sample, the
/// nearest sample instead of a mean.
fn moved(plane: &Plane<f32>, [right, down]: [f32; 2]) -> Plane<f32> {
    let (width, height) = plane.size();
    let sample = |x: f32, y: f32| {
        let inside = x >= 0.0 && y >= 0.0;
        let found = inside.then(|| plane.get(x as usize, y as usize)).flatten();
        found.copied().unwrap_or(f32::NAN)
    };
    Plane::from_fn(width, height, |x, y| {
        let (x, y) = (x as f32 - right, y as f32 - down);
        let (left, top) = (x.floor(), y.floor());
        let (across, along) = (x - left, y - top);
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
            .map(|(dx, dy)| sample(left + dx, top + dy));
        let least = corners.into_iter().fold(f32::INFINITY, f32::min);
        let most = corners.into_iter().fold(0.0, f32::max);
        if corners.iter().any(|value| value.is_nan()) || most - least > STEP * least {
            return sample(x.round(), y.round());
        }
        let [a, b, c, d] = corners;
        let (upper, lower) = (a + (b - a) * across, c + (d - c) * across);
        upper + (lower - upper) * along
    })
}
