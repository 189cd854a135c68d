//! What can go wrong with a camera.

use super::{
    camera::{Fault, Way},
    matrix::PATIENCE,
};
use drivers::{Frame, Illumination, Pixels, Plane, Timestamp};
use std::{collections::VecDeque, time::Duration};

const MS: u64 = 1_000_000;
const HOUR: u64 = 3_600_000 * MS;

fn date(frame: &mut Frame, to: impl Fn(u64) -> u64) {
    let at = match frame {
        Frame::Color(frame) => &mut frame.at,
        Frame::Depth(frame) => &mut frame.at,
    };
    *at = Timestamp::from_nanos(to(at.as_nanos()));
}

fn recolor(frame: &mut Frame, to: impl Fn(&Plane<[u8; 3]>) -> Pixels) {
    if let Frame::Color(color) = frame
        && let Pixels::Rgb8(pixels) = &color.pixels
    {
        color.pixels = to(pixels);
    }
}

fn remeasure(frame: &mut Frame, metres: f32) {
    if let Frame::Depth(depth) = frame {
        depth.metres = depth.metres.map(|_| metres);
    }
}

fn light(frame: &Frame) -> Option<Illumination> {
    match frame {
        Frame::Color(color) => Some(color.light),
        Frame::Depth(_) => None,
    }
}

/// Passes on frames but those of a kind.
fn without(frame: Frame, kind: Option<Illumination>) -> Vec<Frame> {
    match light(&frame) == kind {
        true => Vec::new(),
        false => vec![frame],
    }
}

fn late(held: &mut VecDeque<Frame>, frame: Frame, by: usize) -> Vec<Frame> {
    held.push_back(frame);
    match held.len() > by {
        true => held.pop_front().into_iter().collect(),
        false => Vec::new(),
    }
}

