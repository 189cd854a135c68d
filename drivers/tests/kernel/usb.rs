//! A USB camera, driven by the kernel's uvcvideo: formats, exposure, metering, a real unplug, and
//! pictures that are not what they claim.

use crate::machine::{PATIENCE, color_frames, failure, lumas, recovery, wait_for};
use drivers::{DriverError, Frame, Pixels, Plane, Settings, contract, contract::Verdict, open};
use std::{
    path::Path,
    process::{Child, Command},
    time::{Duration, Instant},
};

/// The node of the USB camera: vivid has the first.
const USB: &str = "/dev/video1";

/// The camera, plugged in; dropping it pulls the plug.
pub struct Plugged(Child);

impl Plugged {
    pub fn new(options: &[&str]) -> Self {
        for (path, light) in [("/tmp/dark.jpg", 20u8), ("/tmp/lit.jpg", 60)] {
            // Light falls off towards the rim, as a flash's does.
            let picture = Plane::from_fn(640, 480, |x, y| {
                let (dx, dy) = (x as f32 / 320.0 - 1.0, y as f32 / 240.0 - 1.0);
                let added = if light > 20 {
                    120.0 / (1.0 + dx * dx + dy * dy)
                } else {
                    0.0
                };
                [(f32::from(light) + added) as u8; 3]
            });
            std::fs::write(path, drivers::jpeg(&picture, 90)).unwrap();
        }
        let child = Command::new("uvcg")
            .args(["-r", "15", "-j", "/tmp/dark.jpg", "-f", "/tmp/lit.jpg"])
            .args(options)
            .spawn()
            .unwrap();
        let plugged = Self(child);
        wait_for(USB);
        plugged
    }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
        let since = Instant::now();
        while Path::new(USB).exists() {
            assert!(
                since.elapsed() < Duration::from_secs(10),
                "{USB} does not go"
            );
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

const FLASH: &str = "flash.kind=control&flash.control=brightness&flash.on=200&flash.off=100&\
                     flash.latency_seconds=0.2&flash.longest_seconds=1";

fn color(format: &str) -> String {
    format!(
        "v4l:{USB}?color.format={format}&color.width=640&color.height=480&\
         depth.node=/dev/video0&depth.format=Y16&depth.width=320&depth.height=180&\
         depth.frames_per_second=15&{FLASH}"
    )
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn each_format_upholds_the_contract() {
    let _plugged = Plugged::new(&[]);
    let depth = format!(
        "v4l:/dev/video0?color.format=YUYV&color.width=320&color.height=180&\
         color.frames_per_second=15&depth.node={USB}&depth.format=Z16&flash.kind=control&\
         flash.control=brightness&flash.on=200&flash.off=100"
    );
    for address in [color("YUYV"), color("MJPG"), depth] {
        let report = contract::check(open(&address).unwrap().as_mut(), 24, &mut |_| {});
        let claims = report.claims.iter();
        let open: Vec<_> = claims
            .filter(|claim| claim.verdict != Verdict::Pass)
            .collect();
        assert!(report.passed(), "{address}: {open:?}");
        eprintln!(
            "{address}: {} claims hold",
            report.claims.len() - open.len()
        );
    }
    let listed = drivers::list();
    let found = listed.iter().find(|info| info.address.contains(USB));
    let found = found.expect("the USB camera is listed");
    eprintln!("{found:?}");
    assert!(found.model.contains("virtual UVC"));
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn exposure_is_granted_in_the_steps_of_the_camera_and_read_back() {
    let _plugged = Plugged::new(&[]);
    let mut device = open(&color("YUYV")).unwrap();
    for (asked, granted) in [(0.01, 0.01), (0.012_34, 0.0123), (5.0, 0.06)] {
        let settings = Settings {
            exposure_seconds: Some(asked),
            ..Settings::default()
        };
        let mut stream = device.start(&settings).unwrap();
        let Frame::Color(frame) = &color_frames(stream.as_mut(), 1)[0] else {
            panic!("no color frame")
        };
        assert!(
            (frame.exposure.seconds - granted).abs() < 1e-6,
            "{:?}",
            frame.exposure
        );
    }
    let refused = device.start(&Settings {
        gain: Some(2.0),
        ..Settings::default()
    });
    assert!(matches!(
        refused.err(),
        Some(DriverError::Setting {
            setting: "gain",
            ..
        })
    ));
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn metering_finds_an_exposure_at_which_neither_picture_clips() {
    // From far too much, and from far too little.
    for steps in ["400", "4"] {
        let _plugged = Plugged::new(&["-e", steps]);
        let address = format!("{}&metering=true", color("YUYV"));
        let mut device = open(&address).unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        let frames = color_frames(stream.as_mut(), 9);
        let Frame::Color(first) = &frames[0] else {
            panic!("no color frame")
        };
        let exposure = first.exposure;
        let mut brightest = 0;
        for frame in &frames {
            let Frame::Color(frame) = frame else { continue };
            let Pixels::Yuyv { bytes, .. } = &frame.pixels else {
                panic!("no YUYV")
            };
            assert_eq!(frame.exposure, exposure, "locked");
            brightest = brightest.max(*bytes.iter().step_by(2).max().unwrap());
        }
        let (flash, ambient) = lumas(&frames);
        eprintln!(
            "from {steps} steps to {exposure:?}: luma of flash frames {flash:.0?}, of ambient ones \
             {ambient:.0?}, brightest {brightest} of 235"
        );
        // Half of white in light is luma 177 of sRGB in limited range.
        assert!((170..233).contains(&brightest), "{brightest}");
        assert!(
            flash
                .iter()
                .all(|flash| ambient.iter().all(|ambient| flash > ambient))
        );
    }
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_plug_that_is_pulled_is_told_at_once_and_one_put_back_streams_again() {
    let mut device = None;
    let cycles = 5;
    let (mut told, mut again) = (Duration::ZERO, Duration::ZERO);
    for cycle in 0..cycles {
        let plugged = Plugged::new(&[]);
        let address = color("YUYV");
        let device = device.get_or_insert_with(|| open(&address).unwrap());
        let back = recovery(device.as_mut(), Duration::from_secs(10));
        let mut stream = device.start(&Settings::default()).unwrap();
        color_frames(stream.as_mut(), 2);
        drop(plugged);
        let (error, took) = failure(stream.as_mut(), Duration::from_secs(2));
        eprintln!(
            "cycle {cycle}: frames {back:?} after the node came; pulled, and told {took:?} after: {error}"
        );
        assert!(matches!(error, DriverError::Unplugged { .. }), "{error}");
        assert!(took <= Duration::from_millis(250) && back <= Duration::from_secs(2));
        (told, again) = (told.max(took), again.max(back));
        drop(stream);
        let error = device.start(&Settings::default()).err().expect("no camera");
        assert!(matches!(error, DriverError::NoDevice { .. }), "{error}");
    }
    eprintln!(
        "figure | a USB camera of a real kernel (uvcvideo) unplugged while it streams | {cycles} times; told within {:.1} ms, \
         frames again within {:.0} ms of the node's return",
        1e3 * told.as_secs_f64(),
        1e3 * again.as_secs_f64()
    );
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn pictures_that_are_not_what_they_claim_are_typed_errors() {
    let small = Plane::from_fn(64, 48, |_, _| [90; 3]);
    std::fs::write("/tmp/small.jpg", drivers::jpeg(&small, 90)).unwrap();
    let cases: [(&[&str], &str, &str); 3] = [
        (
            &["-j", "/tmp/small.jpg", "-f", "/tmp/small.jpg"],
            "MJPG",
            "64×48",
        ),
        (&["-m", "garbage"], "MJPG", "no JPEG"),
        (&["-m", "short"], "YUYV", "wrong pictures in a row"),
    ];
    for (options, format, says) in cases {
        let _plugged = Plugged::new(options);
        let mut device = open(&color(format)).unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        let error = loop {
            match stream.next_frame(PATIENCE) {
                Ok(Frame::Depth(_)) => {}
                Ok(Frame::Color(frame)) => {
                    panic!("{options:?} passed as {:?}", frame.pixels.size())
                }
                Err(error) => break error,
            }
        };
        eprintln!("{options:?}: {error}");
        assert!(error.to_string().contains(says), "{error}");
        assert!(matches!(error, DriverError::Malformed { .. }), "{error}");
    }
    // A descriptor of 65535 × 65535 pixels: refused before any memory is taken.
    let _plugged = Plugged::new(&["-m", "huge"]);
    let error = open(&format!("v4l:{USB}?color.format=YUYV"))
        .err()
        .expect("it opened");
    eprintln!("{error}");
}
