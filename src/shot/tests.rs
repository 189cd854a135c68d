//! Claims about the assembler, most of them for any order of any frames.

use super::{Assembler, DropCounts, Limits, Shot};
use drivers::{
    ColorFrame, DepthFrame, Exposure, FlashLamp, Frame, Illumination, Intrinsics, Pixels, Plane,
    Rig, Settings, Timestamp, Transfer, synthetic,
};
use glam::DVec3;
use proptest::prelude::*;
use std::{collections::HashSet, time::Duration};

const MS: u64 = 1_000_000;
/// Between color frames.
const PERIOD: u64 = 33 * MS;
const SIZE: usize = 16;

fn rig() -> Rig {
    let color = Intrinsics {
        width: SIZE,
        height: SIZE,
        fx: 16.0,
        fy: 16.0,
        cx: 7.5,
        cy: 7.5,
        distortion: drivers::Distortion::None {},
    };
    Rig {
        color,
        depth: None,
        flash: FlashLamp {
            position_metres: DVec3::ZERO,
            intensity: None,
            beam: drivers::Beam::default(),
        },
    }
}

/// Color frame `k`: the room everywhere, and the flash more on one side than on the other.
fn color(k: u64, claimed: Illumination, real: Illumination) -> ColorFrame {
    let pixels = Plane::from_fn(SIZE, SIZE, |x, _| {
        let room = 60 + (k % 3) as u8;
        let flash = if real == Illumination::Flash {
            40 + 6 * x as u8
        } else {
            0
        };
        [room + flash; 3]
    });
    ColorFrame {
        at: Timestamp::from_nanos(1_000_000 * MS + k * PERIOD),
        sequence: k,
        light: claimed,
        exposure: Exposure {
            seconds: 0.01,
            gain: 1.0,
        },
        pixels: Pixels::Rgb8(pixels),
        transfer: Transfer::Srgb,
        black_level: 0.0,
        white_level: 1.0,
    }
}

fn depth(k: u64) -> DepthFrame {
    DepthFrame {
        at: Timestamp::from_nanos(1_000_000 * MS + k * PERIOD + 10 * MS),
        sequence: k,
        metres: Plane::filled(SIZE, SIZE, 1.0),
        amplitude: None,
        sigma: None,
    }
}

/// The light of color frame `k` when every third is a flash.
fn light(k: u64) -> Illumination {
    if k % 3 == 1 {
        Illumination::Flash
    } else {
        Illumination::Ambient
    }
}

fn other(light: Illumination) -> Illumination {
    if light == Illumination::Flash {
        Illumination::Ambient
    } else {
        Illumination::Flash
    }
}

fn in_order(color_frames: u64) -> Vec<Frame> {
    (0..color_frames)
        .flat_map(|k| {
            [
                Frame::Color(color(k, light(k), light(k))),
                Frame::Depth(depth(k)),
            ]
        })
        .collect()
}

fn assemble(frames: Vec<Frame>, limits: Limits) -> (Vec<Shot>, DropCounts) {
    let mut assembler = Assembler::new(rig(), limits);
    let mut shots: Vec<Shot> = frames
        .into_iter()
        .filter_map(|frame| assembler.push(frame))
        .collect();
    shots.extend(assembler.finish());
    (shots, *assembler.drops())
}

fn sequences(shot: &Shot) -> (u64, Vec<u64>, u64) {
    let ambient = shot.ambient.iter().map(|frame| frame.sequence).collect();
    (shot.flash.sequence, ambient, shot.depth.sequence)
}

#[test]
fn frames_in_order_give_each_flash_its_two_neighbours_and_its_depth() {
    let (shots, drops) = assemble(in_order(12), Limits::default());
    let found: Vec<_> = shots.iter().map(sequences).collect();
    let expected: Vec<_> = [1, 4, 7, 10].map(|k| (k, vec![k - 1, k + 1], k)).to_vec();
    assert_eq!(found, expected);
    assert_eq!(drops.harmful(), 0, "{drops:?}");
    assert_eq!(drops.unused_depth, 8);
}

