//! Real capture folders are read; what stands in them is what their makers wrote.

use captured::folder;
use drivers::Pixels;
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
