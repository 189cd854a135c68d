//! Normals of real, scanned or photometrically measured objects against their truth.
//!
//! Needs the captures named by `CAPTURED_DATA` (else `../shared/data`); skips without them.

#![expect(
    clippy::print_stdout,
    reason = "a skipped capture and the figures are told to whoever runs it"
)]

use captured::{eval::normal_error, folder, radiometry, registration, scene};
use drivers::Plane;
use std::path::PathBuf;

fn captures() -> PathBuf {
    std::env::var_os("CAPTURED_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    )
}

#[test]
fn normals_of_photographed_objects_stay_near_the_measured_ones() {
    struct Case {
        name: &'static str,
        /// Degrees, mean. The depth is integrated from the very normals, so what is left is the
        /// surface that no depth map holds: rims and, on the owl, normals that no surface has.
        most: f64,
    }
    let cases = [
        Case {
            name: "diligent_bear",
            most: 2.5,
        },
        Case {
            name: "harvard_pig",
            most: 4.0,
        },
        Case {
            name: "uw_owl",
            most: 7.5,
        },
    ];
    for Case { name, most } in cases {
        let dir = captures().join(name);
        if !dir.join("capture.toml").exists() {
            println!(
                "skipped {name}: {} holds no such capture",
                captures().display()
            );
            continue;
        }
        let capture = folder::read(&dir).unwrap();
        let shot = &capture.shot;
        let flash = radiometry::subtract(&shot.flash, &shot.ambient, &Default::default()).unwrap();
        let maps = registration::RigMaps::new(&shot.rig).unwrap();
        let depth = registration::register(&shot.depth, &maps, Some(&flash.light)).unwrap();
        let scene = scene::estimate(&flash, &depth, &shot.rig, &Default::default()).unwrap();
        let truth = capture.truth.unwrap().normal().unwrap().unwrap();
        let (width, height) = truth.size();
        let counts = shot
            .mask
            .clone()
            .unwrap_or_else(|| Plane::filled(width, height, true));
        let error = normal_error(&scene.normal, &truth, &counts)
            .unwrap()
            .unwrap();
        println!(
            "{name}: mean {:.2}°, median {:.2}°, {} pixels, {} unanswered",
            error.mean_degrees, error.median_degrees, error.pixels, error.unanswered
        );
        assert!(
            error.mean_degrees < most,
            "{name}: {:.2}°",
            error.mean_degrees
        );
        assert!(
            error.unanswered * 100 < error.pixels,
            "{name}: {} unanswered",
            error.unanswered
        );
    }
}
