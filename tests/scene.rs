//! The scene stage on shapes whose surfaces are known exactly.

use captured::{
    radiometry::{FlashOnly, SubtractOptions, subtract},
    registration::RegisteredDepth,
    scene::{Scene, SceneError, SceneOptions, estimate, karis_at_lens},
};
use drivers::{
    ColorFrame, Distortion, Exposure, FlashLamp, Illumination, Intrinsics, Pixels, Plane, Rig,
    Timestamp, Transfer,
};
use glam::{DVec3, Vec3};

const SIDE: usize = 128;
const INTENSITY: f32 = 0.9;

fn rig(width: usize, height: usize) -> Rig {
    let color = Intrinsics {
        width,
        height,
        fx: 150.0,
        fy: 150.0,
        cx: (width as f64 - 1.0) / 2.0,
        cy: (height as f64 - 1.0) / 2.0,
        distortion: Distortion::None {},
    };
    let flash = FlashLamp {
        position_metres: DVec3::ZERO,
        intensity: Some(INTENSITY),
        beam: drivers::Beam::default(),
    };
    Rig {
        color,
        depth: None,
        flash,
    }
}

/// Flash-only light with the noise of a good sensor.
fn flash_only(light: Plane<[f32; 3]>) -> FlashOnly {
    let frame = ColorFrame {
        at: Timestamp::from_nanos(0),
        sequence: 0,
        light: Illumination::Flash,
        exposure: Exposure::UNIT,
        pixels: Pixels::RgbF32(light.map(|_| [0.1; 3])),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    };
    let mut flash = subtract(&frame, &[], &SubtractOptions::default()).unwrap();
    // The light as given: what radiometry refuses or clips is its own test.
    flash.variance = light.map(|v| if v[0].is_nan() { f32::NAN } else { 1e-6 });
    flash.light.0 = light;
    flash
}

fn registered(metres: Plane<f32>, sigma: f32) -> RegisteredDepth {
    RegisteredDepth {
        sigma_metres: metres.map(|z| if z.is_nan() { f32::NAN } else { sigma }),
        measured: metres.map(|z| !z.is_nan()),
        amplitude: None,
        metres,
    }
}

/// A ball of radius 0.15 m one metre away, before a wall at two metres.
struct Truth {
    metres: Plane<f32>,
    normal: Plane<Vec3>,
    albedo: Plane<[f32; 3]>,
    on_ball: Plane<bool>,
    light: Plane<[f32; 3]>,
}

const BALL_ROUGHNESS: f32 = 0.4;

fn ball_before_wall() -> Truth {
    let lens = rig(SIDE, SIDE).color;
    let centre = DVec3::new(0.0, 0.0, 1.0);
    let surface = |x: usize, y: usize| {
        let ray = lens.ray(glam::DVec2::new(x as f64, y as f64)).unwrap();
        // |t·ray − centre|² = r²
        let (a, b) = (ray.length_squared(), ray.dot(centre));
        let root = b * b - a * (centre.length_squared() - 0.15 * 0.15);
        if root > 0.0 {
            let point = ray * ((b - root.sqrt()) / a);
            (point, (point - centre).normalize(), true)
        } else {
            (ray * 2.0, DVec3::NEG_Z, false)
        }
    };
    let on_ball = Plane::from_fn(SIDE, SIDE, |x, y| surface(x, y).2);
    let albedo = on_ball.map(|ball| if *ball { [0.5, 0.3, 0.2] } else { [0.6; 3] });
    Truth {
        metres: Plane::from_fn(SIDE, SIDE, |x, y| surface(x, y).0.z as f32),
        normal: Plane::from_fn(SIDE, SIDE, |x, y| surface(x, y).1.as_vec3()),
        light: Plane::from_fn(SIDE, SIDE, |x, y| {
            let (point, normal, ball) = surface(x, y);
            let cosine = -(normal.dot(point) / point.length()) as f32;
            let falloff = INTENSITY * cosine / point.length_squared() as f32;
            let roughness = if ball { BALL_ROUGHNESS } else { 1.0 };
            let highlight = karis_at_lens(cosine, roughness);
            albedo[(x, y)].map(|a| falloff * (a + highlight))
        }),
        albedo,
        on_ball,
    }
}

