//! Devices without hardware: the contract, replay, faults, addresses.

use drivers::{
    DriverError, Frame, Settings, contract, contract::Verdict, open, recording::Writer,
    replay::Replay,
};
use std::{path::Path, time::Duration};

const PATIENCE: Duration = Duration::from_secs(1);

fn small(options: &str) -> String {
    format!("synthetic:desk?width=32&depth_width=16&{options}")
}

fn record(address: &str, path: &Path, frames: usize) -> Vec<Frame> {
    let mut device = open(address).unwrap();
    let mut writer =
        Writer::create(path, &device.info(), &device.rig(), &Settings::default()).unwrap();
    let mut stream = device.start(&Settings::default()).unwrap();
    let frames: Vec<Frame> = (0..frames)
        .map(|_| stream.next_frame(PATIENCE).unwrap())
        .collect();
    for bracket in frames.chunks(6) {
        bracket.iter().for_each(|frame| writer.push(frame).unwrap());
        writer.finish_bracket().unwrap();
    }
    writer.close().unwrap();
    frames
}

#[test]
fn every_layout_and_pixel_kind_upholds_the_contract() {
    let kinds = drivers::synthetic::PixelKind::NAMES.map(|(name, _)| name);
    for layout in ["desk", "wall", "statue"] {
        for kind in kinds {
            let address =
                format!("synthetic:{layout}?width=32&depth_width=16&pixels={kind}&drop=0.1");
            let mut heard = 0;
            let report = contract::check(open(&address).unwrap().as_mut(), 24, &mut |_| heard += 1);
            let failed: Vec<_> = report
                .claims
                .iter()
                .filter(|c| c.verdict == Verdict::Fail)
                .collect();
            assert!(report.passed(), "{address}: {failed:?}");
            assert_eq!(heard, report.claims.len());
        }
    }
}

#[test]
fn a_device_in_real_time_honours_its_patience() {
    let mut device = open(&small("pace=real&rate=20")).unwrap();
    let report = contract::check(device.as_mut(), 6, &mut |_| {});
    let claim = report
        .claim("a_timeout_is_honoured_within_its_patience")
        .unwrap();
    assert_eq!(claim.verdict, Verdict::Pass, "{}", claim.evidence);
    assert!(report.passed(), "{report:?}");
}

#[test]
fn a_replay_gives_the_same_frames_as_often_as_it_is_started() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("desk.mcap");
    let pushed = record(&small(""), &path, 12);
    let mut replay = Replay::open(&path).unwrap();
    let report = contract::check(&mut replay, 12, &mut |_| {});
    assert!(report.passed(), "{report:?}");
    for address in [
        format!("replay:{}", path.display()),
        path.display().to_string(),
    ] {
        let mut device = open(&address).unwrap();
        for _ in 0..2 {
            let mut stream = device.start(&Settings::default()).unwrap();
            let mut found = Vec::new();
            let ended = loop {
                match stream.next_frame(PATIENCE) {
                    Ok(frame) => found.push(format!("{frame:?}")),
                    Err(error) => break error,
                }
            };
            assert!(matches!(ended, DriverError::Ended { .. }));
            let pushed: Vec<String> = pushed.iter().map(|frame| format!("{frame:?}")).collect();
            assert!(found == pushed, "frames differ");
        }
    }
}

#[test]
fn the_contract_finds_each_fault() {
    struct Case {
        faults: &'static str,
        claim: &'static str,
    }
    let cases = [
        Case {
            faults: "duplicate=0.3",
            claim: "color_timestamps_strictly_increase",
        },
        Case {
            faults: "swap=0.3,drop=0.5",
            claim: "color_sequence_strictly_increases",
        },
        Case {
            faults: "delay=0.3",
            claim: "depth_timestamps_strictly_increase",
        },
        Case {
            faults: "unplug=7",
            claim: "frames_keep_coming",
        },
    ];
    for case in &cases {
        let address = format!("flaky:{},seed=3:{}", case.faults, small(""));
        let report = contract::check(open(&address).unwrap().as_mut(), 40, &mut |_| {});
        let claim = report.claim(case.claim).unwrap();
        assert_eq!(claim.verdict, Verdict::Fail, "{address}: {report:?}");
        assert!(!report.passed());
    }
    // Timeouts alone break nothing: the stream may be asked again.
    let patient = format!("flaky:timeout=0.3,seed=3:{}", small(""));
    let report = contract::check(open(&patient).unwrap().as_mut(), 20, &mut |_| {});
    assert!(report.passed(), "{report:?}");
}

