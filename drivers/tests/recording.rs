//! Recordings: what goes in comes out, and what is broken says so.

use drivers::{
    BayerPattern, ColorFrame, DepthCamera, DepthFrame, DeviceInfo, Distortion, DriverError,
    Exposure, FlashLamp, Frame, Illumination, Intrinsics, Pixels, Plane, Rig, RigidTransform,
    Settings, Timestamp, Transfer, admission,
    recording::{Reader, Writer, summarize},
};
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const WIDTH: usize = 6;
const HEIGHT: usize = 4;

fn lens(width: usize, height: usize, distortion: Distortion) -> Intrinsics {
    Intrinsics {
        width,
        height,
        fx: 5.1,
        fy: 5.3,
        cx: 2.6,
        cy: 1.4,
        distortion,
    }
}

fn rig(turn: f64) -> Rig {
    let bent = Distortion::BrownConrady {
        k1: 0.1 / 3.0,
        k2: -0.2,
        p1: 1e-3,
        p2: turn,
        k3: 0.7,
    };
    Rig {
        color: lens(WIDTH, HEIGHT, Distortion::None {}),
        depth: Some(DepthCamera {
            lens: lens(3, 2, bent),
            to_color: RigidTransform {
                rotation: DMat3::from_rotation_y(turn) * DMat3::from_rotation_x(0.1),
                translation_metres: DVec3::new(turn / 7.0, 0.1, -0.3),
            },
        }),
        flash: FlashLamp {
            position_metres: DVec3::new(0.0, turn, 0.0),
            intensity: Some(9.7),
            beam: drivers::Beam::default(),
        },
    }
}

fn info() -> DeviceInfo {
    DeviceInfo {
        address: "test:1".into(),
        driver: "test".into(),
        model: "a \"rig\"".into(),
        finite: false,
    }
}

/// Everything about a frame, NaN payloads included, in a form that can be compared.
fn bits(frame: &Frame) -> String {
    let floats =
        |plane: &Plane<f32>| -> Vec<u32> { plane.samples().iter().map(|v| v.to_bits()).collect() };
    match frame {
        Frame::Color(color) => match &color.pixels {
            Pixels::RgbF32(plane) => {
                let samples: Vec<u32> = plane
                    .samples()
                    .iter()
                    .flatten()
                    .map(|v| v.to_bits())
                    .collect();
                let rest = ColorFrame {
                    pixels: Pixels::Rgb8(Plane::default()),
                    ..color.clone()
                };
                format!("{rest:?} {samples:?}")
            }
            _ => format!("{color:?}"),
        },
        Frame::Depth(depth) => format!(
            "{:?} {} {:?} {:?} {:?}",
            depth.at,
            depth.sequence,
            floats(&depth.metres),
            depth.amplitude.as_ref().map(floats),
            depth.sigma.as_ref().map(floats),
        ),
    }
}

fn pixels() -> impl Strategy<Value = Pixels> {
    let bytes = |count: usize| proptest::collection::vec(any::<u8>(), count);
    let words = |count: usize| proptest::collection::vec(any::<u16>(), count);
    let n = WIDTH * HEIGHT;
    // Any bits but an infinity, which no device may deliver.
    let finite = any::<u32>()
        .prop_map(f32::from_bits)
        .prop_filter("no infinity", |v| !v.is_infinite());
    let pattern = prop_oneof![
        Just(BayerPattern::Rggb),
        Just(BayerPattern::Grbg),
        Just(BayerPattern::Gbrg),
        Just(BayerPattern::Bggr)
    ];
    prop_oneof![
        (words(n), pattern).prop_map(|(samples, pattern)| Pixels::Bayer {
            samples: Plane::new(WIDTH, HEIGHT, samples).unwrap(),
            pattern
        }),
        bytes(2 * n).prop_map(|bytes| Pixels::Yuyv {
            width: WIDTH,
            height: HEIGHT,
            bytes
        }),
        bytes(n * 3 / 2).prop_map(|bytes| Pixels::Nv12 {
            width: WIDTH,
            height: HEIGHT,
            bytes
        }),
        bytes(40).prop_map(|tail| Pixels::Mjpg {
            width: WIDTH,
            height: HEIGHT,
            bytes: [vec![0xff, 0xd8], tail].concat()
        }),
        bytes(3 * n).prop_map(|v| Pixels::Rgb8(
            Plane::new(WIDTH, HEIGHT, v.as_chunks().0.to_vec()).unwrap()
        )),
        words(3 * n).prop_map(|v| Pixels::Rgb16(
            Plane::new(WIDTH, HEIGHT, v.as_chunks().0.to_vec()).unwrap()
        )),
        proptest::collection::vec(finite, 3 * n).prop_map(|v| Pixels::RgbF32(
            Plane::new(WIDTH, HEIGHT, v.as_chunks().0.to_vec()).unwrap()
        )),
    ]
}

