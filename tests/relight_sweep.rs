//! The sweep against a brute-force march over the same slabs.

mod march;

use captured::relight::visibility::{Answers, Occluders, sweep};
use drivers::{Distortion, Intrinsics, Plane};
use glam::Vec3;
use march::march;

/// A pinhole with a field of view as phones have.
fn camera(width: usize, height: usize) -> Intrinsics {
    Intrinsics {
        width,
        height,
        fx: width as f64 * 0.95,
        fy: width as f64 * 0.95,
        cx: (width as f64 - 1.0) / 2.0,
        cy: (height as f64 - 1.0) / 2.0,
        distortion: Distortion::None {},
    }
}

/// Balls and a box in front of a slanted wall, as depth seen through `camera`.
fn balls_before_a_wall(camera: &Intrinsics) -> Plane<f32> {
    let balls = [
        (Vec3::new(0.1, 0.05, 1.4), 0.16f32),
        (Vec3::new(-0.3, -0.2, 1.2), 0.1),
        (Vec3::new(-0.05, -0.25, 1.6), 0.2),
        (Vec3::new(0.35, 0.3, 1.3), 0.07),
    ];
    Plane::from_fn(camera.width, camera.height, |x, y| {
        let ray = Vec3::new(
            ((x as f64 - camera.cx) / camera.fx) as f32,
            ((y as f64 - camera.cy) / camera.fy) as f32,
            1.0,
        );
        let normal = Vec3::new(0.2, -0.3, -1.0);
        let mut z = normal.dot(Vec3::new(0.0, 0.0, 1.8)) / normal.dot(ray);
        for (centre, radius) in balls {
            let (a, b) = (ray.length_squared(), ray.dot(centre));
            let discriminant = b * b - a * (centre.length_squared() - radius * radius);
            if discriminant > 0.0 {
                z = z.min((b - discriminant.sqrt()) / a);
            }
        }
        // A box's front face.
        let face = 1.25;
        let at = ray * face;
        if (at.x - 0.25).abs() < 0.09 && (at.y + 0.2).abs() < 0.12 {
            z = z.min(face);
        }
        z
    })
}

/// Does the surface at a pixel face the lamp, by the plane through it and two neighbours?
fn faces(camera: &Intrinsics, metres: &Plane<f32>, toward: Vec3, (x, y): (usize, usize)) -> bool {
    let point = |x: usize, y: usize| {
        let (x, y) = (x.min(camera.width - 1), y.min(camera.height - 1));
        Vec3::new(
            ((x as f64 - camera.cx) / camera.fx) as f32,
            ((y as f64 - camera.cy) / camera.fy) as f32,
            1.0,
        ) * metres[(x, y)]
    };
    let (x0, y0) = (x.min(camera.width - 2), y.min(camera.height - 2));
    let normal = (point(x0, y0 + 1) - point(x0, y0)).cross(point(x0 + 1, y0) - point(x0, y0));
    normal.dot(toward) > 0.0
}

fn agreement(size: (usize, usize), toward: Vec3, thickness: f32) -> f64 {
    let camera = camera(size.0, size.1);
    let metres = balls_before_a_wall(&camera);
    let thickness = Plane::filled(size.0, size.1, thickness);
    let sigma = Plane::filled(size.0, size.1, 0.0);
    let occluders = Occluders::new(camera, &metres, &thickness, &sigma);
    let swept = sweep(&occluders, toward);
    let answers = Answers::new(&swept, size.0);
    let mut row = vec![0.0; size.0];
    let mut same = 0;
    for y in 0..size.1 {
        answers.row(y, &mut row);
        for (x, swept) in row.iter().enumerate() {
            let marched = march(&camera, &metres, &thickness, toward, (x, y));
            // What is turned away from the lamp is dark by its normal, for both alike.
            let faces = faces(&camera, &metres, toward, (x, y));
            same += usize::from(!faces || (*swept > 0.5) == marched);
        }
    }
    same as f64 / (size.0 * size.1) as f64
}

/// Directions over the hemisphere toward the camera and a little behind the scene, as unit
/// vectors in camera axes.
fn directions() -> Vec<Vec3> {
    let mut all = vec![Vec3::new(0.0, 0.0, -1.0)];
    for off_axis_degrees in [12.0f32, 35.0, 60.0, 80.0, 89.9, 100.0] {
        for k in 0..7 {
            let azimuth = 0.3 + k as f32 * std::f32::consts::TAU / 7.0;
            let (sin, cos) = off_axis_degrees.to_radians().sin_cos();
            all.push(Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), -cos));
        }
    }
    all.extend([Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y]);
    all
}

#[test]
fn the_sweep_agrees_with_the_march_on_99_percent_of_pixels() {
    let mut worst = (1.0, Vec3::ZERO);
    let mut sum = 0.0;
    for toward in directions() {
        let same = agreement((160, 120), toward, 0.15);
        sum += same;
        if same < worst.0 {
            worst = (same, toward);
        }
    }
    let mean = sum / directions().len() as f64;
    assert!(mean >= 0.99, "mean agreement {mean}");
    assert!(worst.0 >= 0.985, "worst agreement {worst:?}");
}
