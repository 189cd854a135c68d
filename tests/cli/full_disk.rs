//! A disk that is full: a message that names the file and what to do, and nothing half-written.

use crate::{Ran, capture::Capture, command, names_in, ran, recording};
use std::{
    ffi::OsString,
    fs,
    path::Path,
    process::{Command, Output},
};

/// Runs `capturectl` through a shell that first does `before`.
fn after(before: &str, folder: &Path, arguments: &[&str]) -> Output {
    let inner = command(folder);
    let mut outer = Command::new("sh");
    outer
        .args(["-c", before])
        .arg(inner.get_program())
        .args(arguments);
    outer.current_dir(folder);
    for (key, value) in inner.get_envs() {
        match value {
            Some(value) => outer.env(key, value),
            None => outer.env_remove(key),
        };
    }
    outer.output().expect("there is a shell")
}

/// Runs `capturectl` where no file may grow beyond a kilobyte or two: what the kernel says to a
/// write is then another error than on a full disk, on the same way.
fn cramped(folder: &Path, arguments: &[&str]) -> Ran {
    ran(&after(r#"ulimit -f 2; exec "$0" "$@""#, folder, arguments))
}

#[test]
fn every_command_that_writes_says_which_file_did_not_fit_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    for (name, value) in [("dark.png", 60u8), ("light.png", 120)] {
        let picture = image::ImageBuffer::from_fn(256, 64, |x, _| {
            image::Luma([(u32::from(value) * x / 128).min(255) as u8])
        });
        picture.save(folder.path().join(name)).unwrap();
    }
    let before = names_in(folder.path());
    let desk = recording("desk.mcap");
    let cases: [(&[&str], &str); 6] = [
        (
            &["relight", "capture", "--light", "0,0,1", "--out", "relit"],
            "relit/",
        ),
        (&["import", "capture", "--out", "new.mcap"], "new.mcap"),
        (
            &["record", "synthetic:wall", "--out", "new.mcap"],
            "new.mcap",
        ),
        (
            &["shoot", "--device", "synthetic:wall", "--out", "shot"],
            "shot.mcap",
        ),
        (
            &[
                "eval",
                desk.to_str().unwrap(),
                "--no-networks",
                "--report",
                "report",
            ],
            "report/",
        ),
        (
            &[
                "calibrate",
                "response",
                "dark.png",
                "light.png",
                "--exposures",
                "1,2",
                "--out",
                "curve.json",
            ],
            "curve.json",
        ),
    ];
    for (arguments, file) in cases {
        let ran = cramped(folder.path(), arguments);
        ran.refuses(5, &[file, "too large", "space"]);
        let mut left = names_in(folder.path());
        // What was measured is kept for the next try.
        left.retain(|name| name != ".unfinished-report");
        assert_eq!(left, before, "{arguments:?}");
    }
}

/// Runs `capturectl` beside a file system of 32 KiB that is mounted at `small` for it alone.
/// `None`, with the reason printed, where an ordinary user may not mount one.
fn beside_a_small_disk(folder: &Path, arguments: &[&str]) -> Option<(Ran, String)> {
    let may = r#"unshare -Urm sh -c 'mount -t tmpfs -o size=32k none "$0"' small"#;
    let mut probe = Command::new("sh");
    let probe = probe.args(["-c", may]).current_dir(folder).output();
    let refusal = match probe {
        Ok(output) if output.status.success() => None,
        Ok(output) => Some(String::from_utf8_lossy(&output.stderr).into_owned()),
        Err(error) => Some(error.to_string()),
    };
    if let Some(reason) = refusal {
        eprintln!("skipped: no file system can be mounted here: {reason}");
        return None;
    }
    let inside = r#"unshare -Urm sh -c '
        mount -t tmpfs -o size=32k none small
        "$0" "$@"; code=$?
        ls -A small >left
        exit $code' "$0" "$@""#;
    let output = after(inside, folder, arguments);
    let left = fs::read_to_string(folder.join("left")).unwrap();
    Some((ran(&output), left))
}

#[test]
fn a_disk_that_is_really_full_is_named_and_left_clean() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    fs::create_dir(folder.path().join("small")).unwrap();
    let cases: [(&[&str], &str); 3] = [
        (
            &[
                "relight",
                "capture",
                "--light",
                "0,0,1",
                "--out",
                "small/relit",
            ],
            "small/relit/",
        ),
        (
            &["import", "capture", "--out", "small/new.mcap"],
            "small/new.mcap",
        ),
        (
            &["record", "synthetic:wall", "--out", "small/new.mcap"],
            "small/new.mcap",
        ),
    ];
    for (arguments, file) in cases {
        let Some((ran, left)) = beside_a_small_disk(folder.path(), arguments) else {
            return;
        };
        ran.refuses(5, &[file, "No space left", "space"]);
        assert_eq!(left, "", "{arguments:?}");
    }
}

#[test]
fn a_recording_that_fills_the_disk_keeps_its_whole_brackets_under_an_unfinished_name() {
    let folder = tempfile::tempdir().unwrap();
    let whole = [
        "record",
        "synthetic:wall",
        "--brackets",
        "1",
        "--out",
        "a.mcap",
    ];
    crate::capturectl(folder.path(), &whole).succeeds();
    let bytes = fs::metadata(folder.path().join("a.mcap")).unwrap().len();
    fs::remove_file(folder.path().join("a.mcap")).unwrap();

    // Room for two brackets and a half, in blocks of 512 bytes, or of 1024 in some shells.
    let unit = if shell_counts_kilobytes(folder.path()) {
        1024
    } else {
        512
    };
    let script = format!(r#"ulimit -f {}; exec "$0" "$@""#, bytes * 5 / 2 / unit);
    let arguments = [
        "record",
        "synthetic:wall",
        "--brackets",
        "9",
        "--out",
        "a.mcap",
    ];
    let ran = ran(&after(&script, folder.path(), &arguments));
    ran.refuses(5, &["a.mcap.partial", "whole brackets", "capturectl info"]);
    assert_eq!(names_in(folder.path()), ["a.mcap.partial"]);

    let told = crate::capturectl(folder.path(), &["--json", "info", "a.mcap.partial"]);
    let flashes = told.succeeds().json()["recording"]["flash_frames"].clone();
    assert!(flashes.as_u64().unwrap() >= 1, "{told:#?}");
    assert!(told.err.contains("cut at"), "{told:#?}");
    crate::capturectl(folder.path(), &arguments).refuses(5, &["a.mcap.partial", "exists"]);
}

fn shell_counts_kilobytes(folder: &Path) -> bool {
    let script = "ulimit -f 2; head -c 1500 /dev/zero >probe 2>/dev/null";
    let status = Command::new("sh")
        .args(["-c", script].map(OsString::from))
        .current_dir(folder)
        .status()
        .unwrap();
    drop(fs::remove_file(folder.join("probe")));
    status.success()
}