fn transfer() -> impl Strategy<Value = Transfer> {
    prop_oneof![
        Just(Transfer::Linear),
        Just(Transfer::Srgb),
        Just(Transfer::Bt709),
        (0.1f32..5.0).prop_map(Transfer::Gamma),
        (0.1f32..3.0).prop_map(|p| Transfer::Response(
            (0..256).map(|i| (i as f32 / 255.0).powf(p)).collect()
        )),
    ]
}

fn color() -> impl Strategy<Value = Frame> {
    let light = prop_oneof![Just(Illumination::Ambient), Just(Illumination::Flash)];
    (
        any::<u64>(),
        any::<u64>(),
        light,
        1e-6f32..1e3,
        1e-3f32..1e3,
        pixels(),
        transfer(),
        0.0f32..0.4,
        0.41f32..=1.0,
    )
        .prop_map(
            |(at, sequence, light, seconds, gain, pixels, transfer, black_level, white_level)| {
                Frame::Color(ColorFrame {
                    at: Timestamp::from_nanos(at),
                    sequence,
                    light,
                    exposure: Exposure { seconds, gain },
                    pixels,
                    transfer,
                    black_level,
                    white_level,
                })
            },
        )
}

fn depth() -> impl Strategy<Value = Frame> {
    let value = prop_oneof![
        4 => 1e-3f32..50.0,
        // Any NaN, so that payloads are seen to survive.
        1 => any::<u32>().prop_map(|b| f32::from_bits(b | 0x7fc0_0000)),
    ];
    let plane = move || {
        proptest::collection::vec(value.clone(), 6).prop_map(|v| Plane::new(3, 2, v).unwrap())
    };
    (
        any::<u64>(),
        any::<u64>(),
        plane(),
        proptest::option::of(plane()),
        proptest::option::of(plane()),
    )
        .prop_map(|(at, sequence, metres, amplitude, sigma)| {
            Frame::Depth(DepthFrame {
                at: Timestamp::from_nanos(at),
                sequence,
                metres,
                amplitude,
                sigma,
            })
        })
}

fn brackets() -> impl Strategy<Value = Vec<Vec<Frame>>> {
    proptest::collection::vec(
        proptest::collection::vec(prop_oneof![color(), depth()], 1..4),
        1..4,
    )
}

/// Writes brackets; gives the file's length after each.
fn write(path: &Path, rig: &Rig, brackets: &[Vec<Frame>], close: bool) -> Vec<u64> {
    let length = || std::fs::metadata(path).unwrap().len();
    let settings = Settings {
        exposure_seconds: Some(0.1),
        gain: None,
        flash_every: 4,
        flash_run: 1,
    };
    let mut writer = Writer::create(path, &info(), rig, &settings).unwrap();
    let mut lengths = vec![length()];
    for bracket in brackets {
        for frame in bracket {
            writer.push(frame).unwrap();
        }
        writer.finish_bracket().unwrap();
        lengths.push(length());
    }
    if close {
        writer.close().unwrap();
    } else {
        std::mem::forget(writer);
    }
    lengths
}

