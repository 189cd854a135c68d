//! Rigs that are known, photographed by a renderer of this test, and calibrated.
//!
//! The board is the picture that OpenCV draws (`config/board.png`); the renderer shares no code with
//! what it tests: it bends rays by a fixed-point iteration of its own and integrates every pixel.

use captured::{
    calibration::{Board, Calibration, CalibrationError, Corner, calibrate, find_corners},
    shot::Shot,
};
use drivers::{
    Beam, ColorFrame, DepthCamera, DepthFrame, Distortion, Exposure, FlashLamp, Illumination,
    Intrinsics, Pixels, Plane, Rig, RigidTransform, Timestamp, Transfer, chance::Chance,
};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;
use std::{path::Path, process::Command, sync::OnceLock};

const SQUARE: f64 = 0.06;
const PAPER: f64 = 0.88;
const INK: f64 = 0.04;

/// What is true of the rig.
struct Truth {
    rig: Rig,
    /// What the depth camera adds to every distance.
    offset_metres: f64,
}

fn truth() -> Truth {
    let color = Intrinsics {
        width: 800,
        height: 600,
        fx: 655.0,
        fy: 652.0,
        cx: 407.3,
        cy: 293.8,
        distortion: Distortion::BrownConrady {
            k1: -0.12,
            k2: 0.05,
            p1: 0.0008,
            p2: -0.0005,
            k3: 0.0,
        },
    };
    let depth = Intrinsics {
        width: 320,
        height: 240,
        fx: 270.0,
        fy: 271.0,
        cx: 161.2,
        cy: 117.4,
        distortion: Distortion::BrownConrady {
            k1: -0.08,
            k2: 0.02,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        },
    };
    Truth {
        rig: Rig {
            color,
            depth: Some(DepthCamera {
                lens: depth,
                to_color: RigidTransform {
                    rotation: turned(0.01, -0.02, 0.005),
                    translation_metres: DVec3::new(-0.031, 0.004, 0.002),
                },
            }),
            flash: FlashLamp {
                position_metres: DVec3::new(0.024, -0.017, -0.003),
                intensity: Some(0.35),
                beam: Beam {
                    tilt: [0.06, -0.04],
                    falloff: -0.35,
                },
            },
        },
        offset_metres: 0.013,
    }
}

fn turned(x: f64, y: f64, z: f64) -> DMat3 {
    DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(x, y, z)))
}

/// The board as OpenCV draws it: true = paper.
fn print() -> Plane<bool> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/board.png");
    let picture = image::open(path).unwrap().to_luma8();
    Plane::from_fn(
        picture.width() as usize,
        picture.height() as usize,
        |x, y| picture.get_pixel(x as u32, y as u32).0[0] > 127,
    )
}

/// Poses of the board's middle in color axes: distances 0.45 to 1.1 m, tilted and turned.
fn poses(count: u64) -> Vec<RigidTransform> {
    let chance = Chance::new(21);
    (0..count)
        .map(|k| {
            let even = |kind: u64, reach: f64| reach * (2.0 * chance.of(kind).unit(k) - 1.0);
            let far = 0.62 + 0.42 * chance.of(1).unit(k);
            let rotation = turned(even(2, 0.6), even(3, 0.6), even(4, 0.4));
            let middle = DVec3::new(even(5, 0.22) * far, even(6, 0.16) * far, far);
            let centre = DVec3::new(4.5 * SQUARE, 3.0 * SQUARE, 0.0);
            RigidTransform {
                rotation,
                translation_metres: middle - rotation * centre,
            }
        })
        .collect()
}

/// Where a camera's lens sees a pixel: the bend undone by fixed-point iteration.
fn straight(lens: &Intrinsics, x: f64, y: f64) -> DVec3 {
    let Distortion::BrownConrady { k1, k2, p1, p2, .. } = lens.distortion else {
        unreachable!("the lenses of this test are bent");
    };
    let bent = DVec2::new((x - lens.cx) / lens.fx, (y - lens.cy) / lens.fy);
    let mut ideal = bent;
    for _ in 0..12 {
        let (u, v) = (ideal.x, ideal.y);
        let r2 = u * u + v * v;
        let radial = 1.0 + k1 * r2 + k2 * r2 * r2;
        let tangential = DVec2::new(
            2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u),
            p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v,
        );
        ideal = (bent - tangential) / radial;
    }
    ideal.extend(1.0)
}

