//! What holds for all eighteen.

use super::{CORRUPTIONS, Corruption, CorruptionError, MOST_SEVERE, field::field};
use crate::{
    develop::{Options, develop},
    radiometry::linearise,
    shot::Shot,
    verdict::judge,
};
use drivers::{
    ColorFrame, DepthFrame, Distortion, Exposure, FlashLamp, Frame, Illumination, Intrinsics,
    Pixels, Plane, Rig, Timestamp, Transfer, admission::admit, chance::Chance,
};
use glam::DVec3;
use proptest::prelude::*;

/// Those that roll dice.
const RANDOM: [&str; 11] = [
    "tof-noise",
    "depth-holes",
    "flying-pixels",
    "misalignment",
    "bright-ambient",
    "motion",
    "hand-shake",
    "mains-flicker",
    "sensor-noise",
    "infrared-black",
    "mirror",
];

/// A corner of three walls, a ball, poles of 1 to 15 pixels and a patch without answer, spotted
/// without repetition; lit by a flash at the lens and by a lamp overhead.
fn corner(side: usize, room: Option<f32>) -> Shot {
    let at = |pixel: usize| (pixel as f32 - 0.5 * (side - 1) as f32) / (1.2 * side as f32);
    let pixels = |share: f32| share * side as f32 / 256.0;
    let metres = Plane::from_fn(side, side, |x, y| {
        let (u, v) = (at(x), at(y));
        let mut z = 2.0_f32;
        z = if v > 0.0 { z.min(0.45 / v) } else { z };
        z = if u < 0.0 { z.min(-0.5 / u) } else { z };
        // A ball of 18 cm, a metre away: |z (u, v, 1) − centre|² = r².
        let (a, b) = (u * u + v * v + 1.0, 0.1 * u + 0.05 * v + 1.0);
        let inside = b * b - a * (0.01 + 0.0025 + 1.0 - 0.0324);
        z = if inside > 0.0 {
            z.min((b - inside.sqrt()) / a)
        } else {
            z
        };
        for (pole, wide) in [1.0, 3.0, 5.0, 9.0, 15.0].into_iter().enumerate() {
            let left = pixels(150.0 + 20.0 * pole as f32);
            let across = x as f32 - left;
            let upper = (y as f32) < pixels(110.0);
            if upper && (0.0..pixels(wide)).contains(&across) {
                z = z.min(1.3);
            }
        }
        let hole = (x as f32) < pixels(12.0) && (y as f32) < pixels(12.0);
        if hole { f32::NAN } else { z }
    });
    let spots = field((side, side), pixels(9.0), Chance::new(77));
    let albedo = |x, y| [0.2 + 0.7 * spots[(x, y)], 0.5, 0.8 - 0.6 * spots[(x, y)]];
    let falloff = metres.map(|z| if z.is_finite() { 0.5 / (z * z) } else { 0.1 });
    let photograph = |flash: f32, room: f32| {
        Pixels::RgbF32(Plane::from_fn(side, side, |x, y| {
            let light = flash * falloff[(x, y)] + room * (0.3 - 0.2 * at(y));
            albedo(x, y).map(|albedo| light * albedo)
        }))
    };
    let frame = |light, pixels| ColorFrame {
        at: Timestamp::from_nanos(u64::from(light == Illumination::Flash)),
        sequence: u64::from(light == Illumination::Flash),
        light,
        exposure: Exposure {
            seconds: 0.5,
            gain: 1.0,
        },
        pixels,
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    };
    let middle = 0.5 * (side - 1) as f64;
    Shot {
        flash: frame(
            Illumination::Flash,
            photograph(0.5, 0.5 * room.unwrap_or(0.0)),
        ),
        ambient: room
            .map(|room| frame(Illumination::Ambient, photograph(0.0, 0.5 * room)))
            .into_iter()
            .collect(),
        depth: DepthFrame {
            at: Timestamp::from_nanos(1),
            sequence: 0,
            amplitude: Some(Plane::from_fn(side, side, |x, y| {
                falloff[(x, y)] * (0.3 + spots[(x, y)])
            })),
            sigma: Some(metres.map(|z| z * 1e-3)),
            metres,
        },
        rig: Rig {
            color: Intrinsics {
                width: side,
                height: side,
                fx: 1.2 * side as f64,
                fy: 1.2 * side as f64,
                cx: middle,
                cy: middle,
                distortion: Distortion::None {},
            },
            depth: None,
            flash: FlashLamp {
                position_metres: DVec3::ZERO,
                intensity: Some(1.0),
                beam: drivers::Beam::default(),
            },
        },
        mask: None,
    }
}