fn scratch() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.mcap");
    (folder, path)
}

/// All that can be read, and how it ended.
fn read(path: &Path) -> Result<(Vec<Frame>, Option<u64>), DriverError> {
    let mut reader = Reader::open(path)?;
    let frames: Result<Vec<Frame>, DriverError> = reader.by_ref().collect();
    Ok((frames?, reader.truncated_at()))
}

/// Frames before the first error, and whether anything was reported.
fn read_what_can_be_read(path: &Path) -> (Vec<Frame>, bool) {
    let Ok(mut reader) = Reader::open(path) else {
        return (vec![], true);
    };
    let (mut frames, mut reported) = (vec![], false);
    for frame in reader.by_ref() {
        match frame {
            Ok(frame) => frames.push(frame),
            Err(_) => reported = true,
        }
    }
    (frames, reported || reader.truncated_at().is_some())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_recording_gives_back_every_bit(brackets in brackets(), turn in -0.5f64..0.5) {
        let (_folder, path) = scratch();
        write(&path, &rig(turn), &brackets, true);
        let reader = Reader::open(&path).unwrap();
        prop_assert_eq!(reader.rig(), &rig(turn));
        prop_assert_eq!(reader.info(), &info());
        prop_assert_eq!(reader.settings().exposure_seconds, Some(0.1));
        let (frames, cut) = read(&path).unwrap();
        let found: Vec<String> = frames.iter().map(bits).collect();
        let pushed: Vec<String> = brackets.iter().flatten().map(bits).collect();
        prop_assert_eq!(found, pushed);
        prop_assert_eq!(cut, None);
    }

    #[test]
    fn a_cut_recording_gives_every_whole_bracket_and_the_place_of_the_cut(
        brackets in brackets(),
        place in 0.0f64..1.0,
    ) {
        let (_folder, path) = scratch();
        let lengths = write(&path, &rig(0.1), &brackets, true);
        let whole = std::fs::read(&path).unwrap();
        let cut = (place * whole.len() as f64) as usize;
        std::fs::write(&path, &whole[..cut]).unwrap();
        match read(&path) {
            // Even the session was cut.
            Err(DriverError::Malformed { .. }) => prop_assert!((cut as u64) < lengths[0]),
            Err(other) => prop_assert!(false, "{other}"),
            Ok((frames, truncated_at)) => {
                let kept = lengths[1..].iter().filter(|length| **length <= cut as u64).count();
                // A chunk's index follows it, so the bracket may be whole a little earlier.
                let expected: Vec<String> = brackets.iter().flatten().map(bits).collect();
                let least = brackets[..kept].iter().flatten().count();
                prop_assert!(frames.len() >= least);
                let found: Vec<String> = frames.iter().map(bits).collect();
                prop_assert_eq!(&found[..], &expected[..found.len()]);
                prop_assert!(truncated_at.is_some_and(|byte| byte <= cut as u64));
            }
        }
    }

    #[test]
    fn one_wrong_byte_never_changes_a_frame_nor_loses_one_in_silence(
        brackets in brackets(),
        place in 0.0f64..1.0,
        flip in 1u8..=255,
    ) {
        let (_folder, path) = scratch();
        write(&path, &rig(0.1), &brackets, true);
        let mut bytes = std::fs::read(&path).unwrap();
        let at = (place * bytes.len() as f64) as usize;
        bytes[at] ^= flip;
        std::fs::write(&path, &bytes).unwrap();
        let (frames, reported) = read_what_can_be_read(&path);
        let mut pushed = brackets.iter().flatten().map(bits);
        for frame in &frames {
            prop_assert!(pushed.any(|original| original == bits(frame)), "a frame was changed");
        }
        prop_assert!(reported || frames.len() == brackets.iter().flatten().count(), "byte {at}");
    }

    #[test]
    fn arbitrary_bytes_after_the_session_never_panic(tail in proptest::collection::vec(any::<u8>(), 0..400)) {
        let (_folder, path) = scratch();
        let lengths = write(&path, &rig(0.1), &[], false);
        let mut bytes = std::fs::read(&path).unwrap();
        bytes.truncate(lengths[0] as usize);
        bytes.extend(tail);
        std::fs::write(&path, &bytes).unwrap();
        for frame in read_what_can_be_read(&path).0 {
            prop_assert!(admission::admit(&frame, &rig(0.1)).is_ok());
        }
    }
}

