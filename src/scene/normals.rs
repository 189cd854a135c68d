//! Normals from the slope of 1/z on the true rays.

use super::{edges::Edges, smooth::InverseDepth};
use drivers::Plane;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Second differences below so many standard deviations of their noise are no fold.
const FOLD_SIGMAS: f32 = 4.0;

/// A side is smooth, and the pixel on its fold, when the bend across the pixel is so many times
/// the bend of that side.
const FOLD_RATIO: f32 = 3.0;

/// Unit normals in camera axes, facing the camera; NaN where depth is unknown.
///
/// A plane is linear in 1/z: with ray (u, v, 1) it obeys 1/z = a·u + b·v + c, and (a, b, c) is its
/// normal up to length and sign. The slopes are central differences inside a surface, and taken
/// from one side beside a cut or a fold; a pixel cut off on both sides along an axis is taken to
/// face the camera there.
pub(super) fn normals(depth: &InverseDepth, edges: &Edges, rays: &Plane<Vec2>) -> Plane<Vec3> {
    of_planes(depth, rays, |x, y| {
        let here = depth.value[(x, y)];
        let [left, right, above, below] = edges.open(x, y);
        let noise = depth.variance[(x, y)].sqrt();
        let across = slope(
            [
                left.then(|| here - depth.value[(x - 1, y)]),
                right.then(|| depth.value[(x + 1, y)] - here),
            ],
            [
                (left && edges.open(x - 1, y)[0])
                    .then(|| depth.value[(x - 1, y)] - depth.value[(x - 2, y)]),
                (right && edges.open(x + 1, y)[1])
                    .then(|| depth.value[(x + 2, y)] - depth.value[(x + 1, y)]),
            ],
            noise,
        );
        let down = slope(
            [
                above.then(|| here - depth.value[(x, y - 1)]),
                below.then(|| depth.value[(x, y + 1)] - here),
            ],
            [
                (above && edges.open(x, y - 1)[2])
                    .then(|| depth.value[(x, y - 1)] - depth.value[(x, y - 2)]),
                (below && edges.open(x, y + 1)[3])
                    .then(|| depth.value[(x, y + 2)] - depth.value[(x, y + 1)]),
            ],
            noise,
        );
        [across, down]
    })
}

/// Unit normals in camera axes from known changes of 1/z per pixel to the right and down; NaN where
/// depth is unknown.
pub(super) fn normals_of_slopes(
    depth: &InverseDepth,
    slope: &Plane<[f32; 2]>,
    rays: &Plane<Vec2>,
) -> Plane<Vec3> {
    of_planes(depth, rays, |x, y| slope[(x, y)].map(Some))
}

/// Normals of the planes through every pixel; `slopes` gives the change of 1/z per pixel to the
/// right and down.
fn of_planes(
    depth: &InverseDepth,
    rays: &Plane<Vec2>,
    slopes: impl Fn(usize, usize) -> [Option<f32>; 2] + Sync,
) -> Plane<Vec3> {
    let (width, height) = depth.value.size();
    let mut plane = Plane::filled(width, height, Vec3::NAN);
    plane
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, normal) in row.iter_mut().enumerate() {
                let (here, ray) = (depth.value[(x, y)], rays[(x, y)]);
                if here.is_nan() || ray.is_nan() {
                    continue;
                }
                let [across, down] = slopes(x, y);
                *normal = plane_normal(here, ray, across, down, ray_steps(rays, x, y));
            }
        });
    plane
}

