//! Films: opened again, and their frames held against the stills of the same light.

use crate::{capturectl, names_in, recording};
use std::{fs::File, io::BufReader, path::Path};

const KEYS: &str = "\
[[key]]
seconds = 0
position = [-0.6, 0.4, -0.6]
intensity = [0.5, 0.5, 0.4]
[[key]]
seconds = 1
position = [0.6, 0.4, -0.6]
intensity = [0.5, 0.5, 0.4]
";

/// Every frame of an animated PNG, RGB, and its size.
fn frames(path: &Path) -> ((u32, u32), Vec<Vec<u8>>) {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap()))
        .read_info()
        .unwrap();
    let size = reader.info().size();
    let count = reader.info().animation_control().unwrap().num_frames;
    let frames = (0..count).map(|_| {
        let mut frame = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut frame).unwrap();
        frame
    });
    (size, frames.collect())
}

#[test]
fn the_frames_of_a_film_are_the_stills_of_its_moments() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("way.toml"), KEYS).unwrap();
    let desk = recording("desk.mcap");
    let words = [
        "film",
        desk.to_str().unwrap(),
        "--path",
        "way.toml",
        "--fps",
        "4",
    ];
    let closed = ["--tier", "closed", "--out", "way.apng", "--json"];
    let ran = capturectl(folder.path(), &[&words[..], &closed].concat());
    let told = ran.succeeds().json();
    assert_eq!(
        (told["frames"].as_u64(), told["seconds"].as_f64()),
        (Some(4), Some(1.0))
    );
    assert_eq!(names_in(folder.path()), ["way.apng", "way.toml"]);
    let (size, film) = frames(&folder.path().join("way.apng"));
    assert_eq!(film.len(), 4);

    // The second frame is a quarter of the way along.
    let lights = "[[light]]\nposition = [-0.3, 0.4, -0.6]\nintensity = [0.5, 0.5, 0.4]\n";
    std::fs::write(folder.path().join("lights.toml"), lights).unwrap();
    let words = ["relight", desk.to_str().unwrap(), "--lights", "lights.toml"];
    let closed = ["--tier", "closed", "--out", "still"];
    capturectl(folder.path(), &[&words[..], &closed].concat()).succeeds();
    let still = image::open(folder.path().join("still/relit_000.png"))
        .unwrap()
        .into_rgba8();
    assert_eq!(still.dimensions(), size);
    let pixels = still.pixels().zip(film[1].chunks(3));
    // The scale of this scene is known, so both have one exposure; what is unknown is transparent.
    let known = pixels.filter(|(still, _)| still.0[3] == 255);
    let apart = known.map(|(still, film)| (0..3).map(|c| still.0[c].abs_diff(film[c])).max());
    let apart: Vec<u8> = apart.flatten().collect();
    assert!(apart.len() > 40_000);
    let differ = apart.iter().filter(|apart| **apart > 1).count();
    assert!(differ * 1000 < apart.len(), "{differ} of {}", apart.len());
    // Another frame is another picture.
    let moved = film[1]
        .iter()
        .zip(&film[2])
        .filter(|(a, b)| a.abs_diff(**b) > 8);
    assert!(moved.count() > 1000);
}

