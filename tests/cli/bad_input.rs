//! Captures, recordings and output folders as they should not be: a clear message, nothing
//! half-written, no crash.

use crate::{
    capture::{Capture, SIZE, capture_toml},
    capturectl, names_in, recording,
};
use std::{fs, os::unix::fs::PermissionsExt, path::Path};

fn relight(folder: &Path, input: &str) -> crate::Ran {
    capturectl(
        folder,
        &["relight", input, "--light", "0.3,0.4,1", "--out", "relit"],
    )
}

/// A folder with one good capture, `capture`, that `spoil` has been at.
fn spoiled(spoil: impl FnOnce(&Path)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    Capture::GOOD.write(&capture);
    spoil(&capture);
    folder
}

#[test]
fn a_capture_that_contradicts_itself_is_refused_by_file_and_field() {
    struct Case {
        spoil: fn(&Path),
        words: &'static [&'static str],
    }
    let cases = [
        Case {
            spoil: |c| fs::remove_file(c.join("flash.png")).unwrap(),
            words: &["flash"],
        },
        Case {
            spoil: |c| fs::remove_file(c.join("depth.png")).unwrap(),
            words: &["depth"],
        },
        Case {
            spoil: |c| fs::remove_file(c.join("capture.toml")).unwrap(),
            words: &["capture.toml"],
        },
        Case {
            spoil: |c| fs::write(c.join("capture.toml"), capture_toml(SIZE.0 + 1, SIZE.1)).unwrap(),
            words: &["flash.png", "64×48", "65×48"],
        },
        Case {
            spoil: |c| {
                fs::write(
                    c.join("capture.toml"),
                    capture_toml(64, 48) + "colour = 1\n",
                )
                .unwrap();
            },
            words: &["capture.toml", "colour"],
        },
        Case {
            spoil: |c| {
                let text = capture_toml(64, 48).replace("fx = 60.0", "fx = nan");
                fs::write(c.join("capture.toml"), text).unwrap();
            },
            words: &["capture.toml", "fx"],
        },
        Case {
            spoil: |c| {
                let whole = fs::read(c.join("flash.png")).unwrap();
                fs::write(c.join("flash.png"), &whole[..whole.len() / 2]).unwrap();
            },
            words: &["flash.png"],
        },
        Case {
            // Declares 30000×30000 in its header.
            spoil: |c| {
                let mut bytes = fs::read(c.join("flash.png")).unwrap();
                bytes[16..24].copy_from_slice(&[0, 0, 0x75, 0x30, 0, 0, 0x75, 0x30]);
                fs::write(c.join("flash.png"), bytes).unwrap();
            },
            words: &["flash.png"],
        },
        Case {
            spoil: |c| fs::write(c.join("depth.png"), b"").unwrap(),
            words: &["depth.png"],
        },
        Case {
            spoil: |c| fs::write(c.join("ambient.png"), b"GIF89a").unwrap(),
            words: &["ambient.png"],
        },
        Case {
            spoil: |c| {
                let narrow =
                    image::ImageBuffer::from_pixel(SIZE.0 - 1, SIZE.1, image::Luma([900u16]));
                narrow.save(c.join("depth.png")).unwrap();
            },
            words: &["depth.png", "63×48", "64×48"],
        },
        Case {
            // Upright in a viewer, lying as it is stored.
            spoil: |c| as_jpeg(c, Some(6)),
            words: &[
                "flash.jpg",
                "EXIF orientation is 6",
                "capture.toml",
                "upright",
            ],
        },
        Case {
            spoil: |c| {
                as_jpeg(c, None);
                let whole = fs::read(c.join("flash.jpg")).unwrap();
                fs::write(c.join("flash.jpg"), &whole[..whole.len() / 2]).unwrap();
            },
            words: &["flash.jpg", "damaged"],
        },
    ];
    for Case { spoil, words } in cases {
        let folder = spoiled(spoil);
        relight(folder.path(), "capture").refuses(3, words);
        assert_eq!(names_in(folder.path()), ["capture"], "{words:?}");
    }
}

