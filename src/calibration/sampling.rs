//! Values between pixels.

use drivers::Plane;
use glam::DVec2;

/// Value between pixels by straight lines; outside, that of the nearest pixel of a plane that has any.
pub(super) fn sample(plane: &Plane<f32>, at: DVec2) -> f32 {
    let (width, height) = plane.size();
    let limit = DVec2::new(width as f64 - 1.0, height as f64 - 1.0);
    let at = at.clamp(DVec2::ZERO, limit);
    let (x, y) = (at.x as usize, at.y as usize);
    let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
    let (u, v) = (at.x.fract() as f32, at.y.fract() as f32);
    let row = |y: usize| plane[(x, y)] * (1.0 - u) + plane[(right, y)] * u;
    row(y) * (1.0 - v) + row(below) * v
}