#[test]
fn the_same_seed_gives_the_same_faults_and_another_seed_others() {
    let play = |seed: u32| -> Vec<String> {
        let address = format!(
            "flaky:drop=0.2,delay=0.1,duplicate=0.1,swap=0.1,mislabel=0.1,timeout=0.1,seed={seed}:{}",
            small("")
        );
        let mut device = open(&address).unwrap();
        let mut stream = device.start(&Settings::default()).unwrap();
        (0..40)
            .map(|_| match stream.next_frame(PATIENCE) {
                Ok(Frame::Color(frame)) => format!("color {} {:?}", frame.sequence, frame.light),
                Ok(Frame::Depth(frame)) => format!("depth {}", frame.sequence),
                Err(error) => error.to_string(),
            })
            .collect()
    };
    assert_eq!(play(1), play(1));
    assert_ne!(play(1), play(2));
}

#[test]
fn faults_lose_nothing_but_what_they_drop() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("desk.mcap");
    let pushed = record(&small(""), &path, 30);
    let mut device = open(&format!(
        "flaky:delay=0.3,swap=0.3,seed=5:replay:{}",
        path.display()
    ))
    .unwrap();
    let mut stream = device.start(&Settings::default()).unwrap();
    let key = |frame: &Frame| (frame.at(), frame.sequence());
    let mut found: Vec<_> = std::iter::from_fn(|| stream.next_frame(PATIENCE).ok())
        .map(|f| key(&f))
        .collect();
    let mut pushed: Vec<_> = pushed.iter().map(key).collect();
    assert_ne!(found, pushed, "the order was to be disturbed");
    found.sort_unstable();
    pushed.sort_unstable();
    assert_eq!(found, pushed);
}

#[test]
fn a_bad_address_says_what_is_valid() {
    struct Case {
        address: &'static str,
        says: &'static str,
    }
    let cases = [
        Case {
            address: "",
            says: "synthetic:LAYOUT",
        },
        Case {
            address: "webcam",
            says: "valid addresses are",
        },
        Case {
            address: "kinect:0",
            says: "no driver \"kinect\"",
        },
        Case {
            address: "synthetic:moon",
            says: "desk, wall, statue",
        },
        Case {
            address: "synthetic:desk?colour=1",
            says: "valid options are seed",
        },
        Case {
            address: "synthetic:desk?width=33",
            says: "must be even",
        },
        Case {
            address: "synthetic:desk?width=1e9",
            says: "from 16 to 8192",
        },
        Case {
            address: "synthetic:desk?noise=NaN",
            says: "noise=NaN",
        },
        Case {
            address: "synthetic:desk?seed=1&seed=2",
            says: "given twice",
        },
        Case {
            address: "synthetic:desk?pixels=png",
            says: "bayer, yuyv, nv12",
        },
        Case {
            address: "flaky:drop=0.1",
            says: "is missing",
        },
        Case {
            address: "flaky:drop=2:synthetic:desk",
            says: "drop=2",
        },
        Case {
            address: "flaky::flaky::synthetic:desk",
            says: "not itself flaky",
        },
        Case {
            address: "replay:/nowhere/at/all.mcap",
            says: "/nowhere/at/all.mcap",
        },
    ];
    for case in cases {
        match open(case.address) {
            Err(error) => assert!(
                error.to_string().contains(case.says),
                "{}: {error}",
                case.address
            ),
            Ok(_) => panic!("{} opened", case.address),
        }
    }
}

#[test]
fn every_listed_address_opens_the_device_that_was_listed() {
    let listed = drivers::list();
    assert!(!listed.is_empty());
    for info in listed {
        assert_eq!(open(&info.address).unwrap().info(), info);
    }
}

#[test]
fn a_setting_that_cannot_be_granted_names_the_setting() {
    let mut device = open(&small("")).unwrap();
    let asked = [
        (
            Settings {
                flash_every: 1,
                ..Settings::default()
            },
            "flash_every",
        ),
        (
            Settings {
                exposure_seconds: Some(-1.0),
                ..Settings::default()
            },
            "exposure_seconds",
        ),
        (
            Settings {
                gain: Some(f32::INFINITY),
                ..Settings::default()
            },
            "gain",
        ),
    ];
    for (settings, name) in asked {
        let refused = device.start(&settings).err().map(|error| error.to_string());
        assert!(
            refused.as_ref().is_some_and(|text| text.contains(name)),
            "{name}: {refused:?}"
        );
    }
}
