//! The kernel's cameras as webcams, through the crate nokhwa: what of the contract a camera without depth
//! can uphold, an unplug, and what cannot be opened.

use crate::machine::{PATIENCE, color_frames, held, set_control, wait_for, write};
use crate::usb::Plugged;
use drivers::{
    DriverError, Frame, Illumination, Pixels, Settings, contract, contract::Verdict, open,
};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

const WEBCAM: &str = "nokhwa:0?width=320&height=180&rate=25";
const NODE: &str = "/dev/video0";
/// `V4L2_CID_BRIGHTNESS`.
const BRIGHTNESS: u32 = 0x0098_0900;

/// Does `work` while a person flashes, who looks at no clock.
fn while_flashing<T>(node: &str, (on, off): (i64, i64), work: impl FnOnce() -> T) -> T {
    let over = AtomicBool::new(false);
    set_control(node, BRIGHTNESS, off);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for pause in (0..).map(|n| 250 + n * 37 % 100) {
                std::thread::sleep(Duration::from_millis(pause));
                if over.load(Ordering::Relaxed) {
                    break;
                }
                set_control(node, BRIGHTNESS, on);
                std::thread::sleep(Duration::from_millis(150));
                set_control(node, BRIGHTNESS, off);
            }
        });
        let answer = work();
        over.store(true, Ordering::Relaxed);
        answer
    })
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_webcam_upholds_the_contract_but_for_depth_which_it_has_none_of() {
    for format in ["YUYV", "NV12", "RGB"] {
        let address = format!("{WEBCAM}&format={format}");
        let report = while_flashing(NODE, (200, 100), || {
            contract::check(open(&address).unwrap().as_mut(), 40, &mut |_| {})
        });
        let failed: Vec<&str> = report
            .claims
            .iter()
            .filter(|claim| claim.verdict == Verdict::Fail)
            .map(|claim| claim.name.as_str())
            .collect();
        assert_eq!(failed, ["depth_appears"], "{format}: {:#?}", report.claims);
        let lights = report.claim("both_lights_appear").unwrap();
        eprintln!(
            "{format} through nokhwa: {}; {:?}",
            lights.evidence, report.losses
        );
    }
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn the_light_of_jpeg_pictures_is_told_by_what_they_show() {
    let _plugged = Plugged::new(&[]);
    let address = "nokhwa:1?width=640&height=480&rate=15&format=MJPG";
    let (frames, losses) = while_flashing("/dev/video1", (200, 100), || {
        let mut device = open(address).unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        let frames = color_frames(stream.as_mut(), 40);
        (frames, stream.losses())
    });
    let (mut flash, mut ambient) = (Vec::new(), Vec::new());
    for frame in &frames {
        let Frame::Color(frame) = frame else { continue };
        let Pixels::Mjpg { bytes, .. } = &frame.pixels else {
            panic!("MJPG was asked for")
        };
        assert!(bytes.ends_with(&[0xff, 0xd9]), "nothing after the picture");
        let luma = drivers::luma_of_jpeg(bytes, 640, 480).unwrap();
        let mean = luma.iter().map(|v| u64::from(*v)).sum::<u64>() / luma.len() as u64;
        match frame.light {
            Illumination::Flash => flash.push(mean),
            Illumination::Ambient => ambient.push(mean),
        }
    }
    let (darkest, brightest) = (flash.iter().min(), ambient.iter().max());
    eprintln!(
        "{} JPEG flash frames of luma {darkest:?} and more, {} ambient ones of {brightest:?} and less, \
         {losses:?}",
        flash.len(),
        ambient.len()
    );
    assert!(darkest.unwrap() > &(brightest.unwrap() + 30));
    assert!(flash.len() >= 4);
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_webcam_that_goes_and_comes_back_streams_again_and_leaves_nothing_behind() {
    let mut device = open(WEBCAM).unwrap();
    let mut before = None;
    for cycle in 0..5 {
        let mut stream = device.start(&Settings::default()).unwrap();
        color_frames(stream.as_mut(), 2);
        write("/sys/bus/platform/drivers/vivid/unbind", "vivid.0");
        let since = Instant::now();
        let error = loop {
            if let Err(error) = stream.next_frame(PATIENCE) {
                break error;
            }
        };
        assert!(
            matches!(error, DriverError::Unplugged { .. }),
            "cycle {cycle}: {error}"
        );
        assert!(since.elapsed() <= Duration::from_millis(250));
        drop(stream);
        let gone = device.presence().unwrap_err();
        assert!(matches!(gone, DriverError::Unplugged { .. }), "{gone}");
        write("/sys/bus/platform/drivers/vivid/bind", "vivid.0");
        wait_for(NODE);
        device.presence().unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        color_frames(stream.as_mut(), 1);
        drop(stream);
        let (files, threads, _) = held();
        assert_eq!(*before.get_or_insert((files, threads)), (files, threads));
    }
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_webcam_that_cannot_be_opened_says_why() {
    for (address, says) in [
        ("nokhwa:7", "nokhwa:0 (vivid"),
        ("nokhwa:0?width=321&height=77", "320×180"),
        ("nokhwa:0?format=MJPG", "is not offered"),
    ] {
        let error = open(address).err().expect("it opened").to_string();
        assert!(error.contains(says), "{address}: {error}");
        eprintln!("{error}");
    }
    let mut owner = open("v4l:/dev/video0?color.format=YUYV").unwrap();
    let stream = owner.start(&Settings::default()).unwrap();
    let error = open("nokhwa:0?width=640&height=360").err().expect("busy");
    assert!(error.to_string().contains("busy"), "{error}");
    eprintln!("{error}");
    drop(stream);
    let mut webcam = open(WEBCAM).unwrap();
    let refused = webcam.start(&Settings {
        exposure_seconds: Some(0.01),
        ..Settings::default()
    });
    let error = refused.err().expect("an exposure in seconds").to_string();
    assert!(error.contains("exposure_seconds"), "{error}");
}