/// Light of the flash alone, as the simplest method has it.
fn flash_alone(shot: &Shot) -> Plane<[f32; 3]> {
    let mut light = linearise(&shot.flash).unwrap().0;
    if let Some(ambient) = shot.ambient.first() {
        let ambient = linearise(ambient).unwrap().0;
        for (light, room) in light.samples_mut().iter_mut().zip(ambient.samples()) {
            *light = std::array::from_fn(|channel| light[channel] - room[channel]);
        }
    }
    light
}

/// How far a shot is from the clean one: mean error of depth in metres, a lost answer counting as
/// half a metre, plus mean error of the flash's light as a share of its mean, a lost pixel counting
/// as twice the mean. The coarser depth grid is compared by its nearest samples.
fn damage(clean: &Shot, worse: &Shot) -> f64 {
    let (before, after) = (&clean.depth.metres, &worse.depth.metres);
    let ((width, height), (columns, rows)) = (before.size(), after.size());
    let (mut depth, mut known) = (0.0, 0.0);
    for y in 0..height {
        for x in 0..width {
            let z = before[(x, y)];
            if z.is_finite() {
                let error = (after[(x * columns / width, y * rows / height)] - z).abs();
                depth += f64::from(if error.is_nan() { 0.5 } else { error });
                known += 1.0;
            }
        }
    }
    let (before, after) = (flash_alone(clean), flash_alone(worse));
    let (mut light, mut total) = (0.0, 0.0);
    let pairs = before
        .samples()
        .as_flattened()
        .iter()
        .zip(after.samples().as_flattened());
    let mean = before.samples().as_flattened().iter().sum::<f32>() / (3 * before.len()) as f32;
    for (before, after) in pairs {
        let error = (after - before).abs();
        light += f64::from(if error.is_nan() { 2.0 * mean } else { error });
        total += f64::from(*before);
    }
    depth / known + light / total
}

/// Everything a shot holds, bit for bit.
fn bits(shot: &Shot) -> String {
    let plane = |plane: &Plane<f32>| {
        let bits: Vec<u32> = plane
            .samples()
            .iter()
            .map(|value| value.to_bits())
            .collect();
        (plane.size(), blake3::hash(bytemuck::cast_slice(&bits)))
    };
    let frame = |frame: &ColorFrame| {
        let pixels = match &frame.pixels {
            Pixels::RgbF32(plane) => blake3::hash(bytemuck::cast_slice(plane.samples())),
            Pixels::Mjpg { bytes, .. } => blake3::hash(bytes),
            other => panic!("{other:?} was not asked for"),
        };
        let rest = ColorFrame {
            pixels: Pixels::Mjpg {
                width: 0,
                height: 0,
                bytes: Vec::new(),
            },
            ..frame.clone()
        };
        format!("{pixels} {rest:?}")
    };
    let depth = &shot.depth;
    let planes = [
        Some(&depth.metres),
        depth.amplitude.as_ref(),
        depth.sigma.as_ref(),
    ];
    format!(
        "{} {:?} {:?} {:?} {:?} {:?}",
        frame(&shot.flash),
        shot.ambient.iter().map(frame).collect::<Vec<_>>(),
        planes.map(|found| found.map(plane)),
        (depth.at, depth.sequence),
        shot.rig,
        shot.mask,
    )
}

