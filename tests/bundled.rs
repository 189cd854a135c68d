//! The bundled recordings: whole, within the contract, full of shots, and beside their truth.

use captured::{
    folder::read_truth,
    shot::{Assembler, Limits, Shot},
};
use drivers::{Settings, contract, open, recording::summarize};
use std::{path::PathBuf, time::Duration};

fn recordings() -> Vec<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/recordings");
    let entries = std::fs::read_dir(folder).expect("tests/recordings is part of the repository");
    let mut found: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "mcap")
        })
        .collect();
    found.sort();
    assert!(found.len() >= 3, "{found:?}");
    found
}

fn shots(path: &PathBuf) -> Vec<Shot> {
    let mut device =
        open(path.to_str().expect("paths of the repository are UTF-8")).expect("opens");
    let mut assembler = Assembler::new(device.rig(), Limits::default());
    let mut stream = device.start(&Settings::default()).expect("starts");
    let frames = std::iter::from_fn(|| stream.next_frame(Duration::ZERO).ok());
    let mut shots: Vec<Shot> = frames.filter_map(|frame| assembler.push(frame)).collect();
    shots.extend(assembler.finish());
    assert_eq!(
        assembler.drops().harmful(),
        0,
        "{path:?}: {:?}",
        assembler.drops()
    );
    shots
}

#[test]
fn every_bundled_recording_is_whole_and_upholds_the_contract() {
    for path in recordings() {
        let summary = summarize(&path).expect("readable");
        assert_eq!(summary.truncated_at, None, "{path:?}");
        let mut device = open(&path.to_string_lossy()).expect("opens");
        let report = contract::check(device.as_mut(), 4, &mut |_| {});
        assert!(report.passed(), "{path:?}: {report:?}");
    }
}

#[test]
fn every_bundled_bracket_becomes_a_shot_with_two_ambient_frames() {
    for path in recordings() {
        let flashes = summarize(&path).expect("readable").flash_frames;
        let shots = shots(&path);
        assert_eq!(shots.len() as u64, flashes, "{path:?}");
        assert!(shots.iter().all(|shot| shot.ambient.len() == 2), "{path:?}");
    }
}

#[test]
fn every_bundled_truth_fits_its_recording() {
    for path in recordings() {
        let size = summarize(&path).expect("readable").color_size;
        let truth = read_truth(&path.with_extension("truth"), size, 0.001)
            .expect("readable")
            .expect("every bundled recording has its truth");
        assert!(truth.scale_known && truth.lights.len() >= 8, "{path:?}");
        let grazing = truth
            .lights
            .iter()
            .filter(|light| light.toward_person[2] <= 0.5)
            .count();
        assert!(
            grazing >= 3,
            "{path:?}: {grazing} lights 60° or more off the axis"
        );
        let depth = truth.depth().expect("readable").expect("there");
        let normal = truth.normal().expect("readable").expect("there");
        let albedo = truth.albedo().expect("readable").expect("there");
        let roughness = truth.roughness().expect("readable").expect("there");
        assert!(roughness.samples().iter().all(|r| (0.0..=1.0).contains(r)));
        for light in &truth.lights {
            let (relit, shadow) = light.load().expect("readable");
            let shadow = shadow.expect("there");
            // In shadow a picture is black; lit and matte it is at least albedo · cosine.
            let toward = light.toward_light();
            for place in 0..depth.len() {
                assert!(depth.samples()[place] > 0.0);
                let value = relit.0.samples()[place][1];
                if shadow.samples()[place] < 0.5 {
                    assert_eq!(value, 0.0, "{path:?}");
                } else {
                    let cosine = normal.samples()[place].dot(toward);
                    let diffuse = albedo.0.samples()[place][1] * cosine;
                    // Two pictures of 8 bits, and half floats at a grazing angle.
                    assert!(value > diffuse - 0.012, "{path:?}: {value} under {diffuse}");
                }
            }
        }
    }
}