struct Hit {
    point: DVec3,
    albedo: f64,
    /// Towards the cameras.
    normal: DVec3,
}

/// What a ray meets: the board, or a gray wall that faces the cameras 1.6 m away.
fn trace(ray: DVec3, pose: &RigidTransform, print: &Plane<bool>) -> Hit {
    let normal = pose.rotation * DVec3::Z;
    let far = normal.dot(pose.translation_metres) / normal.dot(ray);
    if far > 0.0 {
        let point = ray * far;
        let place = pose.rotation.transpose() * (point - pose.translation_metres) / SQUARE;
        // Half a square of white margin around, as any printer leaves.
        let inside = (-0.5..9.5).contains(&place.x) && (-0.5..6.5).contains(&place.y);
        if inside {
            let texel = |at: f64| (at * 32.0).floor();
            let (x, y) = (texel(place.x), texel(place.y));
            let within = x >= 0.0 && y >= 0.0;
            let paper = !within || *print.get(x as usize, y as usize).unwrap_or(&true);
            return Hit {
                point,
                albedo: if paper { PAPER } else { INK },
                normal: -normal,
            };
        }
    }
    Hit {
        point: ray * 1.6,
        albedo: 0.3,
        normal: DVec3::NEG_Z,
    }
}

fn flash_light(lamp: &FlashLamp, hit: &Hit) -> f64 {
    let way = hit.point - lamp.position_metres;
    let cosine = (-hit.normal.dot(way) / way.length()).max(0.0);
    let (u, v) = (way.x / way.z, way.y / way.z);
    let [right, down] = lamp.beam.tilt;
    let beam = (right * u + down * v + lamp.beam.falloff * (u * u + v * v)).exp();
    f64::from(lamp.intensity.unwrap()) * beam * hit.albedo * cosine / way.length_squared()
}

/// Mean of `value` over 4×4 rays of a pixel.
fn over_pixel(lens: &Intrinsics, x: usize, y: usize, value: impl Fn(DVec3) -> f64) -> f64 {
    let mut sum = 0.0;
    for dy in 0..4 {
        for dx in 0..4 {
            let off = |k: i32| (f64::from(k) - 1.5) / 4.0;
            sum += value(straight(lens, x as f64 + off(dx), y as f64 + off(dy)));
        }
    }
    sum / 16.0
}

fn picture(
    lens: &Intrinsics,
    chance: Chance,
    noise: f64,
    value: impl Fn(DVec3) -> f64 + Sync,
) -> Plane<f32> {
    let (width, height) = lens.size();
    let rows: Vec<Vec<f32>> = (0..height)
        .into_par_iter()
        .map(|y| {
            let pixel = |x: usize| {
                let light = over_pixel(lens, x, y, &value);
                let scatter = noise * light.max(0.0).sqrt();
                let normal = f64::from(chance.normal((y * width + x) as u64));
                (light + scatter * normal) as f32
            };
            (0..width).map(pixel).collect()
        })
        .collect();
    Plane::new(width, height, rows.concat()).unwrap()
}

fn color_frame(light: Illumination, sequence: u64, picture: &Plane<f32>) -> ColorFrame {
    ColorFrame {
        at: Timestamp::from_nanos(1_000_000_000 + 33_000_000 * sequence),
        sequence,
        light,
        exposure: Exposure::UNIT,
        // A 16-bit picture of unit exposure.
        pixels: Pixels::Rgb16(picture.map(|v| [(v.clamp(0.0, 1.0) * 65535.0).round() as u16; 3])),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    }
}

