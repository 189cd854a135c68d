//! The guest: its virtual hardware, and what this process holds of its resources.

use drivers::{Device, DriverError, Frame, Illumination, Pixels, Stream};
use std::{
    fs,
    path::Path,
    time::{Duration, Instant},
};

pub const PATIENCE: Duration = Duration::from_secs(2);

/// Writes to a file of sysfs.
pub fn write(path: &str, text: &str) {
    fs::write(path, text).unwrap_or_else(|error| panic!("{path}: {error}"));
}

/// Reads a number from a file of sysfs.
pub fn number(path: &str) -> i64 {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{path}: {error}"));
    match text.trim() {
        "Y" => 1,
        "N" => 0,
        digits => digits
            .parse()
            .unwrap_or_else(|_| panic!("{path} is {text:?}")),
    }
}

/// Sets a control of a node by its number, through a file of its own.
pub fn set_control(node: &str, id: u32, value: i64) {
    let device = v4l::Device::with_path(node).unwrap_or_else(|error| panic!("{node}: {error}"));
    let control = v4l::Control {
        id,
        value: v4l::control::Value::Integer(value),
    };
    device
        .set_control(control)
        .unwrap_or_else(|error| panic!("{node}, control {id:#x}: {error}"));
}

/// Reads a control of a node by its number.
pub fn control(node: &str, id: u32) -> i64 {
    let device = v4l::Device::with_path(node).unwrap_or_else(|error| panic!("{node}: {error}"));
    match device.control(id).map(|control| control.value) {
        Ok(v4l::control::Value::Integer(value)) => value,
        other => panic!("{node}, control {id:#x}: {other:?}"),
    }
}

/// Open files, threads, and resident memory in KiB of this process.
pub fn held() -> (usize, usize, i64) {
    held_by(std::process::id())
}

/// [`held`] of another process.
pub fn held_by(process: u32) -> (usize, usize, i64) {
    let count = |folder: &str| {
        let entries = fs::read_dir(format!("/proc/{process}/{folder}"));
        entries.unwrap().count()
    };
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let resident = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))
        .and_then(|rest| rest.split_whitespace().next())
        .unwrap();
    (count("fd"), count("task"), resident.parse().unwrap())
}

/// Whether this is the long form of the tests.
pub fn is_long() -> bool {
    std::env::var_os("GUEST_LONG").is_some()
}

/// Frames until `count` color frames have come.
pub fn color_frames(stream: &mut dyn Stream, count: usize) -> Vec<Frame> {
    let mut found = Vec::new();
    while found.len() < count {
        let frame = stream.next_frame(PATIENCE).unwrap();
        if matches!(frame, Frame::Color(_)) {
            found.push(frame);
        }
    }
    found
}

/// Asks for frames until the stream fails, and answers how, and how long that took.
pub fn failure(stream: &mut dyn Stream, within: Duration) -> (DriverError, Duration) {
    let since = Instant::now();
    loop {
        match stream.next_frame(PATIENCE) {
            Ok(_) => assert!(since.elapsed() < within, "frames keep coming"),
            Err(error) => return (error, since.elapsed()),
        }
    }
}

/// Starts anew until frames of both cameras come, and answers how long that took.
pub fn recovery(device: &mut dyn Device, within: Duration) -> Duration {
    let since = Instant::now();
    loop {
        let began = device.start(&drivers::Settings::default());
        let frame =
            began.and_then(|mut stream| color_frames_or(stream.as_mut()).map(|()| stream.losses()));
        match frame {
            Ok(_) => return since.elapsed(),
            Err(error) => {
                assert!(since.elapsed() < within, "no frames again: {error}");
                std::thread::sleep(Duration::from_millis(5));
            }
        }
    }
}

fn color_frames_or(stream: &mut dyn Stream) -> Result<(), DriverError> {
    loop {
        if let Frame::Color(_) = stream.next_frame(PATIENCE)? {
            return Ok(());
        }
    }
}

/// Mean luma of a YUYV frame, 0 to 255.
pub fn luma(pixels: &Pixels) -> f64 {
    let Pixels::Yuyv { bytes, .. } = pixels else {
        panic!("not YUYV")
    };
    let sum: u64 = bytes.iter().step_by(2).map(|v| u64::from(*v)).sum();
    sum as f64 / (bytes.len() / 2) as f64
}

/// Mean luma of flash and of ambient frames.
pub fn lumas(frames: &[Frame]) -> (Vec<f64>, Vec<f64>) {
    let (mut flash, mut ambient) = (vec![], vec![]);
    for frame in frames {
        if let Frame::Color(color) = frame {
            match color.light {
                Illumination::Flash => flash.push(luma(&color.pixels)),
                Illumination::Ambient => ambient.push(luma(&color.pixels)),
            }
        }
    }
    (flash, ambient)
}

/// Waits for a file to be there.
pub fn wait_for(path: &str) {
    let since = Instant::now();
    while !Path::new(path).exists() {
        assert!(
            since.elapsed() < Duration::from_secs(10),
            "{path} does not come"
        );
        std::thread::sleep(Duration::from_millis(2));
    }
}
