//! `eval --corrupt … --report`: the stability run, its page, and going on after a stop.

use super::{Ran, capture::Capture, capturectl, names_in, table::capture};
use serde_json::Value;
use std::{fs, path::Path};

/// Two of the ways, a depth one and a light one, at two severities.
const SLICE: [&str; 7] = [
    "--no-networks",
    "--corrupt",
    "jpeg,depth-holes",
    "--severities",
    "3,1",
    "--corrupt-lights",
    "1",
];

fn eval(folder: &Path, arguments: &[&str]) -> Ran {
    capturectl(folder, &[&["eval"], arguments, &SLICE[..]].concat())
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn the_page_shows_every_chart_and_table_and_needs_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    // A name that would be markup.
    let name = "<img src=x>&";
    capture(folder.path(), name);
    Capture::GOOD.write(&folder.path().join("untrue"));
    let row = "6:<b>ours</b>=answers";
    fs::create_dir(folder.path().join("answers")).unwrap();
    let ran = eval(
        folder.path(),
        &[name, "untrue", "--answers", row, "--report", "out"],
    );
    ran.succeeds();
    for words in ["Stability (1 captures, 2 corruptions", "closed form"] {
        assert!(
            ran.out.contains(words),
            "{words:?} is missing in {}",
            ran.out
        );
    }

    let out = folder.path().join("out");
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert_eq!(page.matches("<svg ").count(), 6);
    for title in [
        "Speed against accuracy",
        "Stability: error of the relit picture",
        "Parsimony: what leaving terms out",
        "Error by light direction",
        "Error against the lamp's angle",
        "Error by region",
    ] {
        let escaped = title.replace('\'', "&apos;");
        assert!(page.contains(title) || page.contains(&escaped), "{title}");
    }
    for part in [
        "name=viewport",
        "prefers-color-scheme: dark",
        "no truth folder",
        "missing: left out (--no-networks)",
        "&lt;img src=x&gt;&amp;",
        "&lt;b&gt;ours&lt;/b&gt;",
        "capturectl eval",
        "depth-holes",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    for part in [
        "NaN",
        ">inf",
        "inf<",
        "<img",
        "<b>ours",
        "<script",
        "http://fonts",
        "src=\"",
        "@import",
        "url(",
    ] {
        assert!(!page.contains(part), "{part} is on the page");
    }
    // Its links lead to files that are there, and nowhere else.
    for link in page.split("href=\"").skip(1) {
        let link = link.split('"').next().unwrap();
        let inside = link.strip_prefix('#');
        assert!(
            inside.is_some_and(|id| page.contains(&format!("id=\"{id}\"")))
                || out.join(link).is_file(),
            "{link} leads nowhere"
        );
    }
    let stability = json(&out.join("stability.json"));
    assert_eq!(stability["severities"], serde_json::json!([1, 3]));
    let ways: Vec<&str> = stability["ways"]
        .as_array()
        .unwrap()
        .iter()
        .map(|way| way["name"].as_str().unwrap())
        .collect();
    // In the order of the table of corruptions.
    assert_eq!(ways, ["depth-holes", "jpeg"]);
    let cells = stability["captures"][0]["spoiled"].as_array().unwrap();
    assert_eq!(cells.len(), 4);
    // What was answered elsewhere has no part in it.
    assert!(cells.iter().all(|cell| {
        cell["rows"]
            .as_array()
            .unwrap()
            .iter()
            .all(|row| row["label"] != "6")
    }));
    // Holes in depth do not change the photograph that row 1 returns.
    let growth = &stability["ways"][0]["rows"][0]["points"][2];
    assert_eq!(
        (&growth["severity"], &growth["growth"]),
        (&3.into(), &1.0.into())
    );
}

#[test]
fn a_run_that_was_stopped_goes_on_and_ends_as_if_it_had_not_been() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        capture(folder.path(), name);
    }
    let picture = folder.path().join("b/truth/relit_001.png");
    let whole = fs::read(&picture).unwrap();
    fs::write(&picture, "no picture").unwrap();
    let run = || eval(folder.path(), &["a", "b", "--report", "out"]);
    run().refuses(3, &["relit_001.png"]);
    assert!(!folder.path().join("out").exists());
    let unfinished = folder.path().join(".unfinished-out");
    // The capture as it came, its cell, and one file for each way.
    assert_eq!(names_in(&unfinished).len(), 4);

    fs::write(&picture, &whole).unwrap();
    let ran = run();
    assert!(
        ran.succeeds().err.contains("4 parts were taken over"),
        "{}",
        ran.err
    );
    assert!(!unfinished.exists());
    let mut went_on = json(&folder.path().join("out/stability.json"));
    let again = run();
    assert!(
        !again.succeeds().err.contains("taken over"),
        "{}",
        again.err
    );
    assert_eq!(
        went_on.take(),
        json(&folder.path().join("out/stability.json"))
    );
}

