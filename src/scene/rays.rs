//! The true ray of every pixel, lens distortion included.

use drivers::{Intrinsics, Plane};
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// Pixels between the points where a bent lens is inverted exactly.
const KNOT_SPACING: usize = 8;

/// (x/z, y/z) of every pixel of `camera`; NaN outside the lens model's useful circle.
///
/// A bent lens is inverted by Newton's method on a coarse grid; between its knots one further
/// Newton step, with the Jacobian of the cell, removes the error of interpolating.
pub(super) fn rays(camera: &Intrinsics) -> Plane<Vec2> {
    let (width, height) = camera.size();
    if matches!(camera.distortion, drivers::Distortion::None {}) {
        return Plane::from_fn(width, height, |x, y| {
            ideal(camera, x as f64, y as f64).as_vec2()
        });
    }
    let columns = width.div_ceil(KNOT_SPACING) + 1;
    let rows = height.div_ceil(KNOT_SPACING) + 1;
    let knots: Vec<Option<DVec2>> = (0..columns * rows)
        .into_par_iter()
        .map(|i| {
            let at = DVec2::new((i % columns) as f64, (i / columns) as f64) * KNOT_SPACING as f64;
            camera.ray(at).map(|ray| ray.truncate())
        })
        .collect();
    let mut plane = Plane::filled(width, height, Vec2::NAN);
    plane
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, ray) in row.iter_mut().enumerate() {
                let first = (y / KNOT_SPACING) * columns + x / KNOT_SPACING;
                let corners =
                    [first, first + 1, first + columns, first + columns + 1].map(|i| knots[i]);
                let at = DVec2::new(x as f64, y as f64);
                *ray = match corners {
                    [Some(a), Some(b), Some(c), Some(d)] => {
                        let t = DVec2::new((x % KNOT_SPACING) as f64, (y % KNOT_SPACING) as f64)
                            / KNOT_SPACING as f64;
                        polished(camera, at, [a, b, c, d], t).as_vec2()
                    }
                    _ => camera
                        .ray(at)
                        .map_or(Vec2::NAN, |ray| ray.truncate().as_vec2()),
                };
            }
        });
    plane
}

/// Where a pinhole's pixel (x, y) looks.
fn ideal(camera: &Intrinsics, x: f64, y: f64) -> DVec2 {
    DVec2::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy)
}

/// Interpolates between the corners of a cell and takes one Newton step toward the pixel.
fn polished(camera: &Intrinsics, pixel: DVec2, [a, b, c, d]: [DVec2; 4], t: DVec2) -> DVec2 {
    let guess = a.lerp(b, t.x).lerp(c.lerp(d, t.x), t.y);
    let per_pixel = 1.0 / KNOT_SPACING as f64;
    let right = (b - a).lerp(d - c, t.y) * per_pixel;
    let down = (c - a).lerp(d - b, t.x) * per_pixel;
    let miss = pixel
        - camera.distortion.distort(guess) * DVec2::new(camera.fx, camera.fy)
        - DVec2::new(camera.cx, camera.cy);
    guess + right * miss.x + down * miss.y
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::Distortion;

    #[test]
    fn rays_of_a_bent_lens_project_back_onto_their_pixel() {
        // The color lens of an Azure Kinect (rational model, k2 of −2.5).
        let camera = Intrinsics {
            width: 320,
            height: 180,
            fx: 152.9488,
            fy: 152.9818,
            cx: 159.45,
            cy: 91.09,
            distortion: Distortion::Rational {
                k1: 0.330_121,
                k2: -2.489_397,
                p1: -0.000_161_8,
                p2: -0.000_129_4,
                k3: 1.453_670,
                k4: 0.208_912,
                k5: -2.302_915,
                k6: 1.375_128,
            },
        };
        let rays = rays(&camera);
        let mut worst = 0.0f64;
        for y in 0..180 {
            for x in 0..320 {
                let ray = rays[(x, y)].as_dvec2().extend(1.0);
                let back = camera.project(ray).unwrap();
                worst = worst.max(back.distance(DVec2::new(x as f64, y as f64)));
            }
        }
        assert!(worst < 2e-3, "worst miss {worst} pixels");
    }
}
