//! `--json`: one document on standard output from every command, whether it succeeds or fails.

use crate::{capture::Capture, capturectl, recording};

struct Case {
    arguments: &'static [&'static str],
    /// Fields the document has.
    fields: &'static [&'static str],
}

/// A folder with a capture, a recording of it and pictures of an exposure stack.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    std::fs::copy(recording("statue.mcap"), folder.path().join("statue.mcap")).unwrap();
    for (name, exposure) in [("dark.png", 0.4), ("light.png", 0.8)] {
        let picture = image::ImageBuffer::from_fn(256, 64, |x, _| {
            image::Luma([(255.0 * (f64::from(x) / 255.0 * exposure).sqrt()) as u8])
        });
        picture.save(folder.path().join(name)).unwrap();
    }
    folder
}

#[test]
fn every_command_answers_with_one_document() {
    let folder = folder();
    let cases = [
        Case {
            arguments: &["relight", "capture", "--light", "0,0,1", "--out", "relit"],
            fields: &["out", "shot", "warnings"],
        },
        Case {
            arguments: &["shoot", "--device", "synthetic:wall", "--out", "shot"],
            fields: &["by", "device", "out", "files", "shot", "warnings"],
        },
        Case {
            arguments: &["import", "capture", "--out", "capture.mcap"],
            fields: &["out", "made", "recording", "warnings"],
        },
        Case {
            arguments: &[
                "record",
                "replay:statue.mcap",
                "--brackets",
                "1",
                "--out",
                "a.mcap",
            ],
            fields: &["out", "brackets", "recording", "warnings"],
        },
        Case {
            arguments: &["info", "capture"],
            fields: &["kind", "name", "rig"],
        },
        Case {
            arguments: &["info", "statue.mcap"],
            fields: &["kind", "recording"],
        },
        Case {
            arguments: &["info", "relit"],
            fields: &["kind", "results"],
        },
        Case {
            arguments: &["devices"],
            fields: &["devices"],
        },
        Case {
            arguments: &["check-device", "replay:statue.mcap"],
            fields: &["device", "frames", "claims"],
        },
        Case {
            arguments: &["eval", "capture", "--no-networks"],
            fields: &["format", "protocol", "machine", "captures", "rows"],
        },
        Case {
            arguments: &[
                "calibrate",
                "response",
                "dark.png",
                "light.png",
                "--exposures",
                "0.4,0.8",
            ],
            fields: &["residual_codes", "codes_seen", "transfer"],
        },
    ];
    for Case { arguments, fields } in cases {
        let ran = capturectl(folder.path(), &[&["--json"], arguments].concat());
        let document = ran.succeeds().json();
        for field in fields {
            assert!(
                document.get(field).is_some(),
                "{arguments:?}: no {field}: {document}"
            );
        }
    }
}

#[test]
fn every_command_fails_with_one_document_that_names_what_failed() {
    let folder = folder();
    // Arguments, kind of the fault, exit code, a word of the message.
    let cases: [(&[&str], &str, i32, &str); 13] = [
        (
            &["relight", "gone", "--light", "0,0,1", "--out", "x"],
            "input",
            3,
            "gone",
        ),
        (
            &["relight", "capture", "--out", "x"],
            "request",
            2,
            "--light",
        ),
        (&["relight", "capture"], "request", 2, "--out"),
        (
            &["shoot", "--device", "nothing:here", "--out", "x"],
            "device",
            4,
            "nothing:here",
        ),
        (&["import", "gone"], "input", 3, "gone"),
        (
            &["record", "nothing:here", "--out", "x.mcap"],
            "device",
            4,
            "nothing:here",
        ),
        (
            &["record", "synthetic:wall", "--out", "dark.png"],
            "output",
            5,
            "dark.png",
        ),
        (&["info", "gone"], "input", 3, "gone"),
        (
            &["devices", "--config", "gone.toml"],
            "input",
            3,
            "gone.toml",
        ),
        (
            &["check-device", "nothing:here"],
            "device",
            4,
            "nothing:here",
        ),
        (&["eval", "gone"], "input", 3, "gone"),
        (
            &[
                "calibrate",
                "response",
                "gone.png",
                "dark.png",
                "--exposures",
                "1,2",
            ],
            "input",
            3,
            "gone.png",
        ),
        (&["unknown"], "request", 2, "unknown"),
    ];
    for (arguments, kind, code, word) in cases {
        let ran = capturectl(folder.path(), &[arguments, &["--json"]].concat());
        ran.refuses(code, &[word]);
        let error = &ran.json()["error"];
        assert_eq!(error["kind"], kind, "{ran:#?}");
        assert!(
            error["message"].as_str().unwrap().contains(word),
            "{ran:#?}"
        );
    }
}

#[test]
fn a_device_that_breaks_the_contract_is_a_failure_with_its_claims() {
    let folder = folder();
    let ran = capturectl(
        folder.path(),
        &[
            "--json",
            "check-device",
            "flaky:duplicate=0.5:synthetic:wall",
        ],
    );
    assert_eq!(ran.code, 1, "{ran:#?}");
    ran.does_not_panic();
    let claims = ran.json()["claims"].clone();
    let broken: Vec<_> = claims
        .as_array()
        .unwrap()
        .iter()
        .filter(|claim| claim["verdict"] == "fail")
        .collect();
    assert!(!broken.is_empty(), "{claims}");
}