fn shot(truth: &Truth, pose: &RigidTransform, print: &Plane<bool>, k: u64) -> Shot {
    let chance = Chance::new(5).of(k);
    let rig = &truth.rig;
    let camera = rig.depth.unwrap();
    let ambient = |ray: DVec3| {
        let hit = trace(ray, pose, print);
        hit.albedo * (0.05 + 0.05 * hit.normal.dot(DVec3::new(-0.5, -0.6, -0.62)).max(0.0))
    };
    let lit = |ray: DVec3| ambient(ray) + flash_light(&rig.flash, &trace(ray, pose, print));
    // The board as the depth camera has it.
    let back = camera.to_color.rotation.transpose();
    let seen = RigidTransform {
        rotation: back * pose.rotation,
        translation_metres: back * (pose.translation_metres - camera.to_color.translation_metres),
    };
    let infrared = |ray: DVec3| {
        let hit = trace(ray, &seen, print);
        hit.albedo * hit.normal.dot(-hit.point.normalize()).max(0.0) / hit.point.length_squared()
    };
    let (width, height) = camera.lens.size();
    let metres = Plane::from_fn(width, height, |x, y| {
        let hit = trace(straight(&camera.lens, x as f64, y as f64), &seen, print);
        let noise = 0.003 * f64::from(chance.of(9).normal((y * width + x) as u64));
        (hit.point.z + truth.offset_metres + noise) as f32
    });
    Shot {
        flash: color_frame(
            Illumination::Flash,
            1,
            &picture(&rig.color, chance.of(1), 0.004, lit),
        ),
        ambient: vec![color_frame(
            Illumination::Ambient,
            0,
            &picture(&rig.color, chance.of(2), 0.004, ambient),
        )],
        depth: DepthFrame {
            at: Timestamp::from_nanos(1_035_000_000),
            sequence: 1,
            metres,
            amplitude: Some(picture(&camera.lens, chance.of(3), 0.02, infrared)),
            sigma: None,
        },
        // What a device says of itself before anybody has measured: wrong, but of the right sizes.
        rig: Rig {
            color: Intrinsics {
                fx: 800.0,
                fy: 800.0,
                cx: 399.5,
                cy: 299.5,
                distortion: Distortion::None {},
                ..rig.color
            },
            ..*rig
        },
        mask: None,
    }
}

fn board() -> Board {
    Board::new((9, 6), SQUARE, 0.75 * SQUARE).unwrap()
}

/// Fourteen shots, rendered once.
fn shots() -> &'static [Shot] {
    static SHOTS: OnceLock<Vec<Shot>> = OnceLock::new();
    SHOTS.get_or_init(|| {
        let (truth, print) = (truth(), print());
        let poses = poses(14);
        let views = poses.iter().zip(0..);
        views
            .map(|(pose, k)| shot(&truth, pose, &print, k))
            .collect()
    })
}

#[test]
fn half_of_the_corners_are_found_to_a_fifth_of_a_pixel_and_nine_of_ten_to_a_whole_one() {
    let truth = truth();
    let camera = truth.rig.depth.unwrap();
    for ((k, pose), shot) in poses(4).iter().enumerate().zip(shots()) {
        let Pixels::Rgb16(flash) = &shot.flash.pixels else {
            unreachable!("this test's own frames");
        };
        let back = camera.to_color.rotation.transpose();
        let in_depth = |p: DVec3| back * (p - camera.to_color.translation_metres);
        for (lens, picture, limit, to_camera) in [
            (
                truth.rig.color,
                flash.map(|rgb| f32::from(rgb[0])),
                0.125,
                &(|p| p) as &dyn Fn(DVec3) -> DVec3,
            ),
            (
                camera.lens,
                shot.depth.amplitude.clone().unwrap(),
                0.2,
                &in_depth,
            ),
        ] {
            let found = find_corners(&picture, &board());
            assert!(found.len() >= 30, "{} corners in view {k}", found.len());
            let off = |corner: &Corner| {
                let point = to_camera(pose.apply(board().corner(corner.id)));
                lens.project(point).unwrap().distance(corner.pixel)
            };
            let mut off: Vec<f64> = found.iter().map(off).collect();
            off.sort_by(f64::total_cmp);
            // A corner that noise led astray is what the calibration's robust loss is for.
            let near = off.iter().filter(|pixels| **pixels < 1.0).count();
            assert!(10 * near >= 9 * off.len(), "{off:?} in view {k}");
            let middle = off[off.len() / 2];
            assert!(
                middle < limit,
                "{middle} pixels in view {k} of {}",
                lens.width
            );
        }
    }
}

