//! The bridge with the vendor's real library: a recording that the library itself wrote, played by its
//! replay nodes in a pipeline that needs no device.
//!
//! Needs a Python with the packages depthai and numpy: `python3`, or the program that
//! `CAPTURED_DEPTHAI_PYTHON` names. Without it the test is skipped, and says so.

use drivers::{DriverError, Frame, Illumination, Pixels, Settings, open};
use std::{path::Path, process::Command, time::Duration};

/// Records 40 frames of 160×120 with DepthAI's RecordVideo, 33 ms apart, frame k of red 2k; and depth
/// of 1000 + k millimetres with a hole.
const RECORD: &str = r#"
import datetime, json, os, sys, time
import depthai as dai, numpy as np
folder, W, H, N = sys.argv[1], 160, 120, 40
class Source(dai.node.ThreadedHostNode):
    def __init__(self):
        super().__init__()
        self.out = self.createOutput()
    def run(self):
        for k in range(N):
            image = np.full((H, W, 3), (20, 100, 2 * k + 60), np.uint8)  # blue, green, red
            frame = dai.ImgFrame()
            frame.setType(dai.ImgFrame.Type.BGR888i)
            frame.setWidth(W); frame.setHeight(H); frame.setStride(3 * W)
            frame.setData(image.ravel()); frame.setSequenceNum(k)
            at = datetime.timedelta(milliseconds=10_000 + 33 * k)
            frame.setTimestamp(at); frame.setTimestampDevice(at)
            self.out.send(frame)
            time.sleep(0.02)
