//! What each command answers: files, text, and one JSON document with `--json`.

use crate::{
    Ran,
    capture::{Capture, SIZE},
    capturectl, names_in, recording,
};
use std::{fs, path::Path};

const RIG: &str = include_str!("../../config/rig.example.toml");

/// The results that the README names, for one light.
const RESULTS: [&str; 9] = [
    "albedo.exr",
    "depth.exr",
    "normal.exr",
    "overview.png",
    "relit_000.exr",
    "relit_000.png",
    "roughness.exr",
    "shadow_000.png",
    "shot.json",
];

/// Runs with `--json`; nothing but the document may stand on standard output.
fn json(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    let ran: Ran = capturectl(folder, &[&["--json"], arguments].concat());
    ran.succeeds();
    ran.json()
}

#[test]
fn a_recording_is_relit_into_exactly_the_promised_files() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let answer = json(
        folder.path(),
        &[
            "relight",
            desk.to_str().unwrap(),
            "--light",
            "0.6,0.5,0.62",
            "--out",
            "relit",
        ],
    );
    assert_eq!(names_in(&folder.path().join("relit")), RESULTS);
    assert_eq!(names_in(folder.path()), ["relit"]);
    let stages: Vec<&str> = answer["shot"]["timings_ms"]
        .as_array()
        .unwrap()
        .iter()
        .map(|stage| stage[0].as_str().unwrap())
        // Only where auto asks networks.
        .filter(|stage| {
            !["load networks", "correct surfaces", "prepare correction"].contains(stage)
        })
        .collect();
    assert_eq!(
        stages,
        [
            "radiometry",
            "choose",
            "registration",
            "scene",
            "prepare",
            "relight"
        ]
    );
    let confidence = answer["shot"]["report"]["confidence_mean"]
        .as_f64()
        .unwrap();
    assert!((0.0..=1.0).contains(&confidence), "{answer}");
    // A good shot: judged in every way it could fail, and blamed for none.
    let findings = answer["shot"]["report"]["verdict"].as_array().unwrap();
    assert_eq!(findings.len(), 19);
    for finding in findings {
        assert!(finding["score"].as_f64().unwrap() < 1.0, "{finding}");
    }

    let told = json(folder.path(), &["info", "relit"]);
    assert_eq!(told["kind"], "results");
    let picture = folder.path().join("relit/relit_000.png");
    let mut bytes = fs::read(&picture).unwrap();
    bytes[100] ^= 1;
    fs::write(&picture, bytes).unwrap();
    capturectl(folder.path(), &["info", "relit"]).refuses(3, &["relit_000.png", "blake3"]);
}

#[test]
fn a_lamp_at_the_flash_gives_the_flash_photograph_back() {
    // With the flash's inverse square and cosine divided out, what is left of a facing wall under
    // a facing lamp is its color.
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    let arguments = ["relight", "capture", "--light", "0,0,1", "--out", "relit"];
    capturectl(folder.path(), &arguments).succeeds();
    let relit = image::open(folder.path().join("relit/relit_000.png"))
        .unwrap()
        .to_rgb8();
    assert_eq!(relit.dimensions(), SIZE);
    // The capture is made of white, 0.8 and 0.6 in red, green and blue; sRGB of these.
    let expected = [255.0, 231.0, 203.0];
    let mut close = 0;
    for (x, y, pixel) in relit.enumerate_pixels() {
        // The wall beside the ball, away from edges. 18 of 255 is 15 % of light: the wall leans by
        // 6.5°, which the photograph leaves out, and its normals are estimated.
        if x < 12 && y > 4 && y < 44 {
            let far = pixel
                .0
                .iter()
                .zip(expected)
                .any(|(found, wanted)| (f64::from(*found) - wanted).abs() > 18.0);
            close += i32::from(!far);
        }
    }
    assert!(close > 12 * 39 * 8 / 10, "{close} of {} pixels", 12 * 39);
}

