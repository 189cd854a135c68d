//! The sweep against a brute-force march over the same slabs.

mod march;

use captured::relight::{
    Origin,
    visibility::{Answers, Occluders, Thickness, sweep},
};
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
fn faces(camera: &Intrinsics, metres: &Plane<f32>, lamp: Origin, (x, y): (usize, usize)) -> bool {
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
    let toward = match lamp {
        Origin::Distant(toward) => toward,
        Origin::Near(position) => position - point(x, y),
    };
    normal.dot(toward) > 0.0
}

fn balls(size: (usize, usize), thickness: f32) -> (Intrinsics, Plane<f32>, Plane<f32>, Occluders) {
    let camera = camera(size.0, size.1);
    let metres = balls_before_a_wall(&camera);
    let thickness = Plane::filled(size.0, size.1, thickness);
    let sigma = Plane::filled(size.0, size.1, 0.0);
    let occluders = Occluders::new(camera, &metres, &thickness, &sigma);
    (camera, metres, thickness, occluders)
}

fn agreement(size: (usize, usize), lamp: Origin, thickness: f32) -> f64 {
    let (camera, metres, thickness, occluders) = balls(size, thickness);
    let swept = sweep(&occluders, lamp, Thickness::Guessed);
    let answers = Answers::new(&swept, size.0);
    let mut row = vec![0.0; size.0];
    let mut same = 0;
    for y in 0..size.1 {
        answers.row(y, &mut row);
        for (x, swept) in row.iter().enumerate() {
            let marched = march(&camera, &metres, &thickness, lamp, (x, y));
            // What is turned away from the lamp is dark by its normal, for both alike.
            let faces = faces(&camera, &metres, lamp, (x, y));
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

/// Asserts that the sweep and the march agree on 99 % of the pixels, and under every lamp on at least `least`.
fn assert_agreement(lamps: &[Origin], least: f64) {
    let same: Vec<f64> = lamps
        .iter()
        .map(|lamp| agreement((160, 120), *lamp, 0.15))
        .collect();
    let mean = same.iter().sum::<f64>() / same.len() as f64;
    let worse: Vec<_> = lamps
        .iter()
        .zip(&same)
        .filter(|(_, same)| **same < least)
        .collect();
    assert!(mean >= 0.99, "mean agreement {mean}");
    assert!(worse.is_empty(), "{worse:?}");
}

#[test]
fn the_sweep_agrees_with_the_march_on_99_percent_of_pixels() {
    let lamps: Vec<Origin> = directions().into_iter().map(Origin::Distant).collect();
    assert_agreement(&lamps, 0.985);
}

#[test]
fn a_sweep_that_doubts_thickness_gives_the_mean_over_all_it_may_be() {
    const SIZE: (usize, usize) = (96, 72);
    const STEPS: usize = 8;
    // From a fifth of the guess to one and a half times.
    let factors: Vec<f32> = (0..STEPS)
        .map(|step| 0.2 + 1.3 * (step as f32 + 0.5) / STEPS as f32)
        .collect();
    let (camera, metres, thickness, occluders) = balls(SIZE, 0.15);
    let mut sums = [0.0; 2];
    let lamps = directions().into_iter().step_by(5).map(Origin::Distant);
    for lamp in lamps.chain(places().into_iter().take(6)) {
        let thicknesses: Vec<Plane<f32>> = factors
            .iter()
            .map(|factor| thickness.map(|metres| metres * factor))
            .collect();
        let mut apart = [0.0f64; 2];
        let rows = [Thickness::Doubted, Thickness::Guessed]
            .map(|thickness| rows(&occluders, lamp, thickness));
        for y in 0..SIZE.1 {
            for x in (0..SIZE.0).filter(|x| faces(&camera, &metres, lamp, (*x, y))) {
                let lit = |thickness| march(&camera, &metres, thickness, lamp, (x, y));
                let lit = thicknesses.iter().filter(|thickness| lit(thickness));
                let mean = lit.count() as f32 / STEPS as f32;
                for (apart, rows) in apart.iter_mut().zip(&rows) {
                    *apart += f64::from((rows[y * SIZE.0 + x] - mean).powi(2));
                }
            }
        }
        let [doubted, guessed] = apart.map(|sum| sum / (SIZE.0 * SIZE.1) as f64);
        sums = [sums[0] + doubted, sums[1] + guessed];
        assert!(
            doubted < 1.05 * guessed + 5e-4,
            "{lamp:?}: {doubted} {guessed}"
        );
    }
    assert!(sums[0] < 0.8 * sums[1], "{sums:?}");
}

/// Places all around the balls: behind the lens, in its plane, in front of it outside the picture and
/// inside it, between the balls and the wall, and behind the wall.
fn places() -> Vec<Origin> {
    let mut all = vec![Vec3::new(0.0, 0.0, -0.5), Vec3::new(0.02, -0.01, 0.0)];
    for z in [-0.4f32, 0.0, 0.001, 0.3, 0.8, 1.2, 1.5, 2.5] {
        for k in 0..4 {
            let azimuth = 0.3 + k as f32 * std::f32::consts::TAU / 4.0;
            let away = if k % 2 == 0 { 0.3 } else { 1.1 };
            all.push(Vec3::new(away * azimuth.cos(), away * azimuth.sin(), z));
        }
    }
    all.into_iter().map(Origin::Near).collect()
}

#[test]
fn the_sweep_agrees_with_the_march_for_lamps_near_to_the_scene_too() {
    // A few centimetres behind a ball, less than ten pixels, its edge is as wide as what the lamp sees of it.
    assert_agreement(&places(), 0.95);
}

fn swept(occluders: &Occluders, lamp: Origin) -> Vec<f32> {
    rows(occluders, lamp, Thickness::Guessed)
}

/// Visibility of every pixel, row by row.
fn rows(occluders: &Occluders, lamp: Origin, thickness: Thickness) -> Vec<f32> {
    let (width, height) = occluders.size();
    let swept = sweep(occluders, lamp, thickness);
    let answers = Answers::new(&swept, width);
    let mut all = vec![0.0; width * height];
    for (y, row) in all.chunks_mut(width).enumerate() {
        answers.row(y, row);
    }
    all
}

#[test]
fn a_near_lamp_very_far_away_casts_the_shadows_of_a_distant_one() {
    let occluders = balls((160, 120), 0.15).3;
    for toward in directions() {
        let distant = swept(&occluders, Origin::Distant(toward));
        let near = swept(&occluders, Origin::Near(2e4 * toward));
        let differ = distant
            .iter()
            .zip(&near)
            .filter(|(a, b)| (*a - *b).abs() > 0.1);
        // Where the two round to either side of a shadow's edge.
        let differ = differ.count() as f64 / near.len() as f64;
        assert!(differ < 0.002, "{toward}: {differ}");
    }
}

#[test]
fn a_lamp_inside_the_lens_casts_no_shadow_that_is_seen() {
    let occluders = balls((160, 120), 0.15).3;
    for place in [
        Vec3::ZERO,
        Vec3::new(1e-4, 0.0, 0.0),
        Vec3::new(0.0, 0.0, -1e-4),
    ] {
        let dark = swept(&occluders, Origin::Near(place));
        let dark = dark.iter().filter(|lit| **lit < 0.5).count();
        assert!(dark < 20, "{place}: {dark} of 19200 pixels");
    }
}