/// Each of them, with its name.
pub(super) const FAULTS: &[(&str, Fault)] = &[
    ("cannot be opened: gone", Fault::Open(Way::NoDevice)),
    ("cannot be opened: no permission", Fault::Open(Way::Io(13))),
    ("cannot be opened: busy", Fault::Open(Way::Io(16))),
    ("cannot be opened: malformed", Fault::Open(Way::Malformed)),
    ("cannot be opened: hardware", Fault::Open(Way::Hardware)),
    ("cannot be opened: silent", Fault::Open(Way::Timeout)),
    ("panics while it is opened", Fault::Open(Way::Panic)),
    ("panics when asked what it is", Fault::Info),
    ("panics when asked for its rig", Fault::Rig),
    ("does not start: unplugged", Fault::Start(Way::Unplugged)),
    ("does not start: busy", Fault::Start(Way::Io(16))),
    ("does not start: a setting", Fault::Start(Way::Setting)),
    ("does not start: hardware", Fault::Start(Way::Hardware)),
    ("does not start: no device", Fault::Start(Way::NoDevice)),
    ("does not start: silent", Fault::Start(Way::Timeout)),
    ("does not start: malformed", Fault::Start(Way::Malformed)),
    ("panics when it starts", Fault::Start(Way::Panic)),
    ("no frame: time out", Fault::Frame(Way::Timeout)),
    ("no frame: unplugged", Fault::Frame(Way::Unplugged)),
    ("no frame: ended", Fault::Frame(Way::Ended)),
    ("no frame: a setting", Fault::Frame(Way::Setting)),
    ("no frame: malformed", Fault::Frame(Way::Malformed)),
    ("no frame: no device", Fault::Frame(Way::NoDevice)),
    ("no frame: hardware", Fault::Frame(Way::Hardware)),
    ("no frame: EIO", Fault::Frame(Way::Io(5))),
    ("no frame: ENODEV", Fault::Frame(Way::Io(19))),
    ("panics in place of a frame", Fault::Frame(Way::Panic)),
    ("panics when it stops", Fault::Stop),
    ("panics when it is closed", Fault::Close),
    (
        "frames 200 ms apart",
        Fault::Blocks(Duration::from_millis(200)),
    ),
    (
        "frames as far apart as its patience",
        Fault::Blocks(PATIENCE),
    ),
    (
        "does not keep its patience",
        Fault::Blocks(Duration::from_secs(3)),
    ),
    (
        "hangs for half a minute",
        Fault::Blocks(Duration::from_secs(30)),
    ),
    ("silent", Fault::Silent),
    ("pulled out for 3 s", Fault::Gone),
    ("another camera, of another size, put in", Fault::Foreign),
    (
        "short pictures",
        Fault::Spoil(|frame| {
            recolor(frame, |pixels| {
                let (width, height) = pixels.size();
                Pixels::Yuyv {
                    width,
                    height,
                    bytes: vec![0; width * height],
                }
            })
        }),
    ),
    (
        "pictures of another size",
        Fault::Spoil(|frame| recolor(frame, |_| Pixels::Rgb8(Plane::filled(8, 8, [60; 3])))),
    ),
    (
        "empty pictures",
        Fault::Spoil(|frame| recolor(frame, |_| Pixels::Rgb8(Plane::default()))),
    ),
    (
        "garbage that claims to be JPEG",
        Fault::Spoil(|frame| {
            recolor(frame, |pixels| {
                let (width, height) = pixels.size();
                Pixels::Mjpg {
                    width,
                    height,
                    bytes: [0xff, 0xd8, 0xff, 0xc0, 0, 3].repeat(50),
                }
            })
        }),
    ),
    (
        "clipped pictures",
        Fault::Spoil(|frame| recolor(frame, |pixels| Pixels::Rgb8(pixels.map(|_| [255; 3])))),
    ),
    (
        "black pictures",
        Fault::Spoil(|frame| recolor(frame, |pixels| Pixels::Rgb8(pixels.map(|_| [0; 3])))),
    ),
    (
        "the flash does not fire",
        Fault::Spoil(|frame| {
            recolor(frame, |pixels| {
                let corner = pixels[(0, 0)];
                let room = corner[0] & !3;
                let mut dark = pixels.map(|_| [room; 3]);
                dark[(0, 0)] = corner;
                Pixels::Rgb8(dark)
            })
        }),
    ),
    (
        "the flash lights half of the rows",
        Fault::Spoil(|frame| {
            recolor(frame, |pixels| {
                let room = pixels[(0, 0)][0] & !3;
                let mut half = pixels.clone();
                for y in 0..half.height() / 2 {
                    half.row_mut(y).fill([room; 3]);
                }
                half[(0, 0)] = pixels[(0, 0)];
                Pixels::Rgb8(half)
            })
        }),
    ),
    (
        "no exposure",
        Fault::Spoil(|frame| {
            if let Frame::Color(color) = frame {
                color.exposure.seconds = 0.0
            }
        }),
    ),
    (
        "an exposure that is no number",
        Fault::Spoil(|frame| {
            if let Frame::Color(color) = frame {
                color.exposure.gain = f32::NAN
            }
        }),
    ),
    (
        "black level above white",
        Fault::Spoil(|frame| {
            if let Frame::Color(color) = frame {
                color.black_level = 2.0
            }
        }),
    ),
    (
        "flash said to be none, and none to be flash",
        Fault::Spoil(|frame| {
            if let Frame::Color(color) = frame {
                color.light = match color.light {
                    Illumination::Flash => Illumination::Ambient,
                    Illumination::Ambient => Illumination::Flash,
                };
            }
        }),
    ),
    (
        "short depth",
        Fault::Spoil(|frame| {
            if let Frame::Depth(depth) = frame {
                depth.metres = Plane::filled(3, 3, 1.0);
            }
        }),
    ),
    (
        "depth behind the camera",
        Fault::Spoil(|frame| remeasure(frame, -1.0)),
    ),
    (
        "depth without end",
        Fault::Spoil(|frame| remeasure(frame, f32::INFINITY)),
    ),
    (
        "its clock an hour ahead",
        Fault::Spoil(|frame| date(frame, |at| at + HOUR)),
    ),
    (
        "its clock an hour behind",
        Fault::Spoil(|frame| date(frame, |at| at.saturating_sub(HOUR))),
    ),
    (
        "its clock stands still",
        Fault::Spoil(|frame| date(frame, |_| HOUR)),
    ),
    (
        "its clock at the end of time",
        Fault::Spoil(|frame| date(frame, |_| u64::MAX)),
    ),
    (
        "depth on another clock",
        Fault::Spoil(|frame| {
            if light(frame).is_none() {
                date(frame, |at| at + HOUR)
            }
        }),
    ),
    (
        "every frame twice",
        Fault::Order(|_, frame| vec![frame.clone(), frame]),
    ),
    (
        "every two frames exchanged",
        Fault::Order(|held, frame| match held.pop_front() {
            Some(first) => vec![frame, first],
            None => {
                held.push_back(frame);
                Vec::new()
            }
        }),
    ),
    (
        "frames ten late",
        Fault::Order(|held, frame| late(held, frame, 10)),
    ),
    (
        "flash frames late, behind four others",
        Fault::Order(|held, frame| match light(&frame) {
            Some(Illumination::Flash) => {
                held.push_back(frame);
                Vec::new()
            }
            _ => {
                let due = held
                    .front()
                    .is_some_and(|flash| frame.sequence() >= flash.sequence() + 2);
                let due = if due { held.pop_front() } else { None };
                [Some(frame), due].into_iter().flatten().collect()
            }
        }),
    ),
    (
        "flash frames lost",
        Fault::Order(|_, frame| without(frame, Some(Illumination::Flash))),
    ),
    (
        "ambient frames lost",
        Fault::Order(|_, frame| without(frame, Some(Illumination::Ambient))),
    ),
    (
        "depth frames lost",
        Fault::Order(|_, frame| without(frame, None)),
    ),
    (
        "one frame for ever",
        Fault::Order(|held, frame| {
            if held.is_empty() {
                held.push_back(frame);
            }
            held.front().cloned().into_iter().collect()
        }),
    ),
];