#[test]
fn a_shot_is_given_as_soon_as_its_last_frame_came() {
    let mut assembler = Assembler::new(rig(), Limits::default());
    let given: Vec<bool> = in_order(3)
        .into_iter()
        .map(|frame| assembler.push(frame).is_some())
        .collect();
    // Color 0, depth 0, color 1 (flash), depth 1, color 2: complete.
    assert_eq!(given, [false, false, false, false, true, false]);
}

#[test]
fn a_flash_at_the_end_is_made_with_one_ambient_frame_or_counted() {
    let (shots, drops) = assemble(in_order(2), Limits::default());
    assert_eq!(sequences(&shots[0]), (1, vec![0], 1));
    assert_eq!(drops.harmful(), 0);
    let strict = Limits {
        allow_one_ambient: false,
        ..Limits::default()
    };
    let (shots, drops) = assemble(in_order(2), strict);
    assert!(shots.is_empty());
    assert_eq!(drops.flash_without_ambient, 1);
}

#[test]
fn a_flash_without_ambient_or_depth_is_counted_not_guessed() {
    let flash = || Frame::Color(color(1, Illumination::Flash, Illumination::Flash));
    let (shots, drops) = assemble(vec![flash(), Frame::Depth(depth(1))], Limits::default());
    assert!(shots.is_empty());
    assert_eq!((drops.flash_without_ambient, drops.unused_depth), (1, 1));
    let before = Frame::Color(color(0, Illumination::Ambient, Illumination::Ambient));
    let (shots, drops) = assemble(
        vec![before, flash(), Frame::Depth(depth(8))],
        Limits::default(),
    );
    assert!(shots.is_empty());
    assert_eq!(
        (
            drops.flash_without_depth,
            drops.unused_ambient,
            drops.unused_depth
        ),
        (1, 1, 1)
    );
}

#[test]
fn a_lost_neighbour_costs_one_ambient_frame_not_the_shot() {
    let frames = in_order(9)
        .into_iter()
        .filter(|frame| !matches!(frame, Frame::Color(color) if color.sequence == 2))
        .collect();
    let (shots, drops) = assemble(
        frames,
        Limits {
            bracket_seconds: 0.05,
            ..Limits::default()
        },
    );
    // The flash that waited in vain comes out after the one that was complete.
    let mut found: Vec<_> = shots.iter().map(sequences).collect();
    found.sort();
    assert_eq!(
        found,
        [(1, vec![0], 1), (4, vec![3, 5], 4), (7, vec![6, 8], 7)]
    );
    assert_eq!(drops.harmful(), 0);
}

#[test]
fn flicker_that_brightens_the_whole_room_is_no_flash() {
    let bright = |k: u64, claimed, value: u8| {
        let mut frame = color(k, claimed, Illumination::Ambient);
        // A room with some structure, times a factor.
        frame.transfer = Transfer::Linear;
        frame.pixels = Pixels::Rgb8(Plane::from_fn(SIZE, SIZE, |x, y| {
            [((40 + 5 * x + 2 * y) * value as usize / 10) as u8; 3]
        }));
        Frame::Color(frame)
    };
    let frames = vec![
        bright(0, Illumination::Ambient, 10),
        bright(1, Illumination::Flash, 14),
        Frame::Depth(depth(1)),
        bright(2, Illumination::Ambient, 10),
    ];
    let (shots, drops) = assemble(frames, Limits::default());
    assert!(shots.is_empty());
    assert_eq!(drops.contradicted, 3);
}

