//! Real capture folders are read; what stands in them is what their makers wrote.

use captured::{
    folder,
    shot::{Assembler, Limits, Shot},
};
use drivers::{
    BayerPattern, ColorFrame, DepthCamera, DepthFrame, Distortion, Exposure, FlashLamp,
    Illumination, Intrinsics, Pixels, Plane, Rig, RigidTransform, Timestamp, Transfer,
    recording::Reader,
};
use glam::{DMat3, DVec3};
use std::path::PathBuf;

/// The folder of real captures, or `None` with a printed reason.
fn data() -> Option<PathBuf> {
    let dir = std::env::var_os("CAPTURED_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    if dir.is_dir() {
        return Some(dir);
    }
    eprintln!(
        "skipped: no real captures at {} (set CAPTURED_DATA)",
        dir.display()
    );
    None
}

#[test]
fn every_real_capture_is_read_with_its_truth() {
    let Some(data) = data() else { return };
    let mut read = 0;
    for entry in std::fs::read_dir(data).unwrap() {
        let dir = entry.unwrap().path();
        if !dir.join("capture.toml").exists() {
            continue;
        }
        let capture = folder::read(&dir).unwrap_or_else(|error| panic!("{error}"));
        let shot = &capture.shot;
        assert_eq!(
            shot.flash.pixels.size(),
            shot.rig.color.size(),
            "{}",
            capture.name
        );
        let known = shot
            .depth
            .metres
            .samples()
            .iter()
            .filter(|m| m.is_finite())
            .count();
        assert!(
            known * 10 > shot.depth.metres.len(),
            "{}: {known} depths",
            capture.name
        );
        if let Some(truth) = &capture.truth {
            for light in &truth.lights {
                let (relit, _) = light.load().unwrap();
                assert!(relit.0.samples().iter().all(|rgb| rgb[0] >= 0.0));
                assert!(
                    light.toward_light().z < 0.0,
                    "every light stands before the scene"
                );
            }
            if let Some(normal) = truth.normal().unwrap() {
                let facing = normal.samples().iter().filter(|n| n.is_finite());
                assert!(facing.clone().count() > 1000);
                assert!(facing.clone().all(|n| (n.length() - 1.0).abs() < 1e-4));
                let toward = facing.clone().filter(|n| n.z < 0.0).count();
                assert!(
                    toward * 100 > facing.count() * 99,
                    "normals face the camera"
                );
            }
            truth.registered_depth().unwrap();
        }
        read += 1;
    }
    assert!(read >= 6, "only {read} captures were there");
}

#[test]
fn the_azure_kinect_capture_has_the_sizes_and_units_of_its_maker() {
    let Some(data) = data() else { return };
    let capture = folder::read(&data.join("azure_kinect")).unwrap();
    let shot = capture.shot;
    assert!(matches!(shot.flash.pixels, Pixels::Rgb8(_)));
    assert_eq!(shot.rig.color.size(), (1280, 720));
    assert_eq!(shot.depth.metres.size(), (640, 576));
    assert_eq!(shot.depth.amplitude.unwrap().size(), (640, 576));
    let truth = capture.truth.unwrap();
    assert!(truth.lights.is_empty());
    let registered = truth.registered_depth().unwrap().unwrap();
    assert_eq!(registered.size(), (1280, 720));
    let farthest = registered
        .samples()
        .iter()
        .copied()
        .filter(|m| m.is_finite())
        .fold(0.0, f32::max);
    assert!(
        (0.5..10.0).contains(&farthest),
        "{farthest} is not a room in metres"
    );
}

fn lens(width: usize, height: usize) -> Intrinsics {
    let distortion = Distortion::BrownConrady {
        k1: 0.1,
        k2: -0.02,
        p1: 1e-3,
        p2: -1e-3,
        k3: 0.0,
    };
    Intrinsics {
        width,
        height,
        fx: 30.0,
        fy: 31.5,
        cx: 11.25,
        cy: 7.5,
        distortion,
    }
}

fn color(light: Illumination, at: u64, pixels: Pixels) -> ColorFrame {
    ColorFrame {
        at: Timestamp::from_nanos(at),
        sequence: at,
        light,
        exposure: Exposure {
            seconds: 0.01,
            gain: 2.0,
        },
        pixels,
        transfer: Transfer::Srgb,
        black_level: 0.0,
        white_level: 1.0,
    }
}

/// A shot that uses every part a folder has; the flash adds light everywhere.
fn shot() -> Shot {
    let picture = |bright: u8| {
        Pixels::Rgb8(Plane::from_fn(24, 16, |x, y| {
            [x as u8 + bright, y as u8 + bright, bright]
        }))
    };
    let mut metres = Plane::from_fn(12, 8, |x, y| 1.0 + (x + y) as f32 / 7.0);
    metres[(3, 3)] = f32::NAN;
    Shot {
        flash: color(Illumination::Flash, 1, picture(150)),
        ambient: vec![color(Illumination::Ambient, 0, picture(40))],
        depth: DepthFrame {
            at: Timestamp::from_nanos(1),
            sequence: 0,
            metres,
            amplitude: Some(Plane::filled(12, 8, 12.5)),
            sigma: None,
        },
        rig: Rig {
            color: lens(24, 16),
            depth: Some(DepthCamera {
                lens: lens(12, 8),
                to_color: RigidTransform {
                    rotation: DMat3::from_rotation_y(0.1) * DMat3::from_rotation_x(-0.05),
                    translation_metres: DVec3::new(0.03, -0.01, 0.0),
                },
            }),
            flash: FlashLamp {
                position_metres: DVec3::new(0.02, 0.0, 0.0),
                intensity: Some(475.0),
                beam: drivers::Beam::default(),
            },
        },
        mask: Some(Plane::from_fn(24, 16, |x, _| x > 3)),
    }
}