#[test]
fn the_same_command_twice_writes_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    for out in ["one", "two"] {
        capturectl(
            folder.path(),
            &["relight", "capture", "--light", "1,1,1", "--out", out],
        )
        .succeeds();
    }
    for name in RESULTS.iter().filter(|name| **name != "shot.json") {
        let read = |out: &str| fs::read(folder.path().join(out).join(name)).unwrap();
        assert!(read("one") == read("two"), "{name}");
    }
}

#[test]
fn earlier_results_are_replaced_only_when_told_to() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    let relight = ["relight", "capture", "--light", "0,0,1", "--out", "relit"];
    capturectl(folder.path(), &relight).succeeds();
    capturectl(folder.path(), &relight).refuses(5, &["relit", "--force"]);
    let two = [
        "relight", "capture", "--light", "0,0,1", "--light", "1,0,1", "--out", "relit", "--force",
    ];
    capturectl(folder.path(), &two).succeeds();
    assert!(folder.path().join("relit/relit_001.png").is_file());
    assert_eq!(names_in(folder.path()), ["capture", "relit"]);
}

#[test]
fn a_folder_imported_and_relit_is_the_folder_relit() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    let answer = json(folder.path(), &["import", "capture"]);
    assert_eq!(answer["out"], "capture.mcap");
    assert_eq!(answer["recording"]["flash_frames"], 1);
    capturectl(folder.path(), &["import", "capture"]).refuses(5, &["capture.mcap"]);
    for (input, out) in [
        ("capture", "from_folder"),
        ("capture.mcap", "from_recording"),
    ] {
        capturectl(
            folder.path(),
            &["relight", input, "--light", "1,0,1", "--out", out],
        )
        .succeeds();
    }
    for name in ["relit_000.exr", "albedo.exr", "depth.exr"] {
        let read = |out: &str| fs::read(folder.path().join(out).join(name)).unwrap();
        assert!(read("from_folder") == read("from_recording"), "{name}");
    }
}

#[test]
fn a_device_is_recorded_checked_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let answer = json(
        folder.path(),
        &[
            "record",
            "synthetic:wall",
            "--brackets",
            "2",
            "--out",
            "wall.mcap",
        ],
    );
    assert_eq!(answer["brackets"], 2);
    let told = json(folder.path(), &["info", "wall.mcap"]);
    assert_eq!(told["kind"], "recording");
    assert_eq!(
        told["recording"]["flash_frames"],
        answer["recording"]["flash_frames"]
    );
    assert!(told["recording"]["flash_frames"].as_u64().unwrap() >= 2);
    capturectl(
        folder.path(),
        &["record", "synthetic:wall", "--out", "wall.mcap"],
    )
    .refuses(5, &["wall.mcap"]);

    let checked = json(folder.path(), &["check-device", "replay:wall.mcap"]);
    assert!(!checked["claims"].as_array().unwrap().is_empty());
    let devices = json(folder.path(), &["devices"]);
    assert!(devices["devices"].to_string().contains("synthetic:"));
    capturectl(folder.path(), &["check-device", "nothing:here"]).refuses(4, &["nothing:here"]);
    capturectl(
        folder.path(),
        &["record", "synthetic:nowhere", "--out", "x.mcap"],
    )
    .refuses(4, &["nowhere"]);
    assert_eq!(names_in(folder.path()), ["wall.mcap"]);
}

#[test]
fn a_shot_keeps_its_frames_and_can_be_developed_again_from_them() {
    let folder = tempfile::tempdir().unwrap();
    let shot = json(
        folder.path(),
        &["shoot", "--device", "synthetic:desk", "--out", "shot"],
    );
    assert_eq!(shot["by"], "process");
    assert_eq!(
        names_in(&folder.path().join("shot")),
        ["shot.json", "shot.mcap"]
    );
    let relight = [
        "relight",
        "shot",
        "--light",
        "0.6,0.5,0.62",
        "--out",
        "later",
    ];
    capturectl(folder.path(), &relight).succeeds();
    let at_once = [
        "shoot",
        "--relight",
        "--device",
        "synthetic:desk",
        "--out",
        "at_once",
    ];
    capturectl(folder.path(), &at_once).succeeds();
    let read = |out: &str| fs::read(folder.path().join(out).join("relit_000.exr")).unwrap();
    assert!(
        read("later") == read("at_once"),
        "the usual light is 0.6,0.5,0.62"
    );
    capturectl(folder.path(), &["shoot", "--light", "0,0,1"]).refuses(2, &["--relight"]);
}

