//! `eval`'s table: rows answered elsewhere, noisy depth, and what of them is refused.

use super::{
    capture::{Capture, SIZE},
    capturectl,
};
use serde_json::Value;
use std::{fs, path::Path};

/// A capture of this name with a white truth under two lamps.
pub(super) fn capture(folder: &Path, name: &str) {
    let capture = folder.join(name);
    Capture::GOOD.write(&capture);
    let truth = capture.join("truth");
    fs::create_dir(&truth).unwrap();
    let mut lights = String::new();
    for (index, direction) in ["[0.0, 0.0, 1.0]", "[0.8, 0.0, 0.6]"].iter().enumerate() {
        lights.push_str(&format!(
            "[[light]]\ndirection = {direction}\nimage = \"relit_00{index}.png\"\nshadow = \"shadow_00{index}.png\"\n"
        ));
        png(&truth.join(format!("relit_00{index}.png")), [255; 3]);
        shadow(&truth.join(format!("shadow_00{index}.png")), 255);
    }
    fs::write(truth.join("lights.toml"), lights).unwrap();
    exr(&truth.join("albedo.exr"), SIZE, [1.0; 3]);
    exr(&truth.join("normal.exr"), SIZE, [0.0, 0.0, 1.0]);
    shadow(&truth.join("roughness.png"), 0);
}

/// Answers to it: three quarters of the light, all in shadow, normals to the right, roughness
/// 128/255.
fn answers(folder: &Path, name: &str) {
    let answers = folder.join("answers").join(name);
    fs::create_dir_all(&answers).unwrap();
    for index in 0..2 {
        exr(
            &answers.join(format!("relit_00{index}.exr")),
            SIZE,
            [0.75; 3],
        );
        shadow(&answers.join(format!("shadow_00{index}.png")), 0);
    }
    exr(&answers.join("albedo.exr"), SIZE, [0.75; 3]);
    exr(&answers.join("normal.exr"), SIZE, [1.0, 0.0, 0.0]);
}

fn png(path: &Path, color: [u8; 3]) {
    let picture = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Rgb(color));
    picture.save(path).unwrap();
}

fn shadow(path: &Path, value: u8) {
    let picture = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Luma([value]));
    picture.save(path).unwrap();
}

fn exr(path: &Path, (width, height): (u32, u32), color: [f32; 3]) {
    let [red, green, blue] = color;
    exr::prelude::write_rgb_file(path, width as usize, height as usize, |x, y| {
        // The corner is left without an answer where the color is that of an answer.
        if red == 0.75 && (x, y) == (0, 0) {
            (f32::NAN, green, blue)
        } else {
            (red, green, blue)
        }
    })
    .unwrap();
}

/// The report of `eval`.
fn evaluated(folder: &Path, arguments: &[&str]) -> Value {
    let arguments = [&["--json", "eval", "--no-networks"], arguments].concat();
    capturectl(folder, &arguments).succeeds().json()
}

fn row<'a>(report: &'a Value, label: &str) -> &'a Value {
    let rows = report["rows"].as_array().unwrap();
    let found = rows.iter().find(|row| row["label"] == label);
    found.unwrap_or_else(|| panic!("no row {label}: {report}"))
}

#[track_caller]
fn is_near(value: &Value, wanted: f64) {
    let found = value.as_f64().unwrap_or_else(|| panic!("{value}"));
    // Single precision and an answer stored as half floats.
    assert!((found - wanted).abs() < 1e-4, "{found}, not {wanted}");
}

