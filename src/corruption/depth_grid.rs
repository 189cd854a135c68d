//! The grid depth lies on: its lens, its scale, what is known of it, and a shot with other depth.

use super::CorruptionError;
use crate::shot::Shot;
use drivers::{DepthFrame, Intrinsics, Plane};
use glam::{DVec2, Vec3};

/// Side of the square picture that pixels are stated for.
const STATED_SIDE: f32 = 256.0;
/// The nearest a spoiled answer may lie, metres: what a device would still report.
pub(super) const NEAREST_METRES: f32 = 1e-3;

/// Pixels of a picture of this size for one pixel at 256×256.
pub(super) fn scale((width, height): (usize, usize)) -> f32 {
    ((width * height) as f32).sqrt() / STATED_SIDE
}

/// The lens depth was seen through.
pub(super) fn lens(shot: &Shot) -> Intrinsics {
    shot.rig.depth.map_or(shot.rig.color, |camera| camera.lens)
}

/// Ray (x/z, y/z, 1) through a depth sample; `None` outside the lens model's useful circle.
pub(super) fn ray(lens: &Intrinsics, x: usize, y: usize) -> Option<Vec3> {
    let ray = lens.ray(DVec2::new(x as f64, y as f64))?;
    Some(ray.as_vec3())
}

/// Depth in metres, at least one sample of which is known.
pub(super) fn metres(shot: &Shot) -> Result<&Plane<f32>, CorruptionError> {
    let metres = &shot.depth.metres;
    if metres.samples().iter().any(|z| z.is_finite()) {
        Ok(metres)
    } else {
        Err(CorruptionError::NoDepth)
    }
}

/// The shot with other depth on the same grid; what is not above 0 has no answer. The camera's own
/// statement of its sigma is dropped: it was made of the clean depth.
pub(super) fn with_metres(shot: &Shot, metres: Plane<f32>) -> Shot {
    let answered = |z: &f32| if *z > 0.0 { *z } else { f32::NAN };
    let depth = DepthFrame {
        metres: metres.map(answered),
        sigma: None,
        ..shot.depth.clone()
    };
    Shot {
        depth,
        ..shot.clone()
    }
}

/// What the surfaces send back of the infrared that reaches them, 1 = the median: amplitude times
/// squared depth; 1 everywhere without amplitude. NaN = unknown.
pub(super) fn reflectance(shot: &Shot) -> Plane<f32> {
    let metres = &shot.depth.metres;
    let (width, height) = metres.size();
    let Some(amplitude) = &shot.depth.amplitude else {
        return metres.map(|z| if z.is_finite() { 1.0 } else { f32::NAN });
    };
    let sent = Plane::from_fn(width, height, |x, y| {
        amplitude[(x, y)] * metres[(x, y)].powi(2)
    });
    let median = super::field::upper(sent.samples().iter().copied(), 50.0);
    let median = median.unwrap_or(1.0).max(f32::MIN_POSITIVE);
    sent.map(|value| value / median)
}
