//! Everything that takes bytes from outside, one function each: what a fuzzer calls with what it makes
//! up, and `tests/fuzz.rs` with mutations of `fuzz/corpus`.
//!
//! Each says whether it took the bytes. None may panic, whatever they are.

use captured::{
    api::{CheckedLights, Light, RelightRequest, ShotRequest, ViewRequest},
    config::Config,
    folder::{self, Limits, RigFile, decode::decode_bytes_limited},
    inference,
    output::{Disk, Manifest},
    radiometry::linearise,
    shot,
};
use drivers::{
    ColorFrame, Device, DriverError, Exposure, Frame, Illumination, Pixels, Settings, Timestamp,
    Transfer, depthai, flaky::Faults, replay::Replay, synthetic, v4l,
};
use serde::de::DeserializeOwned;
use std::{path::Path, time::Duration};

/// What reads bytes, and says whether it took them.
pub type Parser = fn(&[u8]) -> bool;

/// Name of the corpus, and what reads it.
pub const PARSERS: [(&str, Parser); 11] = [
    ("address", address),
    ("camera", camera),
    ("camera_jpeg", camera_jpeg),
    ("capture", capture),
    ("config", config),
    ("image", image),
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

/// The file of a camera and its flash.
pub fn camera(bytes: &[u8]) -> bool {
    in_a_file("camera.toml", bytes, |path| {
        path.to_str()
            .is_some_and(|path| v4l::Plan::parse(path).is_ok())
    })
}

/// A picture that a camera compressed, inside a frame.
pub fn camera_jpeg(bytes: &[u8]) -> bool {
    let frame = |at, light| ColorFrame {
        at: Timestamp::from_nanos(at),
        sequence: at,
        light,
        exposure: Exposure {
            seconds: 0.01,
            gain: 1.0,
        },
        pixels: Pixels::Mjpg {
            width: 16,
            height: 16,
            bytes: bytes.to_vec(),
        },
        transfer: Transfer::Srgb,
        black_level: 0.0,
        white_level: 1.0,
    };
    let desk = synthetic::Options::parse("desk?width=64&height=64").map(synthetic::Synthetic::new);
    let mut rig = desk.expect("the address is good").rig();
    (rig.color.width, rig.color.height) = (16, 16);
    let mut assembler = shot::Assembler::new(rig, shot::Limits::default());
    for (at, light) in [
        (1, Illumination::Ambient),
        (2, Illumination::Flash),
        (3, Illumination::Ambient),
    ] {
        assembler.push(Frame::Color(frame(at, light)));
    }
    linearise(&frame(1, Illumination::Ambient)).is_ok()
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
