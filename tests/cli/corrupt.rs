//! `capturectl corrupt`: what it writes, and what it refuses.

use crate::{capture::Capture, capturectl, names_in, recording};
use captured::{corruption::CORRUPTIONS, folder};
use std::fs;

fn corrupt(folder: &std::path::Path, with: &[&str]) -> crate::Ran {
    let mut arguments = vec!["corrupt", "capture", "--out", "worse"];
    arguments.extend(with.iter().flat_map(|with| ["--with", with]));
    capturectl(folder, &arguments)
}

fn good() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    folder
}

#[test]
fn every_corruption_writes_a_folder_that_reads_back() {
    let folder = good();
    let mut arguments = vec![
        "corrupt".to_owned(),
        "capture".into(),
        "--out".into(),
        "worse".into(),
    ];
    for corruption in &CORRUPTIONS {
        arguments.extend(["--with".into(), format!("{}:2", corruption.name)]);
    }
    let all = capturectl(
        folder.path(),
        &[&arguments[..], &["--json".into()]].concat(),
    );
    let json = all.succeeds().json();
    assert_eq!(json["corruptions"].as_array().unwrap().len(), 18);
    assert_eq!(json["truth"], false);
    let worse = folder::read(&folder.path().join("worse")).unwrap();
    let clean = folder::read(&folder.path().join("capture")).unwrap();
    assert_eq!(
        worse.shot.flash.pixels.size(),
        clean.shot.flash.pixels.size()
    );
    // A third a side, rounded down: low-depth-resolution:2.
    assert_eq!(worse.shot.depth.metres.size(), (21, 16));
    assert!(worse.truth.is_none());
}

#[test]
fn truth_is_copied_as_it_is_and_eval_works_on_it() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    capturectl(
        folder.path(),
        &[
            "corrupt",
            desk.to_str().unwrap(),
            "--with",
            "tof-noise:3",
            "--out",
            "worse",
        ],
    )
    .succeeds();
    let (from, to) = (recording("desk.truth"), folder.path().join("worse/truth"));
    assert_eq!(names_in(&from), names_in(&to));
    for name in names_in(&from) {
        assert_eq!(
            fs::read(from.join(&name)).unwrap(),
            fs::read(to.join(&name)).unwrap(),
            "{name}"
        );
    }
    assert_eq!(names_in(folder.path()), ["worse"]);
    capturectl(folder.path(), &["eval", "worse"]).succeeds();
}

#[test]
fn the_same_seed_writes_the_same_depth_and_another_seed_another() {
    let folder = good();
    let depth = |out: &str, seed: &str| {
        let arguments = [
            "corrupt",
            "capture",
            "--with",
            "tof-noise:1",
            "--seed",
            seed,
            "--out",
            out,
        ];
        capturectl(folder.path(), &arguments).succeeds();
        fs::read(folder.path().join(out).join("depth.exr")).unwrap()
    };
    let first = depth("a", "1");
    assert_eq!(first, depth("b", "1"));
    assert_ne!(first, depth("c", "2"));
}

#[test]
fn names_and_severities_that_do_not_exist_are_answered_with_those_that_do() {
    let folder = good();
    let names: Vec<&str> = CORRUPTIONS
        .iter()
        .map(|corruption| corruption.name)
        .collect();
    corrupt(folder.path(), &["rain:3"]).refuses(2, &[&["rain"], &names[..]].concat());
    for severity in ["6", "-1", "2.5", "", "999999999999"] {
        let with = format!("jpeg:{severity}");
        corrupt(folder.path(), &[&with]).refuses(2, &["0 (unchanged)", "5 (worst)"]);
    }
    corrupt(folder.path(), &["jpeg"]).refuses(2, &["NAME:SEVERITY"]);
    corrupt(folder.path(), &["jpeg:1", "jpeg:2"]).refuses(2, &["jpeg is given twice"]);
    corrupt(folder.path(), &[]).refuses(2, &["--with"]);
    assert_eq!(names_in(folder.path()), ["capture"]);
}

#[test]
fn captures_without_what_is_to_be_spoiled_and_taken_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    Capture {
        depth: false,
        ..Capture::GOOD
    }
    .write(&capture);
    corrupt(folder.path(), &["depth-holes:1"]).refuses(3, &["no depth sample"]);
    Capture {
        flash: 0.0,
        ambient: 0.0,
        depth: true,
    }
    .write(&capture);
    corrupt(folder.path(), &["bright-ambient:1"]).refuses(3, &["flash photograph is dark"]);
    assert_eq!(names_in(folder.path()), ["capture"]);

    Capture::GOOD.write(&capture);
    fs::create_dir(folder.path().join("worse")).unwrap();
    fs::write(folder.path().join("worse/letter.txt"), "mine").unwrap();
    corrupt(folder.path(), &["jpeg:1"]).refuses(5, &["worse", "not empty"]);
    assert_eq!(names_in(&folder.path().join("worse")), ["letter.txt"]);
    corrupt(folder.path(), &["jpeg:0"]).refuses(5, &["worse"]);
    capturectl(
        folder.path(),
        &["corrupt", "nowhere", "--with", "jpeg:1", "--out", "x"],
    )
    .refuses(3, &["nowhere"]);
}