#[test]
fn a_rig_comes_back_from_fourteen_shots_of_the_board() {
    let truth = truth();
    let found: Calibration = calibrate(shots(), &board(), PAPER).unwrap();
    let (color, known) = (found.rig.color, truth.rig.color);
    assert!(found.color.rms_pixels < 0.15, "{:?}", found.color);
    for (name, value, true_value, limit) in [
        ("fx", color.fx, known.fx, 1.0),
        ("fy", color.fy, known.fy, 1.0),
        ("cx", color.cx, known.cx, 2.0),
        ("cy", color.cy, known.cy, 2.0),
    ] {
        assert!(
            (value - true_value).abs() < limit,
            "{name} {value}, truly {true_value}"
        );
    }
    // What counts of the distortion is where it puts things; a centre that is off turns all poses along.
    for (x, y) in [(0.0, 0.0), (0.35, 0.25), (-0.5, 0.3), (0.5, -0.35)] {
        let point = DVec3::new(x, y, 1.0);
        let off = color
            .project(point)
            .unwrap()
            .distance(known.project(point).unwrap());
        assert!(off < 2.0, "({x}, {y}) is off by {off} pixels");
    }
    let (camera, fit) = (found.rig.depth.unwrap(), found.depth.unwrap());
    let step = truth.rig.depth.unwrap().to_color;
    let off = camera
        .to_color
        .translation_metres
        .distance(step.translation_metres);
    assert!(off < 0.002, "the depth camera is off by {off} m");
    let turned = camera.to_color.rotation.transpose() * step.rotation;
    let angle = DQuat::from_mat3(&turned).to_scaled_axis().length();
    assert!(angle < 0.002, "the depth camera is turned by {angle}");
    assert!(fit.lens.rms_pixels < 0.3, "{:?}", fit.lens);
    let range = fit.range;
    assert!(
        (range.offset_metres - truth.offset_metres).abs() < 0.0015,
        "{range:?}"
    );

    let (lamp, known) = (found.rig.flash, truth.rig.flash);
    let off = lamp.position_metres.distance(known.position_metres);
    assert!(
        off < 0.004,
        "the flash is off by {off} m: {:?}",
        found.flash
    );
    let (intensity, true_intensity) = (lamp.intensity.unwrap(), known.intensity.unwrap());
    assert!(
        (intensity / true_intensity - 1.0).abs() < 0.02,
        "intensity {intensity}"
    );
    for slope in [
        DVec3::Z,
        DVec3::new(0.5, 0.3, 1.0),
        DVec3::new(-0.4, -0.3, 1.0),
    ] {
        let ratio = lamp.beam.strength(slope) / known.beam.strength(slope);
        assert!(
            (ratio - 1.0).abs() < 0.03,
            "{ratio} toward {slope}: {:?}",
            lamp.beam
        );
    }
    assert!(found.flash.unwrap().rms_fraction < 0.03);
}