fn example_color(sequence: u64, light: Illumination) -> Frame {
    Frame::Color(ColorFrame {
        at: Timestamp::from_nanos(1000 * sequence + 5),
        sequence,
        light,
        exposure: Exposure {
            seconds: 0.01,
            gain: 1.0,
        },
        pixels: Pixels::Rgb8(Plane::filled(WIDTH, HEIGHT, [1, 2, 3])),
        transfer: Transfer::Srgb,
        black_level: 0.0,
        white_level: 1.0,
    })
}

#[test]
fn a_recording_that_was_never_closed_holds_its_finished_brackets() {
    let (_folder, path) = scratch();
    let brackets = vec![
        vec![example_color(0, Illumination::Ambient)],
        vec![example_color(1, Illumination::Flash)],
    ];
    let lengths = write(&path, &rig(0.0), &brackets, false);
    let (frames, cut) = read(&path).unwrap();
    assert_eq!(frames, brackets.concat());
    assert_eq!(cut, lengths.last().copied());
}

#[test]
fn a_summary_counts_frames_gaps_and_time() {
    let (_folder, path) = scratch();
    let brackets = vec![
        vec![
            example_color(3, Illumination::Ambient),
            example_color(4, Illumination::Flash),
        ],
        vec![example_color(9, Illumination::Ambient)],
    ];
    write(&path, &rig(0.0), &brackets, true);
    let summary = summarize(&path).unwrap();
    assert_eq!(
        (
            summary.ambient_frames,
            summary.flash_frames,
            summary.depth_frames
        ),
        (2, 1, 0)
    );
    // 3, 4 and 9 were seen; 5 to 8 were not.
    assert_eq!((summary.color_gaps, summary.depth_gaps), (4, 0));
    assert!((summary.duration_seconds - 6e-6).abs() < 1e-12);
    assert_eq!(summary.chunks, 3);
    assert_eq!(
        (summary.color_size, summary.depth_size),
        ((WIDTH, HEIGHT), (3, 2))
    );
    assert_eq!(summary.truncated_at, None);
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());
}