#[test]
fn a_frame_of_the_wrong_size_or_exposure_never_passes() {
    let mut small = color(1, Illumination::Flash, Illumination::Flash);
    small.pixels = Pixels::Rgb8(Plane::filled(4, 4, [0; 3]));
    let mut dark = color(1, Illumination::Flash, Illumination::Flash);
    dark.exposure.seconds = f32::NAN;
    let mut broken = color(1, Illumination::Flash, Illumination::Flash);
    broken.pixels = Pixels::Mjpg {
        width: SIZE,
        height: SIZE,
        bytes: vec![0xff, 0xd8, 0xff, 0xd9],
    };
    let frames = vec![
        Frame::Color(small),
        Frame::Color(dark),
        Frame::Color(broken),
    ];
    let (shots, drops) = assemble(frames, Limits::default());
    assert!(shots.is_empty());
    assert_eq!((drops.malformed, drops.unreadable), (2, 1));
}

#[test]
fn memory_stays_bounded_whatever_comes() {
    let limits = Limits::default();
    let mut assembler = Assembler::new(rig(), limits);
    for k in 0..2000 {
        // Only one light, or only depth: nothing ever becomes complete.
        assembler.push(Frame::Color(color(
            k,
            Illumination::Flash,
            Illumination::Flash,
        )));
        assembler.push(Frame::Depth(depth(k)));
        assert!(assembler.color.len() <= limits.pending_frames);
        assert!(assembler.depth.len() <= limits.pending_frames);
    }
    assert!(assembler.color_seen.times.len() <= 256);
}

#[test]
fn one_frame_from_the_far_future_spoils_at_most_its_own_shot() {
    let mut frames = in_order(30);
    frames.insert(
        9,
        Frame::Color(color(
            1_000_000,
            Illumination::Ambient,
            Illumination::Ambient,
        )),
    );
    let (shots, _) = assemble(frames, Limits::default());
    assert!(shots.len() >= 9, "{} of 10", shots.len());
    assert!(shots.iter().all(|shot| shot.ambient.len() == 2));
}

#[test]
fn every_pixel_kind_proves_its_flash() {
    for (name, pixels) in synthetic::PixelKind::NAMES {
        for layout in synthetic::Layout::ALL {
            let options = synthetic::Options {
                layout,
                width: 64,
                height: 48,
                depth_width: 32,
                pixels,
                ..synthetic::Options::default()
            };
            let mut device = synthetic::Synthetic::new(options);
            let rig = drivers::Device::rig(&device);
            let mut stream = drivers::Device::start(&mut device, &Settings::default()).unwrap();
            let mut assembler = Assembler::new(rig, Limits::default());
            let mut shots = 0;
            for _ in 0..24 {
                let frame = stream.next_frame(Duration::ZERO).unwrap();
                shots += usize::from(assembler.push(frame).is_some());
            }
            assert_eq!(
                (shots, assembler.drops().harmful()),
                (4, 0),
                "{name} {layout:?}"
            );
        }
    }
}

#[test]
fn a_mislabelled_short_exposure_under_mains_flicker_is_still_found() {
    // 3 ms under 100 Hz at 60 % modulation: the room alone changes by up to a factor of three.
    let mut wrong = 0;
    for seed in 0..6 {
        let address = format!(
            "flaky:mislabel=0.3,seed={seed}:synthetic:desk?width=64&depth_width=32&flicker=0.6&seed={seed}&rate=29"
        );
        let mut device = drivers::open(&address).unwrap();
        let rig = device.rig();
        let settings = Settings {
            exposure_seconds: Some(0.003),
            ..Settings::default()
        };
        let mut stream = device.start(&settings).unwrap();
        let mut assembler = Assembler::new(rig, Limits::default());
        for _ in 0..60 {
            if let Some(shot) = assembler.push(stream.next_frame(Duration::ZERO).unwrap()) {
                let ambient_lies = shot
                    .ambient
                    .iter()
                    .any(|frame| light(frame.sequence) == Illumination::Flash);
                wrong +=
                    usize::from(light(shot.flash.sequence) != Illumination::Flash || ambient_lies);
            }
        }
        assert!(assembler.drops().contradicted > 0);
    }
    assert_eq!(wrong, 0);
}

