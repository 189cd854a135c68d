//! Shots whose failure is known by how they were made.

use super::{Finding, Verdict, judge};
use crate::{
    develop::{Options, develop},
    shot::Shot,
};
use drivers::{
    ColorFrame, DepthFrame, Distortion, Exposure, FlashLamp, Illumination, Intrinsics, Pixels,
    Plane, Rig, Timestamp, Transfer, chance::Chance,
};
use glam::DVec3;

const SIDE: usize = 128;

/// A wall two metres away with a box before it, in patches of grey, lit by a flash at the lens that
/// `photographed` may change pixel by pixel; depth as `sensed` says of the true one.
fn wall(
    size: (usize, usize),
    photographed: impl Fn(usize, usize, f32) -> f32 + Sync,
    sensed: impl Fn(usize, usize, f32) -> f32 + Sync,
) -> Shot {
    let (width, height) = size;
    let inside = |at: usize, end: usize| (3 * end / 10..6 * end / 10).contains(&at);
    let truth = Plane::from_fn(width, height, |x, y| {
        if inside(x, width) && inside(y, height) {
            1.4
        } else {
            2.0f32
        }
    });
    let patch =
        |x: usize, y: usize| 0.3 + 0.4 * Chance::new(5).unit((y / 11 * 100 + x / 11) as u64) as f32;
    let light = Plane::from_fn(width, height, |x, y| {
        [photographed(x, y, patch(x, y) / truth[(x, y)].powi(2)); 3]
    });
    let frame = ColorFrame {
        at: Timestamp::from_nanos(1),
        sequence: 1,
        light: Illumination::Flash,
        exposure: Exposure::UNIT,
        pixels: Pixels::RgbF32(light),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    };
    let focal = 0.9 * width.max(height) as f64;
    Shot {
        flash: frame,
        ambient: Vec::new(),
        depth: DepthFrame {
            at: Timestamp::from_nanos(1),
            sequence: 0,
            metres: Plane::from_fn(width, height, |x, y| sensed(x, y, truth[(x, y)])),
            amplitude: None,
            sigma: None,
        },
        rig: Rig {
            color: Intrinsics {
                width,
                height,
                fx: focal,
                fy: focal,
                cx: 0.5 * (width - 1) as f64,
                cy: 0.5 * (height - 1) as f64,
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

fn as_it_is(_: usize, _: usize, value: f32) -> f32 {
    value
}

/// The same with a photograph without flash, of a room that sends `room` everywhere.
fn in_room(mut shot: Shot, room: f32) -> Shot {
    shot.ambient = vec![ColorFrame {
        at: Timestamp::from_nanos(0),
        sequence: 0,
        light: Illumination::Ambient,
        pixels: Pixels::RgbF32(Plane::filled(SIDE, SIDE, [room; 3])),
        ..shot.flash.clone()
    }];
    shot
}

fn judged(shot: &Shot) -> Verdict {
    let development = develop(shot, &Options::default(), &mut |_| {}).unwrap();
    judge(shot, &development)
}

fn found(shot: &Shot, mode: &str) -> Finding {
    let findings = judged(shot).findings;
    findings.into_iter().find(|f| f.mode == mode).unwrap()
}

#[test]
fn nothing_is_found_in_a_good_shot_and_most_of_it_is_trusted() {
    let verdict = judged(&wall((SIDE, SIDE), as_it_is, as_it_is));
    assert_eq!(verdict.harmful(), Vec::<&Finding>::new());
    let trusted = verdict.confidence.samples().iter().filter(|c| **c > 0.5);
    assert!(trusted.count() > SIDE * SIDE * 8 / 10);
}

#[test]
fn depth_noise_is_measured() {
    let chance = Chance::new(1);
    let noise = |x, y, z: f32| z * (1.0 + 0.01 * chance.normal((y * SIDE + x) as u64));
    // 1 % of noise is twice the half per cent that does harm.
    let score = found(&wall((SIDE, SIDE), as_it_is, noise), "tof-noise").score;
    assert!((score - 2.0).abs() < 0.2, "{score}");
}

#[test]
fn missing_depth_is_counted() {
    let quarter = |x, y, z| {
        if x < SIDE / 2 && y < SIDE / 2 {
            f32::NAN
        } else {
            z
        }
    };
    let finding = found(&wall((SIDE, SIDE), as_it_is, quarter), "depth-holes");
    assert_eq!(finding.affected_fraction, Some(0.25));
    assert!(
        finding
            .words
            .unwrap()
            .starts_with("25 % of the lit picture")
    );
}

#[test]
fn clipped_pixels_are_counted_even_under_the_stated_white() {
    let tenth = |x: usize, y: usize, light| if x < 13 && y < 126 { 0.5 } else { light };
    for clipped in [0.5, f32::NAN] {
        let photographed = |x, y, light| {
            if tenth(x, y, 0.0) == 0.5 {
                clipped
            } else {
                light
            }
        };
        let finding = found(
            &wall((SIDE, SIDE), photographed, as_it_is),
            "flash-saturation",
        );
        let share = finding.affected_fraction.unwrap();
        assert!((share - 0.1).abs() < 0.001, "{share}");
    }
}

#[test]
fn the_shift_between_depth_and_photograph_is_found() {
    let truth = wall((SIDE, SIDE), as_it_is, as_it_is).depth.metres;
    let moved = |x: usize, y: usize, _| truth[(x.saturating_sub(3), y)];
    let words = found(&wall((SIDE, SIDE), as_it_is, moved), "misalignment").words;
    assert!(words.unwrap().starts_with("depth lies 3 pixels beside"));
}

#[test]
fn a_step_that_the_photograph_lacks_is_distrusted() {
    // The bottom right corner, away from the box.
    let deep = |x, y, z: f32| if x > 100 && y > 90 { 1.8 * z } else { z };
    let patch = |x, y, light| if x > 95 && y > 85 { 0.1 } else { light };
    let shot = wall((SIDE, SIDE), patch, deep);
    assert!(found(&shot, "mirror").is_harmful());
    let confidence = judged(&shot).confidence;
    let clean = judged(&wall((SIDE, SIDE), patch, as_it_is)).confidence;
    assert!(confidence[(100, 110)] <= 0.3 && clean[(100, 110)] > 0.5);
}

#[test]
fn steps_of_loud_noise_are_no_mirror() {
    let chance = Chance::new(3);
    let loud = |x, y, z: f32| z * (1.0 + 0.08 * chance.normal((y * SIDE + x) as u64));
    let verdict = judged(&wall((SIDE, SIDE), as_it_is, loud));
    let score = verdict.score("mirror");
    assert!(score < 0.5, "{score}");
}

#[test]
fn lamps_that_pulse_are_told_from_lamps_that_do_not() {
    let lit = |swing: f32| {
        let pulse = move |y: usize| {
            1.0 + swing * (std::f32::consts::TAU * 5.0 * y as f32 / SIDE as f32).sin()
        };
        let room = 0.1;
        let photographed = move |_, y, light| light + room * pulse(y);
        let shot = in_room(wall((SIDE, SIDE), photographed, as_it_is), room);
        found(&shot, "mains-flicker").score
    };
    assert!(
        lit(0.0) < 0.5 && lit(0.4) > 1.0,
        "{} {}",
        lit(0.0),
        lit(0.4)
    );
}

#[test]
fn a_room_without_light_is_dark_and_one_that_outshines_the_flash_is_bright() {
    let times = |room: f32| {
        let photographed = |_, _, light| light + room;
        let shot = in_room(wall((SIDE, SIDE), photographed, as_it_is), room);
        found(&shot, "bright-ambient").score
    };
    let [dark, dim, bright] = [0.0, 0.05, 0.7].map(times);
    assert!(
        dark == 0.0 && dim > 0.0 && dim < 1.0 && bright > 1.0,
        "{dark} {dim} {bright}"
    );
}

#[test]
fn hostile_shots_have_finite_findings_and_a_verdict_is_a_pure_function() {
    let lone = |x, y, z| if (x, y) == (0, 0) { z } else { f32::NAN };
    let specks = |x: usize, y: usize, z| if (x * 7 + y * 3) % 5 < 2 { z } else { f32::NAN };
    let wild = |x: usize, y: usize, z: f32| match (x + y) % 4 {
        0 => f32::INFINITY,
        1 => -z,
        2 => 1e-30,
        _ => z,
    };
    let dark = |x, _, light: f32| if x == 0 { light } else { -light };
    let shots = [
        wall((1, 1), as_it_is, as_it_is),
        wall((2, 1), as_it_is, as_it_is),
        wall((1, 40), as_it_is, as_it_is),
        wall((9, 9), as_it_is, lone),
        wall((SIDE, SIDE), as_it_is, specks),
        wall((SIDE, SIDE), as_it_is, wild),
        wall((SIDE, SIDE), dark, as_it_is),
    ];
    for (number, shot) in shots.iter().enumerate() {
        let Ok(development) = develop(shot, &Options::default(), &mut |_| {}) else {
            continue;
        };
        let first = judge(shot, &development);
        for finding in &first.findings {
            let score = finding.score;
            assert!(
                score.is_finite() && score >= 0.0,
                "shot {number}: {finding:?}"
            );
            assert_eq!(finding.words.is_some(), finding.is_harmful());
        }
        let within = |c: &f32| c.is_nan() || (0.0..=1.0).contains(c);
        assert!(first.confidence.samples().iter().all(within));
        assert_eq!(first.findings, judge(shot, &development).findings);
    }
}