fn scene_of(light: Plane<[f32; 3]>, metres: Plane<f32>, sigma: f32) -> Scene {
    let (width, height) = light.size();
    let depth = registered(metres, sigma);
    estimate(
        &flash_only(light),
        &depth,
        &rig(width, height),
        &SceneOptions::default(),
    )
    .unwrap()
}

/// Mean of `error` over pixels where `counts`.
fn mean(counts: impl Fn(usize) -> bool, error: impl Fn(usize) -> f32) -> f32 {
    let errors: Vec<f32> = (0..SIDE * SIDE).filter(|&i| counts(i)).map(error).collect();
    assert!(!errors.is_empty());
    errors.iter().sum::<f32>() / errors.len() as f32
}

fn degrees(a: Vec3, b: Vec3) -> f32 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

#[test]
fn a_ball_before_a_wall_is_recovered_from_clean_depth() {
    let truth = ball_before_wall();
    let scene = scene_of(truth.light.clone(), truth.metres.clone(), 1e-3);
    let all = |_| true;
    let angle = mean(all, |i| {
        degrees(scene.normal.samples()[i], truth.normal.samples()[i])
    });
    // The rim of the ball, a pixel wide, is all that may be wrong.
    assert!(angle < 0.7, "normals {angle}° off");
    let albedo = mean(all, |i| {
        let (a, b) = (scene.albedo.samples()[i], truth.albedo.samples()[i]);
        (0..3).map(|k| (a[k] - b[k]).abs()).sum::<f32>() / 3.0
    });
    assert!(albedo < 0.02, "albedo {albedo} off");
    let roughness = scene.roughness[(SIDE / 2, SIDE / 2)];
    assert!(
        (roughness - BALL_ROUGHNESS).abs() < 0.06,
        "roughness {roughness}"
    );
    let depth = mean(all, |i| {
        (scene.depth_metres.samples()[i] - truth.metres.samples()[i]).abs()
    });
    assert!(depth < 1e-5, "clean depth moved by {depth} m");
    assert!(scene.scale_known);
}

#[test]
fn a_ball_is_as_thick_as_it_is_round_and_a_wall_has_no_end() {
    let truth = ball_before_wall();
    let scene = scene_of(truth.light, truth.metres, 1e-3);
    // 0.3 m through the middle; the silhouette of a near ball lies a little before its centre.
    let middle = scene.thickness_metres[(SIDE / 2, SIDE / 2)];
    assert!((0.24..0.33).contains(&middle), "{middle} m");
    assert_eq!(scene.thickness_metres[(3, 3)], f32::INFINITY);
}

/// A hash to a number of unit variance, roughly normal.
fn noise(i: usize) -> f32 {
    let uniform = |salt: u32| {
        let mut h = (i as u32)
            .wrapping_mul(4)
            .wrapping_add(salt)
            .wrapping_mul(0x9E37_79B1);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        (h ^ (h >> 15)) as f32 / u32::MAX as f32 - 0.5
    };
    (uniform(0) + uniform(1) + uniform(2) + uniform(3)) * 3f32.sqrt()
}

#[test]
fn noisy_depth_is_smoothed_without_its_sigma_being_told() {
    let truth = ball_before_wall();
    let mut metres = truth.metres.clone();
    let sigma = 0.01;
    for (i, z) in metres.samples_mut().iter_mut().enumerate() {
        *z += sigma * noise(i);
    }
    // The stated sigma is ten times too small.
    let scene = scene_of(truth.light, metres, 0.1 * sigma);
    let ball = |i: usize| truth.on_ball.samples()[i];
    let wall = |i: usize| !ball(i);
    let off = |i: usize| (scene.depth_metres.samples()[i] - truth.metres.samples()[i]).abs();
    // 0.8 sigma is the mean of |noise| that went in.
    let (on_ball, on_wall) = (mean(ball, off), mean(wall, off));
    assert!(
        on_ball < 0.4 * sigma && on_wall < 0.25 * sigma,
        "{on_ball} m, {on_wall} m"
    );
    let angle = mean(wall, |i| {
        degrees(scene.normal.samples()[i], truth.normal.samples()[i])
    });
    assert!(angle < 8.0, "wall {angle}° off");
}

