//! The reference for the sweep: a march along the ray of light through the same slabs.

use captured::relight::Origin;
use drivers::{Intrinsics, Plane};

/// True when nothing stands between the point seen at `pixel` and a lamp.
///
/// Walks the ray of light in steps of a quarter pixel of its image and asks at each step whether
/// the point lies inside the slab of the surface seen there: between its depth (interpolated
/// along the image where neighbours belong to one surface) and its depth plus thickness. Steps
/// are bounded by the frame; no limit on range.
pub fn march(
    camera: &Intrinsics,
    metres: &Plane<f32>,
    thickness_metres: &Plane<f32>,
    lamp: Origin,
    pixel: (usize, usize),
) -> bool {
    let start_z = f64::from(metres[pixel]);
    let start = glam::DVec3::new(
        (pixel.0 as f64 - camera.cx) / camera.fx,
        (pixel.1 as f64 - camera.cy) / camera.fy,
        1.0,
    ) * start_z;
    let (toward, reach) = match lamp {
        Origin::Distant(toward) => (toward.as_dvec3(), f64::INFINITY),
        Origin::Near(position) => {
            let way = position.as_dvec3() - start;
            (way.normalize(), way.length())
        }
    };
    let image = |p: glam::DVec3| {
        glam::DVec2::new(
            camera.cx + camera.fx * p.x / p.z,
            camera.cy + camera.fy * p.y / p.z,
        )
    };
    let origin = image(start);
    // Image direction of the ray of light at its start.
    let along = glam::DVec2::new(
        camera.fx * (toward.x * start.z - start.x * toward.z),
        camera.fy * (toward.y * start.z - start.y * toward.z),
    );
    if along.length() < 1e-9 {
        return true;
    }
    let along = along.normalize();
    for step in 1.. {
        let pixels = step as f64 * 0.25;
        let at = origin + along * pixels;
        if at.x < 0.0
            || at.y < 0.0
            || at.x > camera.width as f64 - 1.0
            || at.y > camera.height as f64 - 1.0
        {
            return true;
        }
        // Where the ray of light is when its image is at `at`: solve along the larger component.
        let (rx, ry) = (
            (at.x - camera.cx) / camera.fx,
            (at.y - camera.cy) / camera.fy,
        );
        let s = if along.x.abs() > along.y.abs() {
            (rx * start.z - start.x) / (toward.x - rx * toward.z)
        } else {
            (ry * start.z - start.y) / (toward.y - ry * toward.z)
        };
        let z = start.z + s * toward.z;
        // Past the vanishing point or the lamp, or behind the lens.
        if s < 0.0 || s > reach || z <= 0.0 || !s.is_finite() {
            return true;
        }
        // Half a pixel of bias, as any shadow test on samples needs.
        let footprint = start_z / camera.fx;
        if s < footprint {
            continue;
        }
        if let Some((front, back)) = slab(metres, thickness_metres, at, camera.fx) {
            let tolerance = 0.5 * footprint;
            if z > front + tolerance && z < back {
                return false;
            }
        }
    }
    true
}

/// Front and back of the slab at a place between pixels.
fn slab(
    metres: &Plane<f32>,
    thickness_metres: &Plane<f32>,
    at: glam::DVec2,
    focal: f64,
) -> Option<(f64, f64)> {
    let nearest = (at.x.round() as usize, at.y.round() as usize);
    let here = f64::from(metres[nearest]);
    let (x0, y0) = (at.x.floor() as usize, at.y.floor() as usize);
    let (x1, y1) = (
        (x0 + 1).min(metres.width() - 1),
        (y0 + 1).min(metres.height() - 1),
    );
    let (fx, fy) = (at.x - x0 as f64, at.y - y0 as f64);
    let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|c| f64::from(metres[c]));
    let one_surface = corners
        .iter()
        .all(|z| (z - here).abs() < 8.0 / focal * here);
    let front = if one_surface {
        let [a, b, c, d] = corners.map(|z| 1.0 / z);
        1.0 / ((a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy)
    } else {
        here
    };
    Some((front, front + f64::from(thickness_metres[nearest])))
        .filter(|(front, _)| front.is_finite())
}