pipeline = dai.Pipeline(False)
source = pipeline.create(Source)
record = pipeline.create(dai.node.RecordVideo)
record.setRecordVideoFile(os.path.join(folder, "color.avi"))
record.setRecordMetadataFile(os.path.join(folder, "color.mcap"))
source.out.link(record.input)
pipeline.start(); time.sleep(0.02 * N + 1.5); pipeline.stop(); pipeline.wait()
depth = np.empty((N, 60, 80), np.uint16)
depth[:] = (1000 + np.arange(N))[:, None, None]
depth[:, 5, 7] = 0
np.save(os.path.join(folder, "depth.npy"), depth)
np.save(os.path.join(folder, "amplitude.npy"), depth // 10)
def lens(w, h):
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return dict(width=w, height=h, fx=0.8 * w, fy=0.8 * w, cx=w / 2 - 0.5, cy=h / 2 - 0.5,
                distortion=dict.fromkeys(names, 0.0))
rig = dict(model="OAK-D SR-PoE", id="REPLAY", color=lens(W, H), depth=lens(80, 60),
           rotation=[[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_metres=[-0.02, 0, 0],
           exposure=dict(seconds=0.008, gain=2.0))
with open(os.path.join(folder, "rig.json"), "w") as file:
    json.dump(rig, file)
"#;

/// The Python that has the package.
fn python() -> Option<String> {
    let python = std::env::var("CAPTURED_DEPTHAI_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let loads = Command::new(&python)
        .args(["-c", "import depthai, numpy"])
        .output();
    match loads {
        Ok(output) if output.status.success() => Some(python),
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr);
            let why = said.lines().last().unwrap_or("no reason given");
            eprintln!(
                "SKIPPED: {python} has no depthai ({why}); pip install depthai==3.12.0 numpy"
            );
            None
        }
        Err(error) => {
            eprintln!("SKIPPED: {python} cannot be run ({error})");
            None
        }
    }
}

fn recorded(python: &str, folder: &Path) {
    let output = Command::new(python)
        .args(["-c", RECORD, folder.to_str().unwrap()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}

#[test]
fn a_recording_comes_through_the_vendors_library_with_its_times_and_its_rig() {
    let Some(python) = python() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    recorded(&python, folder.path());
    let address = format!(
        "depthai:?replay={}&width=160&height=120&python={python}",
        folder.path().display()
    );
    let mut device = open(&address).unwrap();
    let (info, rig) = (device.info(), device.rig());
    assert!(
        info.finite && info.model.contains("OAK-D SR-PoE"),
        "{info:?}"
    );
    assert_eq!((rig.color.fx, rig.color.size()), (128.0, (160, 120)));
    let camera = rig.depth.unwrap();
    assert_eq!(camera.to_color.translation_metres.x, -0.02);

    let settings = Settings::default();
    let mut stream = device.start(&settings).unwrap();
    let (mut colors, mut depths) = (Vec::new(), Vec::new());
    let end = loop {
        match stream.next_frame(Duration::from_secs(20)) {
            Ok(Frame::Color(frame)) => colors.push(frame),
            Ok(Frame::Depth(frame)) => depths.push(frame),
            Err(error) => break error,
        }
    };
    drop(stream);
    assert!(matches!(end, DriverError::Ended { .. }), "{end}");
    assert!(
        colors.len() >= 15 && depths.len() >= 15,
        "{} {}",
        colors.len(),
        depths.len()
    );
    for frame in &colors {
        assert_eq!(frame.light, Illumination::Ambient);
        assert_eq!((frame.exposure.seconds, frame.exposure.gain), (0.008, 2.0));
        let Pixels::Rgb8(pixels) = &frame.pixels else {
            panic!("{:?}", frame.pixels.size());
        };
        let [red, green, blue] = pixels[(80, 60)].map(i32::from);
        // The recording is compressed.
        let true_red = 60 + 2 * frame.sequence as i32;
        let near = |value: i32, truth: i32| (value - truth).abs() <= 6;
        assert!(
            near(red, true_red) && near(green, 100) && near(blue, 20),
            "frame {}: {red} {green} {blue}, recorded {true_red} 100 20",
            frame.sequence
        );
    }
    // Frames of one device keep its own clock's spacing, however they came.
    for pair in colors.windows(2) {
        let frames = pair[1].sequence - pair[0].sequence;
        let apart = pair[1].at.distance(pair[0].at).as_secs_f64() * 1e3;
        assert!(
            (apart - 33.0 * frames as f64).abs() < 15.0,
            "{apart} ms for {frames} frames"
        );
    }
    for frame in &depths {
        let metres = frame.metres[(40, 30)];
        assert!(
            (metres - 1.0 - 1e-3 * frame.sequence as f32).abs() < 0.05,
            "{metres}"
        );
        assert!(frame.metres[(7, 5)].is_nan(), "a hole is no distance");
        let amplitude = frame.amplitude.as_ref().unwrap();
        assert!((amplitude[(40, 30)] - 100.0 * metres).abs() <= 1.0);
    }
    // It can be started again, from the beginning.
    let mut stream = device.start(&settings).unwrap();
    let again = stream.next_frame(Duration::from_secs(20)).unwrap();
    assert!(
        again.sequence() <= colors[0].sequence + 1,
        "{}",
        again.sequence()
    );
}

#[test]
fn a_recording_that_is_not_there_or_no_recording_is_refused_by_name() {
    let Some(python) = python() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let address = format!(
        "depthai:?replay={}&python={python}",
        folder.path().display()
    );
    let refused = open(&address).err().unwrap().to_string();
    assert!(refused.contains("rig.json"), "{refused}");
    std::fs::write(folder.path().join("rig.json"), "{}").unwrap();
    std::fs::write(folder.path().join("depth.npy"), "no array").unwrap();
    let refused = open(&address).err().unwrap().to_string();
    assert!(
        refused.contains(folder.path().to_str().unwrap()),
        "{refused}"
    );
}

#[test]
fn without_a_device_or_a_python_the_message_says_what_is_missing() {
    let refused = open("depthai:").err();
    // On a computer with such a device, opening it is somebody else's test.
    if let Some(error) = refused {
        assert!(error.to_string().contains("03e7"), "{error}");
    }
    let refused = open("depthai:?replay=/tmp&python=/no/such/python")
        .err()
        .unwrap();
    let message = refused.to_string();
    assert!(
        message.contains("/no/such/python") && message.contains("install Python"),
        "{message}"
    );
}