#[test]
fn the_damage_of_all_eighteen_grows_with_severity() {
    for room in [Some(0.4), None] {
        let clean = corner(256, room);
        for corruption in &CORRUPTIONS {
            let at = |severity| {
                let worse = corruption.on_shot(&clean, severity, 11).unwrap();
                damage(&clean, &worse)
            };
            let damages: Vec<f64> = (0..=MOST_SEVERE).map(at).collect();
            assert_eq!(damages[0], 0.0, "{}", corruption.name);
            assert!(
                damages.windows(2).all(|pair| pair[1] > pair[0]),
                "{} with room {room:?}: {damages:?}",
                corruption.name
            );
        }
    }
}

#[test]
fn only_those_that_roll_dice_differ_by_seed() {
    let clean = corner(96, Some(0.4));
    for corruption in &CORRUPTIONS {
        let with = |seed| bits(&corruption.on_shot(&clean, 3, seed).unwrap());
        assert_eq!(with(5), with(5), "{}", corruption.name);
        let random = RANDOM.contains(&corruption.name);
        assert_eq!(with(5) != with(6), random, "{}", corruption.name);
    }
}

#[test]
fn whatever_comes_out_passes_the_door_and_keeps_its_sizes() {
    for room in [Some(0.4), None] {
        let clean = corner(96, room);
        for corruption in &CORRUPTIONS {
            for severity in 1..=MOST_SEVERE {
                let name = format!("{}:{severity}", corruption.name);
                let worse = corruption.on_shot(&clean, severity, 3).unwrap();
                for frame in worse.ambient.iter().chain([&worse.flash]) {
                    admit(&Frame::Color(frame.clone()), &worse.rig)
                        .unwrap_or_else(|refusal| panic!("{name}: {refusal}"));
                    assert_eq!(frame.pixels.size(), (96, 96), "{name}");
                }
                admit(&Frame::Depth(worse.depth.clone()), &worse.rig)
                    .unwrap_or_else(|refusal| panic!("{name}: {refusal}"));
                if corruption.name == "low-depth-resolution" || corruption.name == "misalignment" {
                    continue;
                }
                let pairs = clean.depth.metres.samples().iter();
                for (before, after) in pairs.zip(worse.depth.metres.samples()) {
                    assert!(!before.is_nan() || after.is_nan(), "{name} fills a hole");
                }
            }
        }
    }
}

#[test]
fn what_cannot_be_spoiled_is_an_error_that_says_why() {
    let mut blind = corner(32, None);
    blind.depth.metres = blind.depth.metres.map(|_| f32::NAN);
    let mut dark = corner(32, None);
    dark.flash.pixels = Pixels::RgbF32(Plane::filled(32, 32, [0.0; 3]));
    for corruption in &CORRUPTIONS {
        // Each spoils depth or photographs; a shot with neither gives each a reason to refuse.
        let mut neither = blind.clone();
        neither.flash = dark.flash.clone();
        match corruption.on_shot(&neither, 2, 0) {
            Err(CorruptionError::NoDepth | CorruptionError::NoLight { .. }) => {}
            Ok(_) if corruption.name == "hand-shake" => {}
            other => panic!("{}: {other:?}", corruption.name),
        }
        let error = corruption.on_shot(&blind, 6, 0).unwrap_err().to_string();
        assert!(
            error.contains(corruption.name) && error.contains("6"),
            "{error}"
        );
    }
    let error = Corruption::named("rain").unwrap_err().to_string();
    for corruption in &CORRUPTIONS {
        assert!(error.contains(corruption.name), "{error}");
    }
}