/// What happens to one frame on its way.
#[derive(Debug, Clone, Copy)]
struct Fate {
    dropped: bool,
    copies: u8,
    /// Places it moves back, in frames.
    late: u16,
    lies: bool,
}

fn fates(count: usize, lies: f64) -> impl Strategy<Value = Vec<Fate>> {
    let late = prop_oneof![6 => Just(0u16), 3 => 0u16..6, 1 => 0u16..400];
    let copies = prop_oneof![8 => Just(1u8), 2 => 1u8..4];
    let fate = (
        prop::bool::weighted(0.15),
        copies,
        late,
        prop::bool::weighted(lies),
    )
        .prop_map(|(dropped, copies, late, lies)| Fate {
            dropped,
            copies,
            late,
            lies,
        });
    proptest::collection::vec(fate, count)
}

fn disturbed(fates: &[Fate]) -> Vec<Frame> {
    let mut arrivals: Vec<(usize, Frame)> = Vec::new();
    for (place, fate) in fates.iter().enumerate() {
        let k = place as u64 / 2;
        let frame = if place % 2 == 0 {
            let claimed = if fate.lies { other(light(k)) } else { light(k) };
            Frame::Color(color(k, claimed, light(k)))
        } else {
            Frame::Depth(depth(k))
        };
        if !fate.dropped {
            for copy in 0..usize::from(fate.copies) {
                // Later copies come later still.
                arrivals.push((
                    place + usize::from(fate.late) * (1 + 2 * copy),
                    frame.clone(),
                ));
            }
        }
    }
    arrivals.sort_by_key(|(place, _)| *place);
    arrivals.into_iter().map(|(_, frame)| frame).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_frame_is_used_twice_and_no_pair_is_wrong_for_any_interleaving(
        fates in prop_oneof![fates(60, 0.0), fates(60, 0.2), fates(400, 0.05)],
        one in any::<bool>(),
    ) {
        let limits = Limits { allow_one_ambient: one, ..Limits::default() };
        let frames = disturbed(&fates);
        let pushed = frames.len() as u64;
        let (shots, drops) = assemble(frames, limits);
        let (mut colors, mut depths, mut used) = (HashSet::new(), HashSet::new(), 0);
        for shot in &shots {
            used += 2 + shot.ambient.len() as u64;
            prop_assert_eq!(light(shot.flash.sequence), Illumination::Flash);
            let least = if one { 1 } else { 2 };
            prop_assert!((least..=2).contains(&shot.ambient.len()));
            prop_assert!(colors.insert(shot.flash.at), "flash used twice");
            prop_assert!(depths.insert(shot.depth.at), "depth used twice");
            prop_assert!(shot.depth.at.distance(shot.flash.at).as_secs_f32() <= limits.depth_seconds);
            for ambient in &shot.ambient {
                prop_assert_eq!(light(ambient.sequence), Illumination::Ambient);
                prop_assert!(colors.insert(ambient.at), "ambient used twice");
                prop_assert!(ambient.at.distance(shot.flash.at).as_secs_f32() <= limits.bracket_seconds);
            }
            if let [before, after] = &shot.ambient[..] {
                prop_assert!(before.at < shot.flash.at && shot.flash.at < after.at);
            }
        }
        prop_assert_eq!(used + drops.total(), pushed, "every frame is used or counted: {:?}", drops);
    }

    #[test]
    fn small_disorder_without_loss_costs_no_shot(
        swaps in proptest::collection::vec(0usize..4, 60),
    ) {
        let mut arrivals: Vec<(usize, Frame)> =
            in_order(30).into_iter().enumerate().map(|(place, frame)| (place + swaps[place], frame)).collect();
        arrivals.sort_by_key(|(place, _)| *place);
        let (shots, drops) = assemble(arrivals.into_iter().map(|(_, frame)| frame).collect(), Limits::default());
        prop_assert_eq!(shots.len(), 10);
        prop_assert_eq!(drops.harmful(), 0);
    }
}