#[test]
fn an_existing_file_is_never_overwritten() {
    let (_folder, path) = scratch();
    std::fs::write(&path, b"precious").unwrap();
    let made = Writer::create(&path, &info(), &rig(0.0), &Settings::default());
    assert!(matches!(made, Err(DriverError::Io { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn a_frame_of_another_size_is_refused_and_nothing_of_it_is_written() {
    let (_folder, path) = scratch();
    let mut writer = Writer::create(&path, &info(), &rig(0.0), &Settings::default()).unwrap();
    let Frame::Color(mut wrong) = example_color(0, Illumination::Ambient) else {
        unreachable!()
    };
    wrong.pixels = Pixels::Rgb8(Plane::filled(WIDTH + 1, HEIGHT, [0; 3]));
    let refused = writer.push(&Frame::Color(wrong)).unwrap_err().to_string();
    assert!(
        refused.contains("pixels: 7×4") && refused.contains("6×4"),
        "{refused}"
    );
    writer.close().unwrap();
    assert_eq!(read(&path).unwrap().0, vec![]);
}

/// Files that the `mcap` crate itself writes, with one thing wrong.
mod strangers {
    use super::*;
    use mcap::{WriteOptions, records::MessageHeader};
    use std::{collections::BTreeMap, fs::File, io::BufWriter};

    struct Case {
        name: &'static str,
        topic: &'static str,
        schema: &'static str,
        encoding: &'static str,
        data: Vec<u8>,
        /// What the error must name.
        says: &'static str,
    }

    fn session_with(change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
        let mut session = serde_json::json!({
            "format": 1, "device": info(), "rig": rig(0.0), "settings": Settings::default(),
        });
        change(&mut session);
        serde_json::to_vec(&session).unwrap()
    }

    #[test]
    fn each_wrong_message_is_named() {
        let session = |name, says, data| Case {
            name,
            topic: "/session",
            schema: "captured.Session",
            encoding: "json",
            data,
            says,
        };
        let after = |name, topic, schema, encoding, data, says| Case {
            name,
            topic,
            schema,
            encoding,
            data,
            says,
        };
        let frame = |text: &str| text.as_bytes().to_vec();
        let cases = [
            session("not json", "/session", b"{".to_vec()),
            session(
                "a format from the future",
                "format is 2",
                session_with(|s| s["format"] = 2.into()),
            ),
            session(
                "a camera of 10^9 pixels",
                "rig.color",
                session_with(|s| {
                    s["rig"]["color"]["width"] = 1_000_000_000u64.into();
                }),
            ),
            session(
                "a mirror for a rotation",
                "rotation",
                session_with(|s| {
                    let turn = s["rig"]["depth"]["to_color"]["rotation"]
                        .as_array_mut()
                        .unwrap();
                    for value in turn.iter_mut().take(3) {
                        *value = serde_json::json!(-value.as_f64().unwrap());
                    }
                }),
            ),
            after(
                "wrong schema",
                "/color/image",
                "foxglove.Grid",
                "protobuf",
                vec![],
                "/color/image has schema foxglove.Grid",
            ),
            after(
                "wrong encoding",
                "/frame",
                "captured.FrameMetadata",
                "cbor",
                vec![],
                "/frame has schema",
            ),
            after(
                "unknown light",
                "/frame",
                "captured.FrameMetadata",
                "json",
                frame(r#"{"camera":"color","at":1,"sequence":1,"light":"moon"}"#),
                "moon",
            ),
            after(
                "image without frame",
                "/color/image",
                "foxglove.RawImage",
                "protobuf",
                vec![],
                "without a /frame",
            ),
            after(
                "frame without image",
                "/frame",
                "captured.FrameMetadata",
                "json",
                frame(r#"{"camera":"depth","at":1,"sequence":1,"amplitude":false,"sigma":false}"#),
                "images are missing",
            ),
        ];
        for case in cases {
            let (_folder, path) = scratch();
            let mut writer = WriteOptions::new()
                .compression(None)
                .create(BufWriter::new(File::create(&path).unwrap()))
                .unwrap();
            let mut put = |topic: &str, schema: &str, encoding: &str, data: &[u8]| {
                let schema = writer.add_schema(schema, "x", b"").unwrap();
                let id = writer
                    .add_channel(schema, topic, encoding, &BTreeMap::new())
                    .unwrap();
                let header = MessageHeader {
                    channel_id: id,
                    sequence: 0,
                    log_time: 0,
                    publish_time: 0,
                };
                writer.write_to_known_channel(&header, data).unwrap();
            };
            if case.topic != "/session" {
                put(
                    "/session",
                    "captured.Session",
                    "json",
                    &session_with(|_| {}),
                );
            }
            put(case.topic, case.schema, case.encoding, &case.data);
            writer.finish().unwrap();
            match read(&path) {
                Err(error @ DriverError::Malformed { .. }) => {
                    assert!(
                        error.to_string().contains(case.says),
                        "{}: {error}",
                        case.name
                    );
                }
                other => panic!("{}: {other:?}", case.name),
            }
        }
    }
}