/// Puts a JPEG in the place of the flash photograph, with the orientation that EXIF gives it.
fn as_jpeg(capture: &Path, orientation: Option<u8>) {
    let flash = image::open(capture.join("flash.png")).unwrap().to_rgb8();
    fs::remove_file(capture.join("flash.png")).unwrap();
    flash.save(capture.join("flash.jpg")).unwrap();
    let Some(orientation) = orientation else {
        return;
    };
    let mut exif =
        b"\xff\xe1\0\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0]);
    let mut bytes = fs::read(capture.join("flash.jpg")).unwrap();
    bytes.splice(2..2, exif);
    fs::write(capture.join("flash.jpg"), bytes).unwrap();
}

#[test]
fn a_jpeg_that_lies_as_it_is_stored_is_read() {
    for orientation in [None, Some(1)] {
        let folder = spoiled(|capture| as_jpeg(capture, orientation));
        relight(folder.path(), "capture").succeeds();
    }
}

#[test]
fn depth_that_is_no_number_anywhere_is_no_depth() {
    let folder = spoiled(|capture| {
        fs::remove_file(capture.join("depth.png")).unwrap();
        let unknown = drivers::Plane::filled(SIZE.0 as usize, SIZE.1 as usize, f32::NAN);
        let bytes = captured::output::exr::gray(&unknown, captured::output::Precision::Float);
        fs::write(capture.join("depth.exr"), bytes.unwrap()).unwrap();
    });
    relight(folder.path(), "capture").refuses(6, &["depth"]);
    assert_eq!(names_in(folder.path()), ["capture"]);
}

#[test]
fn a_capture_without_any_depth_says_so_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    Capture {
        depth: false,
        ..Capture::GOOD
    }
    .write(&folder.path().join("capture"));
    relight(folder.path(), "capture").refuses(6, &["depth"]);
    assert_eq!(names_in(folder.path()), ["capture"]);
}

/// A shot that cannot be trusted is refused, or answered with a warning: never answered in silence.
#[track_caller]
fn is_refused_or_warned_about(capture: Capture, word: &str) {
    let folder = tempfile::tempdir().unwrap();
    capture.write(&folder.path().join("capture"));
    let ran = relight(folder.path(), "capture");
    ran.does_not_panic();
    assert!(ran.err.contains(word), "{ran:#?}");
    let wrote = folder.path().join("relit").exists();
    assert_eq!(wrote, ran.code == 0, "{ran:#?}");
    assert!(ran.code == 0 || ran.code == 6, "{ran:#?}");
    if wrote {
        let manifest = fs::read_to_string(folder.path().join("relit/shot.json")).unwrap();
        let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
        assert!(
            manifest["warnings"].to_string().contains(word),
            "{manifest}"
        );
    }
}

#[test]
fn a_shot_without_a_flash_signal_is_not_answered_in_silence() {
    is_refused_or_warned_about(
        Capture {
            flash: 0.0,
            ..Capture::GOOD
        },
        "flash",
    );
}

#[test]
fn a_shot_whose_flash_is_clipped_everywhere_is_not_answered_in_silence() {
    is_refused_or_warned_about(
        Capture {
            flash: 50.0,
            ..Capture::GOOD
        },
        "clipped",
    );
}

#[test]
fn a_shot_whose_flash_is_clipped_in_places_is_not_answered_in_silence() {
    is_refused_or_warned_about(
        Capture {
            flash: 1.55,
            ..Capture::GOOD
        },
        "clipped",
    );
}

#[test]
fn a_shot_whose_flash_is_nearly_lost_in_the_noise_is_not_answered_in_silence() {
    is_refused_or_warned_about(
        Capture {
            flash: 1e-5,
            ..Capture::GOOD
        },
        "flash",
    );
}