#[test]
fn parts_that_were_changed_or_are_of_another_run_are_measured_again() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        capture(folder.path(), name);
    }
    let picture = folder.path().join("b/truth/relit_001.png");
    let whole = fs::read(&picture).unwrap();
    fs::write(&picture, "no picture").unwrap();
    let run = |more: &[&str]| {
        let arguments = [&["a", "b", "--report", "out"], more].concat();
        eval(folder.path(), &arguments)
    };
    run(&[]).refuses(3, &["relit_001.png"]);
    let unfinished = folder.path().join(".unfinished-out");
    for name in names_in(&unfinished) {
        let path = unfinished.join(name);
        let mut bytes = fs::read(&path).unwrap();
        let last = bytes.len() - 3;
        bytes[last] ^= 1;
        fs::write(path, bytes).unwrap();
    }
    fs::write(&picture, &whole).unwrap();
    let ran = run(&["--corrupt-seed", "1"]);
    assert!(!ran.succeeds().err.contains("taken over"), "{}", ran.err);
    assert!(!unfinished.exists());
}

#[test]
fn ways_severities_and_folders_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    capture(folder.path(), "a");
    let eval =
        |arguments: &[&str]| capturectl(folder.path(), &[&["eval", "a"], arguments].concat());
    eval(&["--corrupt", "rain"]).refuses(2, &["rain", "thin-structures"]);
    eval(&["--corrupt", ""]).refuses(2, &["thin-structures"]);
    for severities in ["0", "6", "1,6", "2.5", "-1", ""] {
        let severities = format!("--severities={severities}");
        eval(&["--corrupt", "jpeg", &severities]).refuses(2, &["1 to 5"]);
    }
    eval(&["--severities", "3"]).refuses(2, &["--corrupt"]);
    eval(&["--corrupt", "jpeg", "--corrupt-captures", "0"]).refuses(2, &["from 1"]);
    fs::create_dir(folder.path().join("out")).unwrap();
    fs::write(folder.path().join("out/thesis.txt"), "mine").unwrap();
    eval(&["--corrupt", "jpeg", "--report", "out"]).refuses(5, &["thesis.txt"]);
    assert_eq!(names_in(&folder.path().join("out")), ["thesis.txt"]);
    assert_eq!(names_in(folder.path()), ["a", "out"]);
}

#[test]
fn the_contact_sheet_shows_ninety_states_and_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    let sheet = || {
        capturectl(
            folder.path(),
            &["corrupt", "capture", "--sheet", "sheet.png"],
        )
    };
    sheet().succeeds();
    let page = image::open(folder.path().join("sheet.png"))
        .unwrap()
        .to_rgb8();
    // Six panels of 120 pixels at least, eighteen rows.
    assert!(
        page.width() > 6 * 120 && page.height() > 18 * 24,
        "{:?}",
        page.dimensions()
    );
    sheet().refuses(5, &["sheet.png", "exists already"]);
    capturectl(
        folder.path(),
        &["corrupt", "capture", "--sheet", "x.png", "--with", "jpeg:1"],
    )
    .refuses(2, &["--sheet"]);
}

#[test]
fn a_report_that_cannot_stand_beside_another_is_refused_and_a_summary_keeps_what_its_page_names() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        capture(folder.path(), name);
    }
    let eval = |arguments: &[&str]| {
        let arguments = [&["eval", "--no-networks"], arguments].concat();
        capturectl(folder.path(), &arguments)
    };
    eval(&["a", "--summary"]).refuses(2, &["--report"]);
    eval(&["a", "--beside", "b-report"]).refuses(2, &["--report"]);
    eval(&["a", "--report", "out", "--beside", "b-report"]).refuses(3, &["b-report/report.json"]);
    eval(&["b", "--report", "b-report"]).succeeds();
    eval(&["a", "--report", "out", "--beside", "b-report"]).refuses(3, &["another capture, b"]);
    let text = fs::read_to_string(folder.path().join("b-report/report.json")).unwrap();
    // Cut where something begins: half a number would be another complaint.
    let mut half = text.as_bytes()[..text.len() / 2].iter();
    let half = half.rposition(|byte| *byte == b'{').unwrap() + 1;
    fs::write(folder.path().join("b-report/report.json"), &text[..half]).unwrap();
    eval(&["b", "--report", "out", "--beside", "b-report"]).refuses(3, &["report.json", "EOF"]);
    assert!(!folder.path().join("out").exists());

    eval(&["a", "--report", "out", "--summary"]).succeeds();
    let names = names_in(&folder.path().join("out"));
    assert!(names.iter().any(|name| name == "index.html"));
    let detailed = |name: &String| name.starts_with("report.") || name.starts_with("hemisphere_");
    assert!(!names.iter().any(detailed), "{names:?}");
}
