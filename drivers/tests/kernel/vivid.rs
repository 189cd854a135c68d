//! A color and a depth camera of the kernel's virtual video driver, whose brightness plays the flash.

use crate::machine::{
    PATIENCE, color_frames, failure, held, is_long, lumas, number, recovery, set_control, wait_for,
    write,
};
use drivers::{DriverError, Frame, Settings, contract, contract::Verdict, open};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

const COLOR: &str = "/dev/video0";
const DEPTH: &str = "/dev/video1";
/// Its buffers are multi-planar.
const PLANES: &str = "/dev/video2";

/// `V4L2_CID_BRIGHTNESS`.
const BRIGHTNESS: u32 = 0x0098_0900;
/// As the driver starts.
const USUAL_BRIGHTNESS: i64 = 128;

/// Ids of the driver's own controls (`drivers/media/test-drivers/vivid/vivid-ctrls.c`).
const VIVID: u32 = 0x00f0_f000;
const TEST_PATTERN: u32 = VIVID;
const TIMESTAMP_SOURCE: u32 = VIVID + 24;
const COLORSPACE: u32 = VIVID + 25;
/// As the driver starts.
const SRGB: i64 = 2;
const WRAP_SEQUENCE: u32 = VIVID + 38;
const WRAP_TIME: u32 = VIVID + 39;
const DROPPED_PERCENT: u32 = VIVID + 64;
const DISCONNECT: u32 = VIVID + 65;
const FLAG_ERROR: u32 = VIVID + 66;
const FAIL_REQBUFS: u32 = VIVID + 67;
const FAIL_QBUF: u32 = VIVID + 68;
const FAIL_STREAMON: u32 = VIVID + 69;
const FATAL: u32 = VIVID + 70;

const FLASH: &str = "flash.kind=control&flash.control=brightness&flash.on=220&flash.off=100";