/// Change of 1/z per pixel, from the steps to the two neighbours and the steps beyond them;
/// `None` when both neighbours are cut off.
fn slope(near: [Option<f32>; 2], far: [Option<f32>; 2], noise: f32) -> Option<f32> {
    // A side's own bend, and the slope at the pixel that continues it.
    let side = |i: usize| {
        let step = near[i]?;
        let bend = far[i].map(|far| step - far);
        let continued = match bend {
            Some(bend) if bend.abs() > FOLD_SIGMAS * 6f32.sqrt() * noise => step + 0.5 * bend,
            _ => step,
        };
        Some((continued, bend))
    };
    match (side(0), side(1)) {
        (Some((from_first, first_bend)), Some((from_second, second_bend))) => {
            let (Some(a), Some(b)) = (near[0], near[1]) else {
                return None;
            };
            let bend = (b - a).abs();
            let folded = |side: Option<f32>| {
                let side = side.map_or(f32::INFINITY, f32::abs);
                bend > FOLD_SIGMAS * 6f32.sqrt() * noise && bend > FOLD_RATIO * side
            };
            match (folded(first_bend), folded(second_bend)) {
                (true, true) if first_bend.map(f32::abs) <= second_bend.map(f32::abs) => {
                    Some(from_first)
                }
                (_, true) => Some(from_second),
                (true, false) => Some(from_first),
                (false, false) => Some(0.5 * (a + b)),
            }
        }
        (Some((slope, _)), None) | (None, Some((slope, _))) => Some(slope),
        (None, None) => None,
    }
}

/// Change of the ray per pixel to the right and per pixel down.
fn ray_steps(rays: &Plane<Vec2>, x: usize, y: usize) -> [Vec2; 2] {
    let (width, height) = rays.size();
    let step = |low: (usize, usize), high: (usize, usize), instead: Vec2| {
        let pixels = (high.0 - low.0 + high.1 - low.1) as f32;
        let step = (rays[high] - rays[low]) / pixels;
        // A picture one pixel wide, or the rim of the lens.
        if step.is_finite() { step } else { instead }
    };
    [
        step(
            (x.saturating_sub(1), y),
            ((x + 1).min(width - 1), y),
            Vec2::X,
        ),
        step(
            (x, y.saturating_sub(1)),
            (x, (y + 1).min(height - 1)),
            Vec2::Y,
        ),
    ]
}

/// The normal of the plane through a pixel with the given changes of 1/z across and down.
fn plane_normal(
    here: f32,
    ray: Vec2,
    across: Option<f32>,
    down: Option<f32>,
    [right, below]: [Vec2; 2],
) -> Vec3 {
    // Without a neighbour on either side the slope along that axis is taken as that of a sphere
    // around the camera, which faces it: d(1/z) = 1/z · ray·step / |(ray, 1)|².
    let facing = |step: Vec2| here * ray.dot(step) / (1.0 + ray.length_squared());
    let across = across.unwrap_or_else(|| facing(right));
    let down = down.unwrap_or_else(|| facing(below));
    let determinant = right.perp_dot(below);
    let a = (across * below.y - down * right.y) / determinant;
    let b = (down * right.x - across * below.x) / determinant;
    let c = here - a * ray.x - b * ray.y;
    // (a, b, c)·(ray, 1) = 1/z > 0, so its negative faces the camera.
    -Vec3::new(a, b, c).normalize_or(Vec3::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slope_at_a_fold_is_that_of_the_smoother_side() {
        // 1/z falls by 1 a pixel, then rises by 2; the pixel belongs to the falling side.
        let found = slope([Some(-1.0), Some(1.4)], [Some(-1.0), Some(2.0)], 1e-6);
        assert_eq!(found, Some(-1.0));
        // A parabola keeps its central difference.
        assert_eq!(
            slope([Some(1.0), Some(3.0)], [Some(-1.0), Some(5.0)], 1e-6),
            Some(2.0)
        );
        // Beside a cut the bend is continued: x² at 2, seen from the left.
        assert_eq!(slope([Some(3.0), None], [Some(1.0), None], 1e-6), Some(4.0));
        // Within the noise nothing is a fold.
        assert_eq!(
            slope([Some(-1.0), Some(1.5)], [Some(-1.0), Some(2.0)], 1.0),
            Some(0.25)
        );
    }
}
