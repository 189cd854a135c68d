//! Laws of registration, on scenes whose answer is known in closed form.

use captured::registration::{RegisteredDepth, RegistrationError, RigMaps, register};
use drivers::{
    DepthCamera, DepthFrame, Distortion, FlashLamp, Intrinsics, Plane, Rig, RigidTransform,
    Timestamp,
};
use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

const BROWN: Distortion = Distortion::BrownConrady {
    k1: 0.12,
    k2: -0.25,
    p1: 0.0008,
    p2: -0.0005,
    k3: 0.08,
};
const RATIONAL: Distortion = Distortion::Rational {
    k1: 0.55,
    k2: -0.02,
    p1: 0.00002,
    p2: -0.00007,
    k3: -0.0027,
    k4: 0.89,
    k5: 0.086,
    k6: -0.014,
};

fn lens(width: usize, height: usize, focal: f64, distortion: Distortion) -> Intrinsics {
    Intrinsics {
        width,
        height,
        fx: focal,
        fy: focal * 1.01,
        cx: 0.5 * width as f64 - 1.2,
        cy: 0.5 * height as f64 + 0.7,
        distortion,
    }
}

fn rig(color: Intrinsics, depth: Intrinsics, turn: DVec3, shift: DVec3) -> Rig {
    let rotation = DMat3::from_rotation_x(turn.x)
        * DMat3::from_rotation_y(turn.y)
        * DMat3::from_rotation_z(turn.z);
    Rig {
        color,
        depth: Some(DepthCamera {
            lens: depth,
            to_color: RigidTransform {
                rotation,
                translation_metres: shift,
            },
        }),
        flash: FlashLamp {
            position_metres: DVec3::ZERO,
            intensity: None,
            beam: drivers::Beam::default(),
        },
    }
}

fn frame(metres: Plane<f32>) -> DepthFrame {
    DepthFrame {
        at: Timestamp::from_nanos(0),
        sequence: 0,
        metres,
        amplitude: None,
        sigma: None,
    }
}

/// A plane `normal · P = offset` in color axes.
#[derive(Clone, Copy)]
struct Wall {
    normal: DVec3,
    offset: f64,
}

impl Wall {
    /// Ray parameter where `origin + s · ray` meets it.
    fn meets(&self, origin: DVec3, ray: DVec3) -> f64 {
        (self.offset - self.normal.dot(origin)) / self.normal.dot(ray)
    }

    fn seen_by_depth_camera(&self, rig: &Rig) -> Plane<f32> {
        let camera = rig.depth.unwrap();
        Plane::from_fn(camera.lens.width, camera.lens.height, |x, y| {
            let Some(ray) = camera.lens.ray(DVec2::new(x as f64, y as f64)) else {
                return f32::NAN;
            };
            self.meets(
                camera.to_color.translation_metres,
                camera.to_color.rotation * ray,
            ) as f32
        })
    }

    fn seen_by_color_camera(&self, rig: &Rig, x: usize, y: usize) -> f32 {
        let ray = rig.color.ray(DVec2::new(x as f64, y as f64)).unwrap();
        self.meets(DVec3::ZERO, ray) as f32
    }
}