#[test]
fn an_environment_turns_once_around_in_a_small_film() {
    let folder = tempfile::tempdir().unwrap();
    let sky = |x: u32, y: u32| {
        let sun = (28..32).contains(&x) && (6..9).contains(&y);
        image::Rgb(if sun {
            [30.0, 28.0, 20.0]
        } else {
            [0.2, 0.3, 0.5]
        })
    };
    image::Rgb32FImage::from_fn(64, 32, sky)
        .save(folder.path().join("sky.hdr"))
        .unwrap();
    let desk = recording("desk.mcap");
    let film = |more: &[&str]| {
        let words = [
            "film",
            desk.to_str().unwrap(),
            "--tier",
            "closed",
            "--path",
            "turn",
        ];
        capturectl(folder.path(), &[&words[..], more].concat())
    };
    film(&["--out", "turn.webp"]).refuses(2, &["--environment"]);
    let sky = [
        "--environment",
        "sky.hdr",
        "--seconds",
        "0.5",
        "--fps",
        "12",
    ];
    let made = film(&[&sky[..], &["--width", "100", "--out", "turn.webp"]].concat());
    made.succeeds();
    let bytes = std::fs::read(folder.path().join("turn.webp")).unwrap();
    let decoder = webp_animation::Decoder::new(&bytes).unwrap();
    assert_eq!(decoder.dimensions(), (100, 75));
    assert_eq!(decoder.into_iter().count(), 6);

    // A still with the environment turned to where a frame has it is that frame.
    film(&[&sky[..], &["--out", "turn.apng"]].concat()).succeeds();
    let (_, shown) = frames(&folder.path().join("turn.apng"));
    let words = [
        "relight",
        desk.to_str().unwrap(),
        "--tier",
        "closed",
        "--out",
        "still",
    ];
    let turned = ["--environment", "sky.hdr", "--rotate-environment", "60"];
    capturectl(folder.path(), &[&words[..], &turned].concat()).succeeds();
    let still = image::open(folder.path().join("still/relit_000.png"))
        .unwrap()
        .into_rgba8();
    let pixels = still
        .pixels()
        .zip(shown[1].chunks(3))
        .filter(|(still, _)| still.0[3] == 255);
    let apart = pixels.map(|(still, film)| f64::from(still.0[1].abs_diff(film[1])));
    let mean = apart.sum::<f64>() / f64::from(still.width() * still.height());
    assert!(mean < 1.0, "{mean}");
}

#[test]
fn films_that_cannot_be_are_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let bad = KEYS.replace("seconds = 1", "seconds = -1");
    std::fs::write(folder.path().join("bad.toml"), bad).unwrap();
    std::fs::write(folder.path().join("taken.webp"), "mine").unwrap();
    let desk = recording("desk.mcap");
    let before = names_in(folder.path());
    for (words, code, told) in [
        (&["--path", "orbit", "--out", "a.mp4"][..], 2, "--out a.mp4"),
        (&["--path", "spiral", "--out", "a.webp"], 2, "orbit"),
        (&["--path", "orbit:300", "--out", "a.webp"], 2, "300"),
        (&["--path", "bad.toml", "--out", "a.webp"], 2, "bad.toml"),
        (
            &["--path", "orbit", "--out", "a.webp", "--seconds", "1000"],
            2,
            "24000 frames",
        ),
        (
            &["--path", "orbit", "--out", "a.webp", "--seconds", "0"],
            2,
            "frames",
        ),
        (
            &["--path", "orbit", "--out", "a.webp", "--seconds", "nan"],
            2,
            "frames",
        ),
        (
            &["--path", "orbit", "--out", "a.webp", "--budget", "50ms"],
            2,
            "--budget",
        ),
        (&["--path", "orbit", "--out", "taken.webp"], 5, "taken.webp"),
        (&["--path", "orbit", "--out", "absent/a.webp"], 5, "absent"),
    ] {
        let words = [&["film", desk.to_str().unwrap()][..], words].concat();
        capturectl(folder.path(), &words).refuses(code, &[told]);
        assert_eq!(names_in(folder.path()), before, "{words:?}");
    }
    assert_eq!(
        std::fs::read(folder.path().join("taken.webp")).unwrap(),
        b"mine"
    );
}

#[test]
fn an_interrupted_film_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let mut child = crate::command(folder.path())
        .args([
            "film",
            desk.to_str().unwrap(),
            "--path",
            "orbit",
            "--seconds",
            "100",
        ])
        .args(["--tier", "closed", "--out", "long.apng"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Once the unfinished file grows, frames are being made.
    let growing = || {
        let mut names = names_in(folder.path()).into_iter();
        let name = names.find(|name| name.starts_with(".partial-"))?;
        let length = std::fs::metadata(folder.path().join(name)).ok()?.len();
        (length > 100_000).then_some(())
    };
    let began = std::time::Instant::now();
    while growing().is_none() && began.elapsed().as_secs() < 120 {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let interrupt = format!("kill -INT {}", child.id());
    let sent = std::process::Command::new("sh")
        .args(["-c", &interrupt])
        .status();
    assert!(sent.unwrap().success());
    let output = child.wait_with_output().unwrap();
    let ran = crate::ran(&output);
    ran.refuses(5, &["long.apng", "interrupted after"]);
    assert!(
        names_in(folder.path()).is_empty(),
        "{:?}",
        names_in(folder.path())
    );
}