fn address(color: &str, depth: &str) -> String {
    format!(
        "v4l:bus:platform:vivid-000?color.format={color}&color.width=320&color.height=180&\
         color.frames_per_second=25&depth.frames_per_second=25&depth.node=bus:platform:vivid-001&depth.format={depth}&depth.width=320&depth.height=180&\
         depth.unit_metres=0.0001&{FLASH}"
    )
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn every_format_upholds_the_contract() {
    let color = [
        "YUYV", "NV12", "RGB3", "BGR3", "GREY", "Y10", "Y12", "Y16", "BA81", "GBRG", "GRBG",
        "RGGB", "BG10", "GB10", "BA10", "RG10", "BG12", "GB12", "BA12", "RG12", "BYR2", "GB16",
        "GR16", "RG16",
    ];
    let depth = ["Y12", "Y10", "GREY"];
    let cases = color.map(|color| (color, "Y16"));
    for (color, depth) in cases.into_iter().chain(depth.map(|depth| ("YUYV", depth))) {
        let address = address(color, depth);
        let mut device = open(&address).unwrap();
        let report = contract::check(device.as_mut(), 24, &mut |_| {});
        let open = report
            .claims
            .iter()
            .filter(|claim| claim.verdict != Verdict::Pass);
        let open: Vec<_> = open.collect();
        assert!(report.passed(), "{color}, {depth}: {open:?}");
        let lights = report.claim("both_lights_appear").unwrap();
        assert_eq!(lights.verdict, Verdict::Pass, "{color}: {lights:?}");
        eprintln!(
            "{color} with {depth} as depth: {} claims hold",
            report.claims.len() - open.len()
        );
    }
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_multi_planar_node_upholds_the_contract_with_one_plane_and_with_two() {
    for format in ["NM12", "NV12", "YUYV", "BGR3", "RG10"] {
        let address = address(format, "Y16").replace("vivid-000", "vivid-002");
        let mut device = open(&address).unwrap();
        let report = contract::check(device.as_mut(), 24, &mut |_| {});
        let failed = report.claims.iter();
        let failed: Vec<_> = failed
            .filter(|claim| claim.verdict == Verdict::Fail)
            .collect();
        assert!(report.passed(), "{format}: {failed:?}");
        let lights = report.claim("both_lights_appear").unwrap();
        assert_eq!(lights.verdict, Verdict::Pass, "{format}: {lights:?}");
        eprintln!("{format} of a multi-planar node: the contract holds");
    }
    set_control(PLANES, BRIGHTNESS, USUAL_BRIGHTNESS);
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn depth_has_the_amplitude_of_its_own_exposure_and_goes_on_without() {
    // Slow enough for the guest to draw three pictures at a time.
    let both = address("YUYV", "Y16").replace("per_second=25", "per_second=10");
    let mut shares = Vec::new();
    // Its test patterns "100% Black" and "100% White".
    for (format, pattern) in [("Y16", 5), ("GREY", 6)] {
        let address = format!(
            "{both}&amplitude.node={PLANES}&amplitude.format={format}&amplitude.width=320&\
             amplitude.height=180&amplitude.frames_per_second=10&\
             amplitude.controls.test_pattern={pattern}&amplitude.controls.osd_text_mode=2"
        );
        let mut device = open(&address).unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        let mut depth = |count: usize| {
            let mut found = Vec::new();
            while found.len() < count {
                if let Frame::Depth(frame) = stream.next_frame(PATIENCE).unwrap() {
                    found.push(frame);
                }
            }
            found
        };
        let whole = depth(20);
        let with = whole.iter().filter_map(|frame| frame.amplitude.as_ref());
        let means: Vec<f32> = with
            .map(|plane| plane.samples().iter().sum::<f32>() / plane.len() as f32)
            .collect();
        let white = if format == "Y16" { 65535.0 } else { 255.0 };
        eprintln!(
            "{} of 20 depth frames with amplitude from {format}, of {:.2} of white",
            means.len(),
            means[0] / white
        );
        assert!(means.len() >= 18);
        shares.push(means[means.len() / 2] / white);
        // A node that delivers nothing any more: depth goes on, until that is told as a stall.
        set_control(PLANES, DROPPED_PERCENT, 100);
        let after = depth(12);
        set_control(PLANES, DROPPED_PERCENT, 0);
        assert!(after[6..].iter().all(|frame| frame.amplitude.is_none()));
    }
    set_control(PLANES, TEST_PATTERN, 0);
    assert!(shares[0] < 0.2 && shares[1] > 0.8, "{shares:?}");
    let refused = format!(
        "{}&amplitude.node={PLANES}&amplitude.width=640&amplitude.height=360",
        address("YUYV", "Y16")
    );
    let error = open(&refused).err().expect("two sizes").to_string();
    assert!(
        error.contains("640×360") && error.contains("320×180"),
        "{error}"
    );
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_flash_that_nobody_commands_is_told_by_brightness_alone() {
    let address = address("YUYV", "Y16").replace(FLASH, "flash.kind=none");
    set_control(COLOR, BRIGHTNESS, 100);
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // A person with a flash, who looks at no clock.
        scope.spawn(|| {
            for pause in (0..).map(|n| 150 + n * 37 % 100) {
                std::thread::sleep(Duration::from_millis(pause));
                if over.load(Ordering::Relaxed) {
                    break;
                }
                set_control(COLOR, BRIGHTNESS, 200);
                std::thread::sleep(Duration::from_millis(60));
                set_control(COLOR, BRIGHTNESS, 100);
            }
        });
        let mut device = open(&address).unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        let frames = color_frames(stream.as_mut(), if is_long() { 600 } else { 120 });
        over.store(true, Ordering::Relaxed);
        let (flash, ambient) = lumas(&frames);
        let darkest = flash.iter().copied().fold(f64::INFINITY, f64::min);
        let brightest = ambient.iter().copied().fold(0.0, f64::max);
        eprintln!(
            "{} flash frames of luma {darkest:.0} and more, {} ambient ones of {brightest:.0} and \
             less, {:?}",
            flash.len(),
            ambient.len(),
            stream.losses()
        );
        // One or two of the frames of each flash, every 260 ms or so.
        assert!(flash.len() >= frames.len() / 10);
        assert!(darkest > brightest + 50.0);
    });
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn no_frame_has_the_wrong_light_though_every_fifth_is_lost() {
    set_control(COLOR, DROPPED_PERCENT, 20);
    let mut device = open(&address("YUYV", "Y16")).unwrap();
    let mut stream = device.start(&Settings::default()).unwrap();
    let frames = color_frames(stream.as_mut(), if is_long() { 1000 } else { 150 });
    let losses = stream.losses();
    drop(stream);
    set_control(COLOR, DROPPED_PERCENT, 0);
    let (flash, ambient) = lumas(&frames);
    assert!(
        flash.len() >= frames.len() / 5,
        "{} flash frames",
        flash.len()
    );
    let darkest = flash.iter().copied().fold(f64::INFINITY, f64::min);
    let brightest = ambient.iter().copied().fold(0.0, f64::max);
    eprintln!(
        "figure | light of frames of a real kernel's camera that loses every fifth | {} flash frames of luma {darkest:.0} and more, \
         {} ambient ones of {brightest:.0} and less; {} missed, {} of unknown light left out",
        flash.len(),
        ambient.len(),
        losses.missed,
        losses.unlit
    );
    assert!(darkest > brightest + 30.0);
    assert!(losses.missed > 0, "{losses:?}");
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn each_injected_fault_is_a_typed_error_or_a_counted_loss_and_a_new_start_mends_it() {
    let mut device = open(&address("YUYV", "Y16")).unwrap();
    let settings = Settings::default();
    let (mut typed, mut counted, mut harmless) = (0, 0, 0);
    let mut latest = Duration::ZERO;
    // Faults at the start.
    for (name, id) in [
        ("REQBUFS", FAIL_REQBUFS),
        ("QBUF", FAIL_QBUF),
        ("STREAMON", FAIL_STREAMON),
    ] {
        for node in [COLOR, DEPTH] {
            set_control(node, id, 1);
            let error = device.start(&settings).err().expect("it started");
            assert!(
                matches!(error, DriverError::Hardware { .. }),
                "{name}: {error}"
            );
            assert!(error.to_string().contains(node), "{name}: {error}");
            latest = latest.max(recovery(device.as_mut(), Duration::from_secs(2)));
            typed += 1;
            eprintln!("{name} of {node}: {error}");
        }
    }
    // Faults in the middle.
    for node in [COLOR, DEPTH] {
        let mut stream = device.start(&settings).unwrap();
        color_frames(stream.as_mut(), 2);
        set_control(node, FATAL, 1);
        let (error, took) = failure(stream.as_mut(), Duration::from_secs(2));
        assert!(matches!(error, DriverError::Hardware { .. }), "{error}");
        eprintln!("fatal error of {node} after {took:?}: {error}");
        drop(stream);
        latest = latest.max(recovery(device.as_mut(), Duration::from_secs(2)));
        typed += 1;
    }
    // Losses that are counted, while frames keep coming.
    let mut stream = device.start(&settings).unwrap();
    color_frames(stream.as_mut(), 2);
    for _ in 0..3 {
        set_control(COLOR, FLAG_ERROR, 1);
        color_frames(stream.as_mut(), 2);
    }
    assert_eq!(stream.losses().broken, 3);
    counted += 1;
    drop(stream);
    for (name, id, value) in [
        ("wrapping sequence", WRAP_SEQUENCE, 1),
        ("wrapping time", WRAP_TIME, 1),
        ("start of exposure", TIMESTAMP_SOURCE, 1),
        // Rec. 709, which is not what YUYV frames promise.
        ("another matrix", COLORSPACE, 1),
    ] {
        set_control(COLOR, id, value);
        let report = contract::check(device.as_mut(), 24, &mut |_| {});
        let failed = report
            .claims
            .iter()
            .filter(|claim| claim.verdict == Verdict::Fail);
        assert!(report.passed(), "{name}: {:?}", failed.collect::<Vec<_>>());
        eprintln!("{name}: the contract holds");
        harmless += 1;
        set_control(COLOR, id, if id == COLORSPACE { SRGB } else { 0 });
    }
    // Silence without an error.
    for node in [COLOR, DEPTH] {
        let mut stream = device.start(&settings).unwrap();
        color_frames(stream.as_mut(), 2);
        set_control(node, DROPPED_PERCENT, 100);
        let (error, took) = failure(stream.as_mut(), Duration::from_secs(5));
        eprintln!("{node} stalls, told after {took:?}: {error}");
        assert!(
            matches!(&error, DriverError::Hardware { problem, .. } if problem.contains("delivers nothing")),
            "{error}"
        );
        set_control(node, DROPPED_PERCENT, 0);
        drop(stream);
        latest = latest.max(recovery(device.as_mut(), Duration::from_secs(2)));
        typed += 1;
    }
    let mut stream = device.start(&settings).unwrap();
    for node in [COLOR, DEPTH] {
        set_control(node, DROPPED_PERCENT, 100);
    }
    let short = Duration::from_millis(150);
    while stream.next_frame(short).is_ok() {}
    let error = stream.next_frame(short).unwrap_err();
    assert!(matches!(error, DriverError::Timeout { .. }), "{error}");
    typed += 1;
    for node in [COLOR, DEPTH] {
        set_control(node, DROPPED_PERCENT, 0);
    }
    stream
        .next_frame(PATIENCE)
        .expect("a stream may be asked again");
    eprintln!(
        "figure | errors injected into a real kernel's camera driver (vivid) | {} times: {typed} told as typed \
         errors, {counted} counted as a loss, {harmless} without harm to the contract; frames again within {:.0} ms",
        typed + counted + harmless,
        1e3 * latest.as_secs_f64()
    );
    assert!(typed + counted + harmless >= 13);
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn what_cannot_be_opened_says_why() {
    struct Case(&'static str, &'static str);
    let cases = [
        Case("/dev/video77", "no such file"),
        Case("card:Nikon", "cameras are /dev/video0"),
        Case("/dev/null", "ENOTTY"),
        Case("/dev/video0?color.format=H264", "it offers"),
        Case("/dev/video0?color.width=321&color.height=7", "320×180"),
        Case(
            "/dev/video0?depth.node=/dev/video1&depth.format=YUYV",
            "as depth",
        ),
    ];
    for Case(place, says) in cases {
        let error = open(&format!("v4l:{place}"))
            .err()
            .expect("it opened")
            .to_string();
        assert!(error.contains(says), "{place}: {error}");
        eprintln!("{error}");
    }
    let listed: Vec<_> = drivers::list()
        .into_iter()
        .filter(|info| info.driver.contains("vivid"))
        .collect();
    assert_eq!(listed.len(), 3, "{listed:?}");
    // A node that streams for somebody else is busy.
    let mut first = open("v4l:/dev/video0").unwrap();
    let stream = first.start(&Settings::default()).unwrap();
    let error = match open("v4l:/dev/video0?color.width=640&color.height=360") {
        Err(error) => error.to_string(),
        Ok(mut second) => second
            .start(&Settings::default())
            .err()
            .expect("two streams")
            .to_string(),
    };
    assert!(error.contains("busy"), "{error}");
    eprintln!("{error}");
    drop(stream);
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_device_that_goes_and_comes_back_streams_again_and_nothing_is_left_behind() {
    let cycles = if is_long() { 200 } else { 20 };
    let mut device = open(&address("YUYV", "Y16")).unwrap();
    let (mut losses, mut returns) = (Vec::new(), Vec::new());
    let mut before = None;
    for cycle in 0..cycles {
        let mut stream = device.start(&Settings::default()).unwrap();
        color_frames(stream.as_mut(), 2);
        write("/sys/bus/platform/drivers/vivid/unbind", "vivid.0");
        let (error, took) = failure(stream.as_mut(), Duration::from_secs(1));
        assert!(
            matches!(error, DriverError::Unplugged { .. }),
            "cycle {cycle}: {error}"
        );
        losses.push(took);
        drop(stream);
        assert!(
            device.start(&Settings::default()).is_err(),
            "it is not there"
        );
        write("/sys/bus/platform/drivers/vivid/bind", "vivid.0");
        wait_for(COLOR);
        wait_for(DEPTH);
        returns.push(recovery(device.as_mut(), Duration::from_secs(5)));
        if cycle == 4 {
            before = Some(held());
        }
    }
    let (files, threads, resident) = held();
    let (files_before, threads_before, resident_before) = before.unwrap();
    losses.sort();
    returns.sort();
    let late = |times: &[Duration]| times[times.len() * 95 / 100];
    let ms = |time: Duration| 1e3 * time.as_secs_f64();
    eprintln!(
        "figure | a real kernel's camera (vivid) unbound while it streams, and bound again | {cycles} times; \
         loss told within {:.1} ms (p95 {:.1}), frames again within {:.0} ms of the node's return (p95 {:.0}); \
         files {:+}, threads {:+}, memory {:+} KiB",
        ms(losses[losses.len() - 1]),
        ms(late(&losses)),
        ms(returns[returns.len() - 1]),
        ms(late(&returns)),
        files as i64 - files_before as i64,
        threads as i64 - threads_before as i64,
        resident - resident_before,
    );
    assert!(*losses.last().unwrap() <= Duration::from_millis(250));
    assert!(late(&returns) <= Duration::from_secs(2));
    assert_eq!((files, threads), (files_before, threads_before));
    assert!(resident - resident_before <= 1024, "KiB");
    // The kernel's own way of pulling the plug: the node stays, and every call fails.
    let mut stream = device.start(&Settings::default()).unwrap();
    color_frames(stream.as_mut(), 2);
    set_control(COLOR, DISCONNECT, 1);
    let (error, took) = failure(stream.as_mut(), Duration::from_secs(1));
    assert!(matches!(error, DriverError::Unplugged { .. }), "{error}");
    assert!(took <= Duration::from_millis(250), "{took:?}");
    drop(stream);
    write("/sys/bus/platform/drivers/vivid/unbind", "vivid.0");
    write("/sys/bus/platform/drivers/vivid/bind", "vivid.0");
    wait_for(COLOR);
    recovery(device.as_mut(), Duration::from_secs(5));
    assert_eq!(
        number("/sys/module/vivid/refcnt"),
        0,
        "a node was left open"
    );
    let frame = device
        .start(&Settings::default())
        .unwrap()
        .next_frame(PATIENCE)
        .unwrap();
    assert!(matches!(frame, Frame::Color(_) | Frame::Depth(_)));
}