#[test]
fn what_is_unknown_going_in_is_unknown_or_doubted_coming_out() {
    let truth = ball_before_wall();
    let (mut light, mut metres) = (truth.light, truth.metres);
    light[(64, 64)] = [f32::NAN; 3];
    light[(30, 30)] = [-0.01; 3];
    metres[(100, 100)] = f32::NAN;
    metres[(10, 100)] = -1.0;
    metres[(12, 100)] = f32::INFINITY;
    let scene = scene_of(light, metres, 1e-3);
    for at in [(100, 100), (10, 100), (12, 100)] {
        assert!(scene.normal[at].is_nan() && scene.albedo[at][0].is_nan());
        assert!(scene.roughness[at].is_nan() && scene.thickness_metres[at].is_nan());
        assert_eq!(scene.confidence[at], 0.0);
    }
    // Clipped light takes the albedo around it, and says so.
    assert!(
        (scene.albedo[(64, 64)][0] - 0.5).abs() < 0.1,
        "{:?}",
        scene.albedo[(64, 64)]
    );
    assert!(scene.confidence[(64, 64)] < 0.3);
    assert_eq!(
        scene.albedo[(30, 30)],
        [0.0; 3].map(|_: f32| scene.albedo[(30, 30)][0])
    );
    assert!(scene.confidence[(30, 30)] < 0.1);
}

#[test]
fn no_picture_is_too_small_or_too_empty() {
    for (width, height) in [(1, 1), (1, 7), (7, 1), (2, 2), (3, 5)] {
        for depth in [1.0, f32::NAN] {
            for light in [0.5, f32::NAN, -0.1, 0.0] {
                let scene = scene_of(
                    Plane::filled(width, height, [light; 3]),
                    Plane::filled(width, height, depth),
                    0.01,
                );
                let valid = scene
                    .confidence
                    .samples()
                    .iter()
                    .all(|c| (0.0..=1.0).contains(c));
                assert!(valid, "{width}×{height}, depth {depth}, light {light}");
                let facing = |n: &Vec3| depth.is_nan() == n.is_nan();
                assert!(scene.normal.samples().iter().all(facing));
            }
        }
    }
}

#[test]
fn a_flash_of_unknown_strength_gives_albedo_up_to_one_scale() {
    let truth = ball_before_wall();
    let mut rig = rig(SIDE, SIDE);
    rig.flash.intensity = None;
    let depth = registered(truth.metres, 1e-3);
    let light = truth.light.map(|v| v.map(|c| 0.01 * c));
    let mut flash = flash_only(light);
    flash.variance = flash.variance.map(|_| 1e-10);
    let scene = estimate(&flash, &depth, &rig, &SceneOptions::default()).unwrap();
    assert!(!scene.scale_known);
    // The wall, of 0.6, is the brightest surface and is taken for white paint.
    let wall = scene.albedo[(5, 5)][0];
    let ball = scene.albedo[(64, 50)][1];
    assert!((wall - 0.8).abs() < 0.06, "{wall}");
    assert!((ball / wall - 0.5).abs() < 0.06, "{ball} / {wall}");
}

#[test]
fn planes_that_do_not_fit_are_named() {
    let light = || flash_only(Plane::filled(8, 8, [0.5; 3]));
    let options = SceneOptions::default();
    let depth = registered(Plane::filled(8, 7, 1.0), 0.01);
    let error = estimate(&light(), &depth, &rig(8, 8), &options).unwrap_err();
    assert!(
        matches!(error, SceneError::SizeMismatch { found: (8, 7), .. }),
        "{error}"
    );

    let depth = registered(Plane::filled(8, 8, 1.0), 0.01);
    let error = estimate(&light(), &depth, &rig(16, 8), &options).unwrap_err();
    assert!(matches!(error, SceneError::Shape { .. }), "{error}");

    let mut dark = rig(8, 8);
    dark.flash.intensity = Some(0.0);
    let error = estimate(&light(), &depth, &dark, &options).unwrap_err();
    assert!(
        matches!(
            error,
            SceneError::Range {
                field: "flash.intensity",
                ..
            }
        ),
        "{error}"
    );
}
