//! Everything that takes bytes from outside, one function each: what a fuzzer calls with what it makes
//! up, and `tests/fuzz.rs` with mutations of `fuzz/corpus`.
//!
//! Each says whether it took the bytes. None may panic, whatever they are.

use captured::{
    api::{CheckedLights, Light, RelightRequest, ShotRequest, ViewRequest},
    commands::{CommandError, CommandLine},
    config::Config,
    folder::{self, Limits, RigFile, decode::decode_bytes_limited},
    inference,
    output::{Disk, Manifest},
    radiometry::linearise,
    shot,
};
use clap::Parser as _;
use drivers::{
    ColorFrame, DepthFrame, Device, DriverError, Exposure, Frame, Illumination, Pixels, Settings,
    Timestamp, Transfer, depthai,
    flaky::Faults,
    replay::Replay,
    synthetic, v4l,
    wire::{Claim, Transcript},
};
use serde::de::DeserializeOwned;
use std::{ffi::OsStr, path::Path, time::Duration};

/// What reads bytes, and says whether it took them.
pub type Parser = fn(&[u8]) -> bool;

/// Name of the corpus, and what reads it.
pub const PARSERS: [(&str, Parser); 15] = [
    ("address", address),
    ("bridge", bridge),
    ("camera", camera),
    ("camera_jpeg", camera_jpeg),
    ("capture", capture),
    ("config", config),
    ("frame", frame),
    ("image", image),
    ("keys", keys),
    ("lights", lights),
    ("manifest", manifest),
    ("onnx", onnx),
    ("recording", recording),
    ("request", request),
    ("rig", rig),
];

/// The address of a device, as people type it.
pub fn address(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return false;
    };
    let (driver, rest) = text.split_once(':').unwrap_or_default();
    match driver {
        "synthetic" => synthetic::Options::parse(rest).is_ok(),
        "depthai" => depthai::Options::parse(rest).is_ok(),
        "flaky" => rest.split_once(':').is_some_and(|(faults, inner)| {
            Faults::parse(faults).is_ok() && address(inner.as_bytes())
        }),
        _ => false,
    }
}

/// What the bridge of an OAK camera says, after a line with how the camera was asked for.
pub fn bridge(bytes: &[u8]) -> bool {
    let Some(end) = bytes.iter().position(|byte| *byte == b'\n') else {
        return false;
    };
    let asked = std::str::from_utf8(&bytes[..end]).ok();
    let Some(options) = asked.and_then(|text| depthai::Options::parse(text).ok()) else {
        return false;
    };
    let transcript = Transcript {
        said: &bytes[end + 1..],
        memory: &[7; 1 << 13],
    };
    let mut delivered = 0;
    let ended = transcript.play(&options, &mut |frame| {
        let size = match &frame {
            Frame::Color(color) => color.pixels.size(),
            Frame::Depth(depth) => depth.metres.size(),
        };
        assembler(size).push(frame);
        delivered += 1;
    });
    ended.is_ok() && delivered > 0
}

/// The file of a camera and its flash.
pub fn camera(bytes: &[u8]) -> bool {
    in_a_file("camera.toml", bytes, |path| {
        path.to_str()
            .is_some_and(|path| v4l::Plan::parse(path).is_ok())
    })
}

/// A picture that a camera compressed, inside a frame.
pub fn camera_jpeg(bytes: &[u8]) -> bool {
    bracket(&Pixels::Mjpg {
        width: 16,
        height: 16,
        bytes: bytes.to_vec(),
    })
}