fn measured_share(depth: &RegisteredDepth) -> f32 {
    depth.measured.samples().iter().filter(|m| **m).count() as f32 / depth.measured.len() as f32
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn undistorting_undoes_distorting(x in -0.55..0.55f64, y in -0.45..0.45f64) {
        for model in [BROWN, RATIONAL, Distortion::None {}] {
            let ideal = DVec2::new(x, y);
            let back = model.undistort(model.distort(ideal)).unwrap();
            prop_assert!(back.distance(ideal) < 1e-9);
        }
    }

    #[test]
    fn projecting_undoes_the_ray(x in 0.0..319.0f64, y in 0.0..239.0f64, z in 0.1..8.0f64) {
        for model in [BROWN, RATIONAL, Distortion::None {}] {
            let lens = lens(320, 240, 300.0, model);
            let pixel = DVec2::new(x, y);
            let back = lens.project(lens.ray(pixel).unwrap() * z).unwrap();
            prop_assert!(back.distance(pixel) < 1e-6);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_wall_registers_to_its_analytic_depth(
        tilt_x in -0.7..0.7f64, tilt_y in -0.7..0.7f64, offset in 0.6..3.0f64,
        turn in -0.06..0.06f64, shift in -0.05..0.05f64,
        brown in any::<bool>(),
    ) {
        let (one, other) = if brown { (BROWN, RATIONAL) } else { (RATIONAL, BROWN) };
        let rig = rig(
            lens(160, 120, 150.0, one),
            lens(120, 100, 90.0, other),
            DVec3::new(turn, -0.5 * turn, 0.3 * turn),
            DVec3::new(shift, 0.3 * shift, 0.1 * shift),
        );
        let wall = Wall { normal: DVec3::new(tilt_x, tilt_y, 1.0).normalize(), offset };
        let depth = register(
            &frame(wall.seen_by_depth_camera(&rig)), &RigMaps::new(&rig).unwrap(), None,
        ).unwrap();
        prop_assert!(measured_share(&depth) > 0.6);
        for y in 0..120 {
            for x in 0..160 {
                if depth.measured[(x, y)] {
                    let truth = wall.seen_by_color_camera(&rig, x, y);
                    // Inverse depth is linear in the undistorted picture; what is left is the
                    // bend of the lens within one sample.
                    prop_assert!((depth.metres[(x, y)] / truth - 1.0).abs() < 1e-3);
                }
            }
        }
    }
}

#[test]
fn a_rig_whose_cameras_are_one_returns_its_input() {
    let color = lens(48, 40, 50.0, RATIONAL);
    let metres = Plane::from_fn(48, 40, |x, y| 1.0 + 0.003 * x as f32 + 0.002 * y as f32);
    let mut same = rig(color, color, DVec3::ZERO, DVec3::ZERO);
    for on_color_grid in [false, true] {
        if on_color_grid {
            same.depth = None;
        }
        let depth = register(&frame(metres.clone()), &RigMaps::new(&same).unwrap(), None).unwrap();
        assert_eq!(depth.metres, metres);
        assert!(depth.measured.samples().iter().all(|m| *m));
        assert!(depth.sigma_metres.samples().iter().all(|s| *s > 0.0));
    }
}

const NEAR_METRES: f32 = 0.6;
const FAR_METRES: f32 = 1.5;

/// A square board before a wall, seen by a depth camera 5 cm to the left of a finer color camera.
fn board_before_wall(is_hole: impl Fn(f64, f64) -> bool + Sync) -> (Rig, RegisteredDepth) {
    let plain = Distortion::None {};
    let rig = rig(
        lens(320, 240, 300.0, plain),
        lens(160, 120, 120.0, plain),
        DVec3::ZERO,
        DVec3::new(-0.05, 0.0, 0.0),
    );
    let camera = rig.depth.unwrap();
    let metres = Plane::from_fn(160, 120, |x, y| {
        let ray = camera.lens.ray(DVec2::new(x as f64, y as f64)).unwrap();
        let point = camera.to_color.apply(ray * f64::from(NEAR_METRES));
        match is_on_board(point) {
            true if is_hole(point.x, point.y) => f32::NAN,
            true => NEAR_METRES,
            false => FAR_METRES,
        }
    });
    let depth = register(&frame(metres), &RigMaps::new(&rig).unwrap(), None).unwrap();
    (rig, depth)
}

fn is_on_board(point: DVec3) -> bool {
    point.x.abs() < 0.12 && point.y.abs() < 0.1
}

/// How far inside the board's picture a color pixel is, pixels; negative = outside.
fn inside_board(rig: &Rig, x: usize, y: usize) -> f64 {
    let ray = rig.color.ray(DVec2::new(x as f64, y as f64)).unwrap() * f64::from(NEAR_METRES);
    let per_metre = rig.color.fx / f64::from(NEAR_METRES);
    ((0.12 - ray.x.abs()) * per_metre).min((0.1 - ray.y.abs()) * per_metre)
}

#[test]
fn a_rim_has_no_second_image_and_does_not_bleed() {
    let (rig, depth) = board_before_wall(|_, _| false);
    // Two and a half color pixels per sample: a rim is known to one sample.
    const SAMPLE: f64 = 2.6;
    let mut shadow = 0;
    for y in 0..240 {
        for x in 0..320 {
            let inside = inside_board(&rig, x, y);
            let (metres, measured) = (depth.metres[(x, y)], depth.measured[(x, y)]);
            if measured {
                let expected = if inside > 0.0 {
                    NEAR_METRES
                } else {
                    FAR_METRES
                };
                assert!(
                    inside.abs() < SAMPLE || (metres - expected).abs() < 1e-3,
                    "{x} {y}"
                );
                let nearest = (metres - NEAR_METRES)
                    .abs()
                    .min((metres - FAR_METRES).abs());
                assert!(nearest < 1e-3, "a ramp between the surfaces at {x} {y}");
            } else if inside > SAMPLE {
                panic!("a pinhole at {x} {y}");
            } else if inside < -SAMPLE && !metres.is_nan() {
                shadow += 1;
                assert!(
                    (metres - FAR_METRES).abs() < 1e-3,
                    "shadow filled with foreground {x} {y}"
                );
                assert!(depth.sigma_metres[(x, y)] > 0.0);
            }
        }
    }
    // What only the color camera sees is background, on one side of the board: 5 cm of baseline
    // move the near plane 15 pixels more than the far one, over 100 rows.
    assert!(shadow > 800, "{shadow}");
}

#[test]
fn background_does_not_shine_through_the_holes_of_a_thing() {
    // The depth camera sees wall on the side that parallax carries into this hole.
    let (rig, depth) = board_before_wall(|x, y| x.abs() < 0.112 && y.abs() < 0.04 && x < 0.0);
    for y in 0..240 {
        for x in 0..320 {
            if depth.measured[(x, y)] && inside_board(&rig, x, y) > 2.6 {
                assert!((depth.metres[(x, y)] - NEAR_METRES).abs() < 1e-3, "{x} {y}");
            }
        }
    }
}

#[test]
fn flying_pixels_go_and_steep_planes_stay() {
    let plain = lens(64, 48, 60.0, Distortion::None {});
    let mut rig = rig(plain, plain, DVec3::ZERO, DVec3::ZERO);
    rig.depth = None;
    let maps = RigMaps::new(&rig).unwrap();
    let step = Plane::from_fn(64, 48, |x, _| match x {
        0..=30 => 0.7f32,
        31 => 1.3,
        _ => 2.0,
    });
    let depth = register(&frame(step), &maps, None).unwrap();
    for y in 1..47 {
        assert!(!depth.measured[(31, y)]);
        assert!(depth.measured[(30, y)] && depth.measured[(32, y)]);
        let filled = depth.metres[(31, y)];
        assert!(
            (filled - 2.0).abs() < 1e-3,
            "a rim is filled with one of its sides, not {filled}"
        );
    }
    // A floor 10 cm below the lens: linear in inverse depth.
    let floor = Plane::from_fn(64, 48, |_, y| {
        if y > 30 {
            (0.1 * 60.6 / (y as f64 - plain.cy)) as f32
        } else {
            f32::NAN
        }
    });
    let depth = register(&frame(floor.clone()), &maps, None).unwrap();
    for y in 31..48 {
        for x in 0..64 {
            assert!(depth.measured[(x, y)], "{x} {y} at {} m", floor[(x, y)]);
        }
    }
}

#[test]
fn filled_pixels_are_less_certain_the_farther_they_lie() {
    let plain = lens(200, 60, 200.0, Distortion::None {});
    let mut rig = rig(plain, plain, DVec3::ZERO, DVec3::ZERO);
    rig.depth = None;
    let metres = Plane::from_fn(200, 60, |x, _| {
        if (90..110).contains(&x) {
            f32::NAN
        } else {
            1.0
        }
    });
    let depth = register(&frame(metres), &RigMaps::new(&rig).unwrap(), None).unwrap();
    let sigma = |x| depth.sigma_metres[(x, 30)];
    assert!(sigma(89) < sigma(90) && sigma(90) < sigma(94) && sigma(94) < sigma(99));
    assert!((depth.metres[(99, 30)] - 1.0).abs() < 1e-4 && !depth.measured[(99, 30)]);
}

#[test]
fn what_is_far_from_any_measurement_stays_unknown() {
    let plain = lens(200, 60, 200.0, Distortion::None {});
    let mut rig = rig(plain, plain, DVec3::ZERO, DVec3::ZERO);
    rig.depth = None;
    let metres = Plane::from_fn(200, 60, |x, _| if x < 100 { 1.0 } else { f32::NAN });
    let depth = register(&frame(metres), &RigMaps::new(&rig).unwrap(), None).unwrap();
    assert!(depth.metres[(110, 30)].is_nan() && depth.sigma_metres[(110, 30)].is_nan());
}

#[test]
fn a_frame_without_any_answer_is_refused_with_a_remedy() {
    let plain = lens(32, 24, 30.0, Distortion::None {});
    let rig = rig(plain, plain, DVec3::ZERO, DVec3::X * 0.01);
    let maps = RigMaps::new(&rig).unwrap();
    for nothing in [f32::NAN, 0.0, -1.0, f32::INFINITY] {
        let error = register(&frame(Plane::filled(32, 24, nothing)), &maps, None).unwrap_err();
        assert_eq!(error, RegistrationError::NoDepth);
        assert!(error.to_string().contains("depth.metres"));
    }
}

#[test]
fn a_size_that_contradicts_the_rig_names_the_field() {
    let plain = lens(32, 24, 30.0, Distortion::None {});
    let maps = RigMaps::new(&rig(plain, plain, DVec3::ZERO, DVec3::X * 0.01)).unwrap();
    let wrong = register(&frame(Plane::filled(24, 32, 1.0)), &maps, None).unwrap_err();
    assert!(wrong.to_string().contains("depth.metres is 24×32"));
    let mut half = frame(Plane::filled(32, 24, 1.0));
    half.amplitude = Some(Plane::filled(16, 12, 1.0));
    let wrong = register(&half, &maps, None).unwrap_err();
    assert!(wrong.to_string().contains("depth.amplitude"));
}

#[test]
fn a_rig_that_cannot_be_is_refused_by_field() {
    let plain = lens(32, 24, 30.0, Distortion::None {});
    let good = rig(plain, plain, DVec3::ZERO, DVec3::X * 0.01);
    type Spoil = fn(&mut Rig);
    let cases: [(&str, Spoil); 5] = [
        ("color.fx", |rig| rig.color.fx = 0.0),
        ("depth.lens.width", |rig| {
            rig.depth.as_mut().unwrap().lens.width = 0
        }),
        ("depth.lens.cy", |rig| {
            rig.depth.as_mut().unwrap().lens.cy = f64::NAN
        }),
        ("depth.to_color.rotation", |rig| {
            rig.depth.as_mut().unwrap().to_color.rotation = DMat3::IDENTITY * 1.1;
        }),
        ("depth.to_color.translation_metres", |rig| {
            rig.depth.as_mut().unwrap().to_color.translation_metres.y = f64::INFINITY;
        }),
    ];
    for (field, spoil) in cases {
        let mut bad = good;
        spoil(&mut bad);
        let error = RigMaps::new(&bad).unwrap_err().to_string();
        assert!(error.contains(field), "{error}");
    }
}