#[test]
fn answers_made_elsewhere_are_measured_and_what_they_lack_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        capture(folder.path(), name);
    }
    answers(folder.path(), "a");
    let times = folder.path().join("answers/a/times.json");
    fs::write(times, "{\"milliseconds\": [3.0, null]}").unwrap();
    let arguments = ["a", "b", "--answers", "6:ours, elsewhere=answers"];
    let report = evaluated(folder.path(), &arguments);
    let six = row(&report, "6");
    assert_eq!(
        (&six["name"], &six["status"]),
        (&"ours, elsewhere".into(), &"present".into())
    );
    assert_eq!(
        (&six["captures"], &six["absent_captures"]),
        (&1.into(), &1.into())
    );
    // (1 − 0.75)², a normal at a right angle, and full shadow where all is lit.
    is_near(&six["mean"]["linear_mse"], 0.0625);
    is_near(&six["surfaces"]["albedo_linear_mse"], 0.0625);
    is_near(&six["surfaces"]["normal_signed_mse"], 2.0 / 3.0);
    is_near(&six["surfaces"]["normal_unsigned_mse"], 1.0 / 6.0);
    is_near(&six["shadow_mse"], 1.0);
    is_near(&six["relight_ms"], 3.0);
    assert_eq!(six["surfaces"]["roughness_mse"], Value::Null);
    let light = &report["captures"][0]["rows"][3]["lights"][0]["error"];
    let pixels = SIZE.0 * SIZE.1;
    assert_eq!(
        (&light["pixels"], &light["unanswered"]),
        (&(pixels - 1).into(), &1.into())
    );

    fs::remove_file(folder.path().join("answers/a/relit_001.exr")).unwrap();
    let ran = capturectl(
        folder.path(),
        &[&["eval", "--no-networks"], &arguments[..]].concat(),
    );
    let text = &ran.succeeds().out;
    for words in [
        "no answer for 1 capture and 1 light",
        "answers/b: there is no such folder",
    ] {
        assert!(text.contains(words), "{words:?} is missing in {text}");
    }
    let published = text.lines().find(|line| line.contains("three networks  "));
    assert!(
        text.contains("as published") && published.unwrap().contains("1.26"),
        "{text}"
    );
}

#[test]
fn noisy_depth_is_the_same_for_a_capture_whatever_stands_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        capture(folder.path(), name);
    }
    let mse = |captures: &[&str], noise: &str, name: &str| {
        let arguments = [&["--depth-noise", noise], captures].concat();
        let report = evaluated(folder.path(), &arguments);
        for label in ["1", "2", "3"] {
            assert_eq!(row(&report, label)["noisy"]["status"], "present");
        }
        let noisy = report["noisy"]["captures"].as_array().unwrap();
        let capture = noisy.iter().find(|capture| capture["name"] == name);
        let mse = |capture: &Value| capture["rows"][2]["surfaces"]["normal"]["signed_mse"].clone();
        let noisy = mse(capture.unwrap());
        let clean = report["captures"].as_array().unwrap();
        assert_ne!(noisy, mse(&clean[0]), "the noise changes nothing");
        noisy
    };
    let alone = mse(&["a"], "paper:7", "a");
    assert_eq!(alone, mse(&["b", "a"], "paper:7", "a"));
    assert_ne!(
        alone,
        mse(&["a"], "paper:8", "a"),
        "the seed changes nothing"
    );
    // Both captures are of one scene: what differs is their names.
    assert_ne!(alone, mse(&["b"], "paper:7", "b"));
}

#[test]
fn answers_that_cannot_be_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    capture(folder.path(), "a");
    answers(folder.path(), "a");
    let eval =
        |arguments: &[&str]| capturectl(folder.path(), &[&["eval", "a"], arguments].concat());
    for (arguments, words) in [
        (&["--answers", "answers"][..], "ROW=DIR"),
        (&["--answers", "3=answers"], "4 to 99"),
        (&["--answers", "six=answers"], "4 to 99"),
        (&["--answers", "6:=answers"], "printable"),
        (&["--answers", "6="], "empty"),
        (
            &["--answers", "6=answers", "--answers", "6=answers"],
            "6:NAME=DIR",
        ),
        (&["--noisy-answers", "6=answers"], "--depth-noise"),
        (&["--depth-noise", "rain"], "paper:SEED"),
        (&["--depth-noise", "paper:-1"], "-1"),
    ] {
        eval(arguments).refuses(2, &[words]);
    }
    eval(&["--answers", "6=absent"]).refuses(3, &["absent", "one folder of answers per capture"]);

    let answers = folder.path().join("answers/a");
    let times = answers.join("times.json");
    for (text, words) in [
        ("{\"milliseconds\": [1.0]}", "2 lights"),
        ("{\"milliseconds\": [1.0, -1.0]}", "holds -1"),
        ("{\"seconds\": []}", "seconds"),
        ("[", "its text"),
    ] {
        fs::write(&times, text).unwrap();
        eval(&["--answers", "6=answers"]).refuses(3, &["times.json", words]);
    }
    fs::remove_file(times).unwrap();
    exr(&answers.join("relit_001.exr"), (8, 8), [0.5; 3]);
    eval(&["--answers", "6=answers"]).refuses(3, &["relit_001.exr", "8×8", "64×48"]);
    fs::write(answers.join("relit_001.exr"), "no picture").unwrap();
    eval(&["--answers", "6=answers"]).refuses(3, &["relit_001.exr", "first bytes"]);
}
