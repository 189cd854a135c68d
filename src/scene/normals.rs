//! Normals from the slope of 1/z on the true rays.

use super::{edges::Edges, smooth::InverseDepth};
use drivers::Plane;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Unit normals in camera axes, facing the camera; NaN where depth is unknown.
///
/// A plane is linear in 1/z: with ray (u, v, 1) it obeys 1/z = a·u + b·v + c, and (a, b, c) is its
/// normal up to length and sign. The slopes are central differences inside a surface and one-sided
/// beside a cut; a pixel cut off on both sides along an axis is taken to face the camera there.
pub(super) fn normals(depth: &InverseDepth, edges: &Edges, rays: &Plane<Vec2>) -> Plane<Vec3> {
    let (width, height) = depth.value.size();
    let mut plane = Plane::filled(width, height, Vec3::NAN);
    plane
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, normal) in row.iter_mut().enumerate() {
                let here = depth.value[(x, y)];
                if here.is_nan() || rays[(x, y)].is_nan() {
                    continue;
                }
                let [left, right, above, below] = edges.open(x, y);
                let across = difference(
                    depth,
                    rays,
                    (x - usize::from(left), y),
                    (x + usize::from(right), y),
                );
                let down = difference(
                    depth,
                    rays,
                    (x, y - usize::from(above)),
                    (x, y + usize::from(below)),
                );
                *normal = plane_normal(here, rays[(x, y)], across, down);
            }
        });
    plane
}

/// Change of 1/z and of the ray between two pixels.
fn difference(
    depth: &InverseDepth,
    rays: &Plane<Vec2>,
    from: (usize, usize),
    to: (usize, usize),
) -> (f32, Vec2) {
    (depth.value[to] - depth.value[from], rays[to] - rays[from])
}

/// The normal of the plane through a pixel with the given changes of 1/z across and down.
fn plane_normal(here: f32, ray: Vec2, across: (f32, Vec2), down: (f32, Vec2)) -> Vec3 {
    // Without a neighbour on either side the slope along that axis is taken as that of a sphere
    // around the camera, which faces it: d(1/z) = 1/z · ray·step / |(ray, 1)|².
    let flat = |(change, step): (f32, Vec2), instead: Vec2| {
        if step == Vec2::ZERO || step.is_nan() {
            (
                here * ray.dot(instead) / (1.0 + ray.length_squared()),
                instead,
            )
        } else {
            (change, step)
        }
    };
    let (change_x, step_x) = flat(across, Vec2::X);
    let (change_y, step_y) = flat(down, Vec2::Y);
    let determinant = step_x.perp_dot(step_y);
    let a = (change_x * step_y.y - change_y * step_x.y) / determinant;
    let b = (change_y * step_x.x - change_x * step_y.x) / determinant;
    let c = here - a * ray.x - b * ray.y;
    // (a, b, c)·(ray, 1) = 1/z > 0, so its negative faces the camera.
    -Vec3::new(a, b, c).normalize_or(Vec3::NAN)
}