#[test]
fn a_capture_without_truth_is_evaluated_for_its_times_only() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    let report = json(
        folder.path(),
        &["eval", "capture", "--no-networks", "--report", "report"],
    );
    assert_eq!(report["captures"][0]["name"], "capture");
    assert!(
        !report["captures"][0]["stages"]
            .as_array()
            .unwrap()
            .is_empty()
    );
    let names = names_in(&folder.path().join("report"));
    for name in ["report.json", "report.csv", "table.json", "table.csv"] {
        assert!(names.contains(&name.to_owned()), "{names:?}");
    }
}

#[test]
fn a_transfer_curve_is_found_in_an_exposure_stack() {
    // Pictures through an exact square-root curve: value = sqrt(light).
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["calibrate".to_owned(), "response".to_owned()];
    let exposures = [0.125f32, 0.25, 0.5, 1.0];
    for (index, exposure) in exposures.iter().enumerate() {
        let picture = image::ImageBuffer::from_fn(256, 64, |x, y| {
            let scene = (x as f32 + 0.25 * y as f32 / 64.0 + 0.5) / 128.0;
            let value = (scene * exposure).min(1.0).sqrt();
            image::Luma([(value * 255.0).round() as u8])
        });
        let name = format!("{index}.png");
        picture.save(folder.path().join(&name)).unwrap();
        arguments.push(name);
    }
    arguments.extend(["--exposures", "0.125,0.25,0.5,1.0", "--json"].map(str::to_owned));
    let ran = capturectl(folder.path(), &arguments);
    ran.succeeds();
    let light = ran.json()["transfer"]["response"].clone();
    for code in [64usize, 128, 192] {
        let found = light[code].as_f64().unwrap();
        let wanted = (code as f64 / 255.0).powi(2);
        assert!(
            (found / wanted - 1.0).abs() < 0.1,
            "code {code}: {found}, not {wanted}"
        );
    }
    let short = [
        "calibrate",
        "response",
        "0.png",
        "1.png",
        "--exposures",
        "1",
    ];
    capturectl(folder.path(), &short).refuses(2, &["--exposures", "2 pictures"]);
    let bad = [
        "calibrate",
        "response",
        "0.png",
        "absent.png",
        "--exposures",
        "1,2",
    ];
    capturectl(folder.path(), &bad).refuses(3, &["absent.png"]);
}

#[test]
fn the_example_rig_is_a_capture_toml() {
    let folder = tempfile::tempdir().unwrap();
    let rig = folder.path().join("rig");
    fs::create_dir(&rig).unwrap();
    fs::write(rig.join("capture.toml"), RIG).unwrap();
    for name in ["flash.png", "ambient.png"] {
        image::RgbImage::from_pixel(640, 480, image::Rgb([90, 90, 90]))
            .save(rig.join(name))
            .unwrap();
    }
    let depth = image::ImageBuffer::from_pixel(320, 240, image::Luma([1000u16]));
    depth.save(rig.join("depth.png")).unwrap();
    let told = json(folder.path(), &["info", "rig"]);
    assert_eq!(told["rig"]["depth"]["lens"]["width"], 320);
    assert_eq!(told["depth_answered_fraction"], 1.0);
}

#[test]
fn a_failure_is_one_json_document_too() {
    let folder = tempfile::tempdir().unwrap();
    let ran = capturectl(folder.path(), &["--json", "info", "absent"]);
    assert_eq!(ran.code, 3);
    let error = &ran.json()["error"];
    assert_eq!(error["kind"], "input");
    assert!(
        error["message"].as_str().unwrap().contains("absent"),
        "{error}"
    );
}

#[test]
fn help_names_the_exit_codes_and_the_axes() {
    let folder = tempfile::tempdir().unwrap();
    let ran = capturectl(folder.path(), &["--help"]);
    ran.succeeds();
    for words in ["Exit codes", "x right, y up, z toward the camera"] {
        assert!(ran.out.contains(words), "{ran:#?}");
    }
}
