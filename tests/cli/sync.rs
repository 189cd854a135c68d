//! `sync-report`.

use super::{capturectl, recording};

#[test]
fn a_report_of_a_recording_has_numbers_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let ran = capturectl(
        folder.path(),
        &[
            "sync-report",
            desk.to_str().unwrap(),
            "--json",
            "--out",
            "desk.png",
        ],
    );
    let json = ran.succeeds().json();
    let timing = &json["timing"];
    assert!(timing["color"]["frames"].as_u64().unwrap() >= 3, "{json:#}");
    // The synthetic rig that made it runs at 30 frames a second.
    let period = timing["color"]["period_ms"].as_f64().unwrap();
    assert!((period - 1000.0 / 30.0).abs() < 1.0, "{period}");
    // Recordings hold no times of arrival.
    assert!(timing["color"]["delay"].is_null(), "{json:#}");
    assert!(timing["depth_offset"]["median_ms"].is_number(), "{json:#}");
    let picture = image::open(folder.path().join("desk.png")).unwrap();
    assert_eq!(picture.width(), 1000);
}

#[test]
fn a_device_that_loses_frames_is_reported_and_one_that_is_not_there_refused() {
    let folder = tempfile::tempdir().unwrap();
    let device = "flaky:drop=0.1,jitter=0.001,seed=4:synthetic:desk?width=32&depth_width=16";
    let ran = capturectl(
        folder.path(),
        &["sync-report", device, "--frames", "400", "--json"],
    );
    let json = ran.succeeds().json();
    let color = &json["timing"]["color"];
    let missing = color["missing"].as_u64().unwrap();
    assert!((8..40).contains(&missing), "{json:#}");
    // Of a normal with a deviation of 1 ms, 95 % lie within 1.96 ms.
    let jitter = color["jitter"]["p95_ms"].as_f64().unwrap();
    assert!((1.5..2.5).contains(&jitter), "{json:#}");
    assert!(folder.path().join("sync.png").is_file());
    let ran = capturectl(folder.path(), &["sync-report", "camera:9"]);
    ran.refuses(4, &["camera:9"]);
    let ran = capturectl(
        folder.path(),
        &["sync-report", "synthetic:desk", "--frames", "2"],
    );
    ran.refuses(2, &["8..=100000"]);
}

#[test]
fn a_burst_becomes_one_shot_of_frames_of_both_lights_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let device = "synthetic:desk?width=64&depth_width=32&noise=4";
    let shoot = |device: &str, out: &str| {
        let arguments = [
            "shoot", "--device", device, "--burst", "12", "--json", "--out", out,
        ];
        let json = capturectl(folder.path(), &arguments).succeeds().json();
        json["shot"]["report"]["burst"].clone()
    };
    let burst = shoot(device, "burst");
    let used = |burst: &serde_json::Value| {
        [&burst["used"][0], &burst["used"][1]].map(|n| n.as_u64().unwrap())
    };
    let [flash, ambient] = used(&burst);
    assert!(
        flash >= ambient && (12..=15).contains(&(flash + ambient)),
        "{burst}"
    );
    assert_eq!(
        burst["best_split"][0].as_u64().unwrap() + burst["best_split"][1].as_u64().unwrap(),
        12
    );
    let noise = burst["expected_noise"].as_f64().unwrap();
    assert!((0.3..0.5).contains(&noise), "{burst}");
    // Kept as linear floating point, and good to relight.
    let arguments = [
        "relight",
        "burst",
        "--light",
        "0.5,0.5,0.7",
        "--tier",
        "closed",
        "--out",
        "relit",
    ];
    capturectl(folder.path(), &arguments).succeeds();
    // A recording has the pattern it was recorded with, and gives what it has.
    let arguments = ["record", device, "--out", "many.mcap", "--brackets", "5"];
    capturectl(folder.path(), &arguments).succeeds();
    let [flash, ambient] = used(&shoot("replay:many.mcap", "replayed"));
    assert!(
        flash >= 5 && ambient >= 2 * flash - 1,
        "{flash} and {ambient}"
    );
    let ran = capturectl(
        folder.path(),
        &["shoot", "--device", device, "--burst", "65"],
    );
    ran.refuses(2, &["2..=64"]);
}