#[test]
fn what_lies_at_the_range_comes_back_as_nearly_nothing_and_the_near_stays() {
    // By hand: of the distances 1.0 and 2.6 m half lie at 2.6 m, which becomes the range, so they
    // come back as nearly nothing; and the near half stays.
    let mut clean = corner(64, None);
    clean.depth.metres = Plane::from_fn(64, 64, |x, _| if x < 32 { 1.0 } else { 2.6 });
    let wrapped = Corruption::named("phase-wrap")
        .unwrap()
        .on_shot(&clean, 5, 0)
        .unwrap();
    let near = wrapped
        .depth
        .metres
        .samples()
        .iter()
        .filter(|z| **z < 0.5)
        .count();
    let kept = wrapped
        .depth
        .metres
        .samples()
        .iter()
        .filter(|z| **z == 1.0)
        .count();
    assert_eq!((near, kept), (32 * 64, 32 * 64));
}

#[test]
fn poles_vanish_in_depth_when_they_are_as_thin_as_stated() {
    // Poles are 1, 3, 5, 9 and 15 pixels wide at 256; severity 3 takes all up to 6 pixels.
    let clean = corner(256, None);
    let thinned = Corruption::named("thin-structures")
        .unwrap()
        .on_shot(&clean, 3, 0)
        .unwrap();
    for (pole, stays) in [(0, false), (1, false), (2, false), (3, true), (4, true)] {
        let (x, y) = (150 + 20 * pole, 60);
        assert_eq!(clean.depth.metres[(x, y)], 1.3);
        assert_eq!(thinned.depth.metres[(x, y)] == 1.3, stays, "pole {pole}");
    }
}

#[test]
fn a_corner_gets_deeper_and_a_flat_wall_stays_by_multipath() {
    let multipath = Corruption::named("multipath").unwrap();
    let mut clean = corner(128, None);
    clean.depth.metres = Plane::filled(128, 128, 1.5);
    let flat = multipath.on_shot(&clean, 5, 0).unwrap();
    let moved = flat.depth.metres.samples().iter().map(|z| (z - 1.5).abs());
    // Rounding: single precision at 1.5 m.
    assert!(moved.fold(0.0, f32::max) < 1e-5);
    let clean = corner(128, None);
    let worse = multipath.on_shot(&clean, 3, 0).unwrap();
    let deeper = |x, y| worse.depth.metres[(x, y)] - clean.depth.metres[(x, y)];
    // Where floor, wall and side wall meet, against the middle of the back wall.
    assert!(
        deeper(24, 92) > 2.0 * deeper(70, 20).max(0.0),
        "{} {}",
        deeper(24, 92),
        deeper(70, 20)
    );
    assert!(deeper(24, 92) > 1e-3);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn severity_nought_changes_no_bit(seed in any::<u64>(), which in 0..18_usize, lit in any::<bool>()) {
        let clean = corner(48, lit.then_some(0.3));
        let same = CORRUPTIONS[which].on_shot(&clean, 0, seed).unwrap();
        prop_assert_eq!(bits(&same), bits(&clean));
    }

    #[test]
    fn for_any_seed_the_worst_is_worse_than_the_mildest(seed in any::<u64>(), which in 0..18_usize) {
        let clean = corner(96, Some(0.3));
        let corruption = &CORRUPTIONS[which];
        let at = |severity| damage(&clean, &corruption.on_shot(&clean, severity, seed).unwrap());
        prop_assert!(at(5) > at(1), "{}", corruption.name);
    }
}

#[test]
fn each_at_its_worst_is_found_by_the_verdict_and_nothing_is_found_in_the_clean_corner() {
    for room in [None, Some(0.5)] {
        let clean = corner(128, room);
        let findings = |shot: &Shot| {
            let development = develop(shot, &Options::default(), &mut |_| {}).unwrap();
            judge(shot, &development).findings
        };
        for finding in findings(&clean) {
            assert!(!finding.is_harmful(), "clean corner: {finding:?}");
        }
        for corruption in &CORRUPTIONS {
            let worst = corruption.on_shot(&clean, MOST_SEVERE, 0).unwrap();
            let found = findings(&worst);
            let found = found.iter().find(|f| f.mode == corruption.name).unwrap();
            assert!(found.is_harmful(), "room {room:?}: {found:?}");
        }
    }
}