#[test]
fn pictures_that_do_not_suffice_are_refused_with_what_is_missing() {
    let shots = shots()[..6].to_vec();
    let refusal = |shots: &[Shot], board: &Board| match calibrate(shots, board, PAPER) {
        Err(error) => error.to_string(),
        Ok(found) => panic!("accepted: {found:?}"),
    };
    assert!(refusal(&[], &board()).contains("no pictures"));
    assert!(refusal(&shots[..2], &board()).contains("in 2 of 2"));
    // A board of another shape: its tags are elsewhere.
    let other = Board::new((7, 8), SQUARE, 0.75 * SQUARE).unwrap();
    assert!(refusal(&shots, &other).contains("board"), "another board");
    // Depth pictures of other poses.
    let mut mixed = shots.clone();
    let depths: Vec<DepthFrame> = mixed.iter().map(|shot| shot.depth.clone()).collect();
    for (k, shot) in mixed.iter_mut().enumerate() {
        shot.depth = depths[(k + 1) % depths.len()].clone();
    }
    assert!(refusal(&mixed, &board()).contains("same poses"), "shuffled");
    // A picture of another size.
    let mut foreign = shots.clone();
    foreign[3].depth.metres = Plane::filled(8, 8, 1.0);
    assert!(
        refusal(&foreign, &board()).contains("view 4"),
        "another size"
    );
    // Noise, darkness, unknown pixels: no board, no panic.
    for value in [0.0, 1.0, f32::NAN, f32::INFINITY] {
        assert!(find_corners(&Plane::filled(320, 240, value), &board()).is_empty());
    }
    let noise = Chance::new(3);
    let grain = Plane::from_fn(320, 240, |x, y| noise.unit((y * 320 + x) as u64) as f32);
    assert!(find_corners(&grain, &board()).is_empty());
    assert!(find_corners(&Plane::filled(3, 2, 0.5), &board()).is_empty());
    assert!(matches!(
        Board::new((9, 6), SQUARE, SQUARE),
        Err(CalibrationError::Board { .. })
    ));
}

#[test]
fn the_command_reads_capture_folders_and_writes_a_rig_that_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec![
        "calibrate".to_owned(),
        "rig".to_owned(),
        "--json".to_owned(),
    ];
    for (k, shot) in shots().iter().enumerate() {
        let name = format!("pose_{k:02}");
        captured::folder::write(&folder.path().join(&name), shot).unwrap();
        arguments.push(name);
    }
    arguments.extend(["--square", "0.06", "--out", "rig.toml"].map(str::to_owned));
    let run = |arguments: &[String]| {
        Command::new(env!("CARGO_BIN_EXE_capturectl"))
            .current_dir(folder.path())
            .args(arguments)
            .output()
            .unwrap()
    };
    let output = run(&arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let rms = json["calibration"]["color"]["rms_pixels"].as_f64().unwrap();
    assert!(rms < 0.15, "{rms}");
    let file = captured::folder::RigFile::read(&folder.path().join("rig.toml")).unwrap();
    let known = truth();
    assert!(
        (file.rig.color.fx - known.rig.color.fx).abs() < 1.0,
        "{}",
        file.rig.color.fx
    );
    assert!((file.depth_offset_metres - known.offset_metres).abs() < 0.0015);
    // The folder states exposures of one second at base gain; so does a rig.
    let intensity = file.rig.flash.intensity.unwrap() / known.rig.flash.intensity.unwrap();
    assert!((intensity - 1.0).abs() < 0.02, "{intensity}");

    for (wrong, code, word) in [
        (
            vec!["calibrate", "rig", "pose_00", "pose_01", "--square", "0.06"],
            2,
            "too few",
        ),
        (
            vec![
                "calibrate",
                "rig",
                "pose_00",
                "pose_01",
                "pose_02",
                "pose_03",
                "--square",
                "0.06",
                "--paper",
                "7",
            ],
            2,
            "albedo",
        ),
        (
            vec![
                "calibrate",
                "rig",
                "pose_00",
                "pose_01",
                "pose_02",
                "pose_03",
                "--square",
                "60",
            ],
            3,
            "squares of 60",
        ),
        (
            vec![
                "calibrate",
                "rig",
                "pose_00",
                "pose_01",
                "pose_02",
                "absent",
                "--square",
                "0.06",
            ],
            3,
            "absent",
        ),
        (
            vec![
                "calibrate",
                "rig",
                "pose_00",
                "pose_01",
                "pose_02",
                "pose_03",
                "--square",
                "0.06",
                "--squares",
                "9",
            ],
            2,
            "9x6",
        ),
    ] {
        let wrong: Vec<String> = wrong.into_iter().map(str::to_owned).collect();
        let output = run(&wrong);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(word), "{word}: {said}");
    }
}