#[test]
fn a_recording_that_lies_anywhere_is_refused_by_name() {
    let whole = fs::read(recording("desk.mcap")).unwrap();
    for seventh in 0..7 {
        let folder = tempfile::tempdir().unwrap();
        let mut lying = whole.clone();
        let place = 9 + (whole.len() - 40) * seventh / 7;
        lying[place] ^= 0x55;
        fs::write(folder.path().join("lying.mcap"), lying).unwrap();
        capturectl(folder.path(), &["info", "lying.mcap"]).refuses(3, &["lying.mcap", "byte"]);
        // The first shot is all that is relit: what comes after it is not even read.
        if seventh < 4 {
            let arguments = [
                "relight",
                "lying.mcap",
                "--light",
                "0,0,1",
                "--out",
                "relit",
            ];
            capturectl(folder.path(), &arguments).refuses(3, &["lying.mcap", "byte"]);
            assert_eq!(names_in(folder.path()), ["lying.mcap"]);
        }
    }
}

#[test]
fn a_recording_cut_anywhere_is_refused_or_answered_with_what_is_whole() {
    let whole = fs::read(recording("desk.mcap")).unwrap();
    for tenth in 0..10 {
        let folder = tempfile::tempdir().unwrap();
        fs::write(
            folder.path().join("cut.mcap"),
            &whole[..whole.len() * tenth / 10],
        )
        .unwrap();
        let ran = capturectl(folder.path(), &["info", "cut.mcap"]);
        ran.does_not_panic();
        let named = ran.err.contains("cut.mcap") || ran.out.contains("cut.mcap");
        assert!(named && (ran.code == 0 || ran.code == 3), "{ran:#?}");
        if ran.code == 0 {
            assert!(
                ran.err.contains("cut at"),
                "an unfinished end goes unmentioned: {ran:#?}"
            );
        }
    }
}

#[test]
fn something_else_under_the_name_of_a_recording_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("noise.mcap"), [7u8; 4096]).unwrap();
    fs::write(folder.path().join("empty.mcap"), []).unwrap();
    for name in ["noise.mcap", "empty.mcap", "absent.mcap"] {
        let info = ["info", name];
        let relight = ["relight", name, "--light", "0,0,1", "--out", "relit"];
        for command in [&info[..], &relight[..]] {
            capturectl(folder.path(), command).refuses(3, &[name]);
        }
    }
    assert_eq!(names_in(folder.path()), ["empty.mcap", "noise.mcap"]);
}

#[test]
fn an_output_folder_that_exists_is_left_as_it_is() {
    let folder = spoiled(|_| {});
    fs::create_dir(folder.path().join("relit")).unwrap();
    fs::write(folder.path().join("relit/mine.txt"), "mine").unwrap();
    relight(folder.path(), "capture").refuses(5, &["relit", "exists"]);
    assert_eq!(names_in(&folder.path().join("relit")), ["mine.txt"]);
    assert_eq!(names_in(folder.path()), ["capture", "relit"]);
}

#[test]
fn an_output_folder_that_cannot_be_written_is_named() {
    let folder = spoiled(|_| {});
    let out = |out: &str| {
        capturectl(
            folder.path(),
            &["relight", "capture", "--light", "0,0,1", "--out", out],
        )
    };
    // A file stands where a folder is needed.
    out("capture/flash.png/relit").refuses(5, &["flash.png"]);
    // Rights do not bind root, under whom tests may run; /proc binds root too.
    out("/proc/relit").refuses(5, &["/proc"]);
    let locked = folder.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o500)).unwrap();
    let ran = out("locked/relit");
    ran.does_not_panic();
    assert!(
        ran.code == 5 || locked.join("relit/shot.json").is_file(),
        "{ran:#?}"
    );
}

#[test]
fn inputs_that_are_not_there_or_not_captures_are_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    for (input, word) in [("empty", "capture.toml"), ("absent", "absent")] {
        relight(folder.path(), input).refuses(3, &[word]);
        capturectl(folder.path(), &["info", input]).refuses(3, &[word]);
        capturectl(folder.path(), &["import", input]).refuses(3, &[word]);
        capturectl(folder.path(), &["eval", input]).refuses(3, &[word]);
    }
}