fn same_plane(one: &Plane<f32>, other: &Plane<f32>) -> bool {
    one.size() == other.size()
        && one
            .samples()
            .iter()
            .zip(other.samples())
            .all(|(a, b)| a == b || a.is_nan() && b.is_nan())
}

fn assert_same(found: &Shot, expected: &Shot) {
    assert_eq!(found.flash, expected.flash);
    assert_eq!(found.ambient, expected.ambient);
    assert!(same_plane(&found.depth.metres, &expected.depth.metres));
    assert_eq!(found.depth.amplitude, expected.depth.amplitude);
    assert_eq!(found.rig.color, expected.rig.color);
    let (found_camera, camera) = (found.rig.depth.unwrap(), expected.rig.depth.unwrap());
    assert_eq!(found_camera.lens, camera.lens);
    let moved = found_camera.to_color.rotation - camera.to_color.rotation;
    assert!(
        moved
            .to_cols_array()
            .iter()
            .all(|value| value.abs() < 1e-14),
        "{moved:?}"
    );
    let ratio = found.rig.flash.intensity.unwrap() / expected.rig.flash.intensity.unwrap();
    assert!((ratio - 1.0).abs() < 1e-6);
}

#[test]
fn a_written_folder_reads_back_as_the_same_shot() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("desk");
    let shot = shot();
    folder::write(&out, &shot).unwrap();
    let capture = folder::read(&out).unwrap();
    assert_eq!(capture.name, "desk");
    assert!(capture.truth.is_none());
    assert_same(&capture.shot, &shot);
    assert_eq!(capture.shot.mask, shot.mask);
    let refused = folder::write(&out, &shot).unwrap_err().to_string();
    assert!(
        refused.contains("desk") && refused.contains("already exists"),
        "{refused}"
    );
}

#[test]
fn raw_pictures_are_kept_as_the_light_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("raw");
    let mut shot = shot();
    let samples = Plane::filled(24, 16, 16_384_u16);
    shot.flash.pixels = Pixels::Bayer {
        samples,
        pattern: BayerPattern::Rggb,
    };
    shot.flash.transfer = Transfer::Linear;
    folder::write(&out, &shot).unwrap();
    let back = folder::read(&out).unwrap().shot;
    for (found, expected) in [
        (&back.flash, &shot.flash),
        (&back.ambient[0], &shot.ambient[0]),
    ] {
        let [found, expected] =
            [found, expected].map(|frame| captured::radiometry::linearise(frame).unwrap().0);
        let pairs = found
            .samples()
            .as_flattened()
            .iter()
            .zip(expected.samples().as_flattened());
        for (found, expected) in pairs {
            assert!(
                (found - expected).abs() <= 1e-5 * expected.abs(),
                "{found} was {expected}"
            );
        }
    }
}

#[test]
fn an_imported_folder_replays_as_the_same_shot_with_its_mask_beside() {
    let dir = tempfile::tempdir().unwrap();
    let (from, to) = (dir.path().join("desk"), dir.path().join("desk.mcap"));
    let shot = shot();
    folder::write(&from, &shot).unwrap();
    let imported = folder::import(&from, &to).unwrap();
    assert_eq!(
        imported.made,
        [to.clone(), dir.path().join("desk.mask.png")]
    );
    let mask = folder::read_mask_beside(&to, (24, 16)).unwrap();
    assert_eq!(mask, shot.mask);

    let reader = Reader::open(&to).unwrap();
    let mut assembler = Assembler::new(*reader.rig(), Limits::default());
    let mut shots: Vec<Shot> = reader
        .filter_map(|frame| assembler.push(frame.unwrap()))
        .collect();
    shots.extend(assembler.finish());
    assert_eq!(shots.len(), 1, "{:?}", assembler.drops());
    assert_same(&shots[0], &shot);
    let again = folder::import(&from, &to).unwrap_err().to_string();
    assert!(again.contains("desk.mcap"), "{again}");
    assert!(Reader::open(&to).is_ok(), "the first import is still there");
}

#[test]
fn a_flash_only_folder_replays_to_the_same_flash_light() {
    let dir = tempfile::tempdir().unwrap();
    let (from, to) = (dir.path().join("desk"), dir.path().join("desk.mcap"));
    let mut shot = shot();
    shot.ambient.clear();
    shot.mask = None;
    folder::write(&from, &shot).unwrap();
    let imported = folder::import(&from, &to).unwrap();
    assert!(
        imported
            .notes
            .iter()
            .any(|note| note.contains("without light"))
    );
    let reader = Reader::open(&to).unwrap();
    let mut assembler = Assembler::new(*reader.rig(), Limits::default());
    let mut shots: Vec<Shot> = reader
        .filter_map(|frame| assembler.push(frame.unwrap()))
        .collect();
    shots.extend(assembler.finish());
    let dark = captured::radiometry::linearise(&shots[0].ambient[0]).unwrap();
    assert!(dark.0.samples().iter().all(|rgb| *rgb == [0.0; 3]));
    assert_eq!(shots[0].flash, shot.flash);
}