/// A buffer of a V4L2 camera, after what the camera says of it: four characters of the format; width and
/// height, 16 bits each; color space, transfer function, encoding and range, a byte each; the number of
/// planes; of each plane its stride and its length, 32 bits each; then the planes. All little endian.
pub fn frame(bytes: &[u8]) -> bool {
    let Some(claim) = claimed(bytes) else {
        return false;
    };
    let depth = claim.depth(0.001, 10.0).map(|metres| {
        let amplitude = claim.amplitude().expect("as sound as the depth of it");
        let frame = DepthFrame {
            at: Timestamp::from_nanos(2),
            sequence: 1,
            metres,
            amplitude: Some(amplitude),
            sigma: None,
        };
        assembler(frame.metres.size()).push(Frame::Depth(frame));
    });
    let color = claim.picture().map(|pixels| bracket(&pixels));
    depth.is_ok() || color == Ok(true)
}

fn claimed(bytes: &[u8]) -> Option<Claim<'_>> {
    let (code, rest) = bytes.split_first_chunk::<4>()?;
    let (&[w0, w1, h0, h1], rest) = rest.split_first_chunk::<4>()?;
    let (color, rest) = rest.split_first_chunk::<4>()?;
    let (count, mut rest) = rest.split_first()?;
    let mut told = Vec::new();
    for _ in 0..*count {
        let (numbers, after) = rest.split_first_chunk::<8>()?;
        let (words, _) = numbers.as_chunks::<4>();
        told.push([words[0], words[1]].map(|word| u32::from_le_bytes(word) as usize));
        rest = after;
    }
    let planes = told.into_iter().map(|[stride, length]| {
        let (plane, after) = rest.split_at(length.min(rest.len()));
        rest = after;
        (stride, plane)
    });
    Some(Claim {
        code: *code,
        width: u16::from_le_bytes([w0, w1]).into(),
        height: u16::from_le_bytes([h0, h1]).into(),
        color: color.map(u32::from),
        planes: planes.collect(),
    })
}

/// Puts a picture into a flash and into ambient frames, and says whether its light can be had.
fn bracket(pixels: &Pixels) -> bool {
    let frame = |at, light| ColorFrame {
        at: Timestamp::from_nanos(at),
        sequence: at,
        light,
        exposure: Exposure {
            seconds: 0.01,
            gain: 1.0,
        },
        pixels: pixels.clone(),
        transfer: Transfer::Srgb,
        black_level: 0.0,
        white_level: 1.0,
    };
    let mut assembler = assembler(pixels.size());
    for (at, light) in [
        (1, Illumination::Ambient),
        (2, Illumination::Flash),
        (3, Illumination::Ambient),
    ] {
        assembler.push(Frame::Color(frame(at, light)));
    }
    linearise(&frame(1, Illumination::Ambient)).is_ok()
}

/// For pictures of this size, from both cameras.
fn assembler((width, height): (usize, usize)) -> shot::Assembler {
    let desk = synthetic::Options::parse("desk?width=64&height=64").map(synthetic::Synthetic::new);
    let mut rig = desk.expect("the address is good").rig();
    (rig.color.width, rig.color.height) = (width, height);
    if let Some(depth) = &mut rig.depth {
        (depth.lens.width, depth.lens.height) = (width, height);
    }
    shot::Assembler::new(rig, shot::Limits::default())
}

/// `capture.toml` beside no picture: only the text is asked about.
pub fn capture(bytes: &[u8]) -> bool {
    in_a_file("capture.toml", bytes, |path| {
        let read = folder::read(path.parent().unwrap_or(path));
        // Whoever gets that far misses the photograph.
        matches!(&read, Err(folder::FolderError::Missing { path, .. }) if !path.ends_with("capture.toml"))
    })
}

/// `captured.toml`.
pub fn config(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes)
        .is_ok_and(|text| Config::parse(text, Path::new("captured.toml")).is_ok())
}

/// A picture file: PNG, OpenEXR, JPEG or Radiance.
pub fn image(bytes: &[u8]) -> bool {
    let limits = Limits {
        max_pixels: 1 << 16,
        max_side: 1 << 12,
    };
    decode_bytes_limited(Path::new("picture"), bytes, None, limits).is_ok()
}

/// The keys of a light that moves, of `film --path`; an environment turns with it.
pub fn keys(bytes: &[u8]) -> bool {
    in_a_file("keys.toml", bytes, |path| {
        let beside = |name| path.with_file_name(name);
        let (sky, film) = (beside("sky.hdr"), beside("film.webp"));
        std::fs::write(&sky, SKY).expect("a file can be written");
        let paths = [("--path", path), ("--environment", &sky), ("--out", &film)];
        misses_only_the_capture("film", path, &paths)
    })
}

/// A map of light from all around, 4×2.
const SKY: &[u8] = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n\
    @@p\x81@@p\x81@@p\x81p@@\x82@p@\x80@p@\x80@p@\x80@p@\x80";

/// The file of `--lights`.
pub fn lights(bytes: &[u8]) -> bool {
    in_a_file("lights.toml", bytes, |path| {
        let out = path.with_file_name("relit");
        misses_only_the_capture("relight", path, &[("--lights", path), ("--out", &out)])
    })
}

/// Runs a command on a capture beside `file` that is not there, which is found out after all files of lights
/// have been read.
fn misses_only_the_capture(command: &str, file: &Path, given: &[(&str, &Path)]) -> bool {
    let [capture, config] = ["capture", "captured.toml"].map(|name| file.with_file_name(name));
    std::fs::write(&config, "").expect("a file can be written");
    let mut words: Vec<&OsStr> = ["capturectl", command, "--tier", "closed"]
        .map(OsStr::new)
        .to_vec();
    words.extend([capture.as_os_str(), "--config".as_ref(), config.as_os_str()]);
    for (name, path) in given {
        words.extend([OsStr::new(name), path.as_os_str()]);
    }
    let Ok(line) = CommandLine::try_parse_from(words) else {
        return false;
    };
    match line.run() {
        Err(CommandError::Input(missed)) => missed.path == capture,
        _ => false,
    }
}

/// `shot.json`.
pub fn manifest(bytes: &[u8]) -> bool {
    in_a_file("shot.json", bytes, |path| {
        Manifest::read(&Disk, path.parent().unwrap_or(path)).is_ok()
    })
}

/// A model, before a runtime sees it.
pub fn onnx(bytes: &[u8]) -> bool {
    inference::inspect(bytes).is_ok()
}

/// A recording, to its last frame.
pub fn recording(bytes: &[u8]) -> bool {
    in_a_file("shot.mcap", bytes, |path| {
        let Ok(mut replay) = Replay::open(path) else {
            return false;
        };
        let mut assembler = shot::Assembler::new(replay.rig(), shot::Limits::default());
        let Ok(mut stream) = replay.start(&Settings::default()) else {
            return false;
        };
        loop {
            match stream.next_frame(Duration::ZERO) {
                Ok(frame) => drop(assembler.push(frame)),
                Err(error) => return matches!(error, DriverError::Ended { .. }),
            }
        }
    })
}

/// The body of a request, and a light as people type it.
pub fn request(bytes: &[u8]) -> bool {
    fn read<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
        serde_json::from_slice(bytes).ok()
    }
    let mut taken = std::str::from_utf8(bytes).is_ok_and(|text| text.parse::<Light>().is_ok());
    if let Some(shot) = read::<ShotRequest>(bytes) {
        taken |= CheckedLights::new(&shot.lights, 64, shot.environment.as_ref()).is_ok()
            && shot.check_burst(32).is_ok();
    }
    if let Some(again) = read::<RelightRequest>(bytes) {
        taken |= CheckedLights::new(&again.lights, 64, again.environment.as_ref()).is_ok();
    }
    if let Some(view) = read::<ViewRequest>(bytes) {
        taken |= CheckedLights::new(&view.lights, 8, view.environment.as_ref()).is_ok();
    }
    taken
}

/// `rig.toml`.
pub fn rig(bytes: &[u8]) -> bool {
    in_a_file("rig.toml", bytes, |path| RigFile::read(path).is_ok())
}

/// Asks about bytes that are read from a file.
fn in_a_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path) -> bool) -> bool {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file can be written");
    read(&path)
}
