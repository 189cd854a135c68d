//! Claims about the subtraction as a whole: light made here, taken apart again.

use super::align::Anchor;
use super::*;
use drivers::{ColorFrame, Exposure, Illumination, Pixels, Plane, Timestamp, Transfer};
use proptest::prelude::*;

/// A number in [0, 1) that depends on its place alone (the hash of Jarzynski & Olano, JCGT 2020).
fn chance(x: usize, y: usize, seed: u32) -> f32 {
    let mut state = (x as u32).wrapping_mul(73_856_093)
        ^ (y as u32).wrapping_mul(19_349_663)
        ^ seed.wrapping_mul(83_492_791);
    state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    ((word >> 22) ^ word) as f32 / 4_294_967_296.0
}

/// About normal, standard deviation 1: the sum of twelve.
fn normal(x: usize, y: usize, seed: u32) -> f32 {
    (0..12)
        .map(|i| chance(x, y, seed.wrapping_mul(12).wrapping_add(i)))
        .sum::<f32>()
        - 6.0
}

/// A smooth texture without period, detail from 5 to 50 pixels, in about [0.2, 1]: random numbers
/// on lattices, joined by cubics.
fn albedo(x: f64, y: f64) -> f32 {
    let lattice = |spacing: f64, seed: u32| {
        let (u, v) = (x / spacing + 100.0, y / spacing + 100.0);
        let (iu, iv) = (u.floor(), v.floor());
        let ease = |t: f64| t * t * (3.0 - 2.0 * t);
        let (fu, fv) = (ease(u - iu), ease(v - iv));
        let at = |dx: usize, dy: usize| f64::from(chance(iu as usize + dx, iv as usize + dy, seed));
        (at(0, 0) * (1.0 - fu) + at(1, 0) * fu) * (1.0 - fv)
            + (at(0, 1) * (1.0 - fu) + at(1, 1) * fu) * fv
    };
    let sum = lattice(5.3, 1) + lattice(11.7, 2) + lattice(23.1, 3) + lattice(51.9, 4);
    (0.2 + 0.2 * sum) as f32
}

fn frame(pixels: Pixels, light: Illumination) -> ColorFrame {
    ColorFrame {
        at: Timestamp::from_nanos(0),
        sequence: 0,
        light,
        exposure: Exposure::UNIT,
        pixels,
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    }
}

fn float_frame(
    width: usize,
    height: usize,
    light: Illumination,
    value: impl Fn(usize, usize) -> f32 + Sync,
) -> ColorFrame {
    let plane = Plane::from_fn(width, height, |x, y| [value(x, y); 3]);
    frame(Pixels::RgbF32(plane), light)
}

proptest! {
    #[test]
    fn subtracting_undoes_adding(
        seed in any::<u32>(),
        flash_seconds in 0.1f32..1.0,
        room_seconds in 0.1f32..1.0,
    ) {
        let flash_light = |x, y| 0.45 * chance(x, y, seed);
        let room_light = |x, y| 0.45 * chance(x, y, seed ^ 1);
        let mut flash = float_frame(16, 12, Illumination::Flash, |x, y| {
            flash_seconds * (flash_light(x, y) + room_light(x, y))
        });
        let mut room =
            float_frame(16, 12, Illumination::Ambient, |x, y| room_seconds * room_light(x, y));
        flash.exposure.seconds = flash_seconds;
        room.exposure.seconds = room_seconds;
        let found = subtract(&flash, &[room], &SubtractOptions::default()).unwrap();
        for y in 0..12 {
            for x in 0..16 {
                let channel = found.light.0[(x, y)][1];
                prop_assert!((channel - flash_light(x, y)).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn the_fused_way_agrees_with_the_long_way(seed in any::<u32>(), srgb in any::<bool>()) {
        let bytes = |shift: u32| Plane::from_fn(40, 30, |x, y| {
            std::array::from_fn(|c| (chance(x * 3 + c, y, seed ^ shift) * 256.0) as u8)
        });
        let wide = |plane: &Plane<[u8; 3]>| plane.map(|rgb| rgb.map(|code| u16::from(code) * 257));
        let noise = [NoiseModel { read_variance: 1e-5, shot_slope: 1e-4 }; 2];
        let (f, a) = (bytes(0), bytes(7));
        for sixteen in [false, true] {
            let pixels = |plane: &Plane<[u8; 3]>| {
                if sixteen { Pixels::Rgb16(wide(plane)) } else { Pixels::Rgb8(plane.clone()) }
            };
            let mut flash = frame(pixels(&f), Illumination::Flash);
            let mut room = frame(pixels(&a), Illumination::Ambient);
            flash.exposure.seconds = 0.5;
            if srgb {
                flash.transfer = Transfer::Srgb;
                room.transfer = Transfer::Srgb;
            }
            let mut light = LinearImage(Plane::filled(40, 30, [0.0; 3]));
            let mut variance = Plane::filled(40, 30, 0.0);
            let tally =
                subtract_linear_into(&flash, &room, noise, &mut light, &mut variance).unwrap();
            let (first, second) = (linearise(&flash).unwrap(), linearise(&room).unwrap());
            let mut unknown = 0;
            let pairs = first.0.samples().iter().zip(second.0.samples());
            for ((found, variance), (f, a)) in
                light.0.samples().iter().zip(variance.samples()).zip(pairs)
            {
                let known = f[0].is_finite() && a[0].is_finite();
                unknown += usize::from(!known);
                prop_assert_eq!(variance.is_finite(), known);
                for c in 0..3 {
                    prop_assert_eq!(found[c].is_finite(), known);
                    prop_assert!(!known || (found[c] - (f[c] - a[c])).abs() < 1e-5);
                }
            }
            prop_assert_eq!(tally.unknown, unknown);
        }
    }
}

#[test]
fn the_stated_variance_is_the_scatter_seen() {
    // Shot and read noise of known size on a smooth picture, 16 bits, gain-independent units.
    let (read, shot) = (4e-6f32, 2e-4f32);
    let noisy = |seed: u32, clean: &(dyn Fn(usize) -> f32 + Sync)| {
        let plane = Plane::from_fn(240, 160, |x, y| {
            std::array::from_fn(|c| {
                let light = clean(x);
                let sigma = (read + shot * light).sqrt();
                let value = light + sigma * normal(x * 3 + c, y, seed);
                (value.clamp(0.0, 1.0) * 65535.0).round() as u16
            })
        });
        frame(Pixels::Rgb16(plane), Illumination::Flash)
    };
    let room_light = |x: usize| 0.05 + 0.3 * x as f32 / 240.0;
    let both = |x: usize| room_light(x) + 0.3;
    let options = SubtractOptions {
        align: false,
        ..SubtractOptions::default()
    };
    let found = subtract(&noisy(1, &both), &[noisy(2, &room_light)], &options).unwrap();
    let known = found.light.0.samples().iter().zip(found.variance.samples());
    let normalised: Vec<f32> = known
        .flat_map(|(rgb, variance)| rgb.map(|channel| (channel - 0.3).powi(2) / variance))
        .filter(|share| share.is_finite())
        .collect();
    let mean = normalised.iter().sum::<f32>() / normalised.len() as f32;
    // The estimate rests on 24 bins' lower quartiles: some per cent each.
    assert!(
        (0.85..1.15).contains(&mean),
        "scatter is {mean} of the stated variance"
    );
    assert_eq!(found.report.moved_fraction, 0.0);
}

#[test]
fn a_sensors_data_sheet_gives_its_noise() {
    let sensor = Sensor {
        full_well_electrons: 10_000.0,
        read_electrons: 5.0,
        bits: 12,
    };
    let model = NoiseModel::of_sensor(&sensor, 4.0);
    // 2500 electrons at white: shot noise 1/2500, read noise (5/2500)², step 1/4095.
    assert!((model.shot_slope - 4e-4).abs() < 1e-9);
    assert!((model.read_variance - (4e-6 + 1.0 / (4095.0f32 * 4095.0 * 12.0))).abs() < 1e-9);
}

/// Flash and room light the texture from different sides, with different strength.
fn lit_pair(shift: impl Fn(f64, f64) -> [f64; 2] + Sync) -> (LinearImage, LinearImage) {
    let (width, height) = (320usize, 240usize);
    let picture = |seed: u32,
                   light: &(dyn Fn(f64, f64) -> f64 + Sync),
                   at: &(dyn Fn(f64, f64) -> [f64; 2] + Sync)| {
        LinearImage(Plane::from_fn(width, height, |x, y| {
            let [sx, sy] = at(x as f64, y as f64);
            let value = albedo(sx, sy) * light(sx, sy) as f32;
            std::array::from_fn(|c| value + 0.002 * normal(x * 3 + c, y, seed))
        }))
    };
    // The flash falls off from the centre; the room's light comes from the right.
    let both = |x: f64, y: f64| {
        0.15 + 0.6 * (-((x - 160.0).powi(2) + (y - 120.0).powi(2)) / 30_000.0).exp()
    };
    let room = |x: f64, _: f64| 0.05 + 0.25 * x / 320.0;
    let moved = move |x: f64, y: f64| {
        let [dx, dy] = shift(x, y);
        [x - dx, y - dy]
    };
    (picture(1, &both, &|x, y| [x, y]), picture(2, &room, &moved))
}

#[test]
fn a_shifted_pair_is_found_within_a_tenth_of_a_pixel_under_other_light() {
    for [dx, dy] in [[0.5, -0.3], [1.37, 2.61], [-4.2, 0.75], [11.3, -7.8]] {
        let (flash, room) = lit_pair(|_, _| [dx, dy]);
        let found = Anchor::of(&flash).align(&room);
        assert_eq!(found.outcome, AlignmentOutcome::Aligned, "{dx}, {dy}");
        for [x, y] in [
            [0.0, 0.0],
            [319.0, 0.0],
            [160.0, 120.0],
            [0.0, 239.0],
            [319.0, 239.0],
        ] {
            let [fx, fy] = found.warp.displacement(x, y);
            let off = (fx - dx).hypot(fy - dy);
            assert!(off < 0.1, "{off} pixels off at {x}, {y} for {dx}, {dy}");
        }
    }
}

#[test]
fn a_rolled_and_zoomed_pair_is_found_in_its_corners() {
    // Half a degree of roll and a zoom of 0.5 % about the centre, then a shift.
    let (sin, cos) = 0.5f64.to_radians().sin_cos();
    let there = |x: f64, y: f64| {
        let (u, v) = (x - 159.5, y - 119.5);
        let (u, v) = (1.005 * (cos * u - sin * v), 1.005 * (sin * u + cos * v));
        [u + 159.5 + 1.2 - x, v + 119.5 - 0.7 - y]
    };
    // `lit_pair` asks from the moved side: where the pixel seen at p came from is p − back(p).
    let back = |x: f64, y: f64| {
        let (u, v) = ((x - 159.5 - 1.2) / 1.005, (y - 119.5 + 0.7) / 1.005);
        [
            x - (cos * u + sin * v + 159.5),
            y - (-sin * u + cos * v + 119.5),
        ]
    };
    let (flash, room) = lit_pair(back);
    let found = Anchor::of(&flash).align(&room);
    for [x, y] in [
        [10.0, 10.0],
        [309.0, 10.0],
        [160.0, 120.0],
        [10.0, 229.0],
        [309.0, 229.0],
    ] {
        let ([fx, fy], [dx, dy]) = (found.warp.displacement(x, y), there(x, y));
        let off = (fx - dx).hypot(fy - dy);
        assert!(off < 0.15, "{off} pixels off at {x}, {y}");
    }
}

#[test]
fn a_pair_that_lies_right_is_not_moved() {
    let (flash, room) = lit_pair(|_, _| [0.0, 0.0]);
    let found = Anchor::of(&flash).align(&room);
    assert_eq!(found.outcome, AlignmentOutcome::AlreadyAligned);
    assert!(found.warp.is_identity());
}

#[test]
fn a_bare_wall_is_left_alone_and_said_so() {
    let wall = |seed: u32, light: f32| {
        LinearImage(Plane::from_fn(320, 240, |x, y| {
            std::array::from_fn(|c| light + 0.002 * normal(x * 3 + c, y, seed))
        }))
    };
    let found = Anchor::of(&wall(1, 0.5)).align(&wall(2, 0.2));
    assert_eq!(found.outcome, AlignmentOutcome::TooLittleTexture);
    assert!(found.warp.is_identity());
}

#[test]
fn what_moved_is_masked_and_counted() {
    // A bright thing, 20×20, stands elsewhere in the ambient frame.
    let thing =
        |x: usize, y: usize, left: usize| (left..left + 20).contains(&x) && (30..50).contains(&y);
    let scene = |left: usize, gain: f32, seed: u32| {
        float_frame(120, 90, Illumination::Flash, move |x, y| {
            let base = if thing(x, y, left) { 0.6 } else { 0.1 };
            base * gain + 0.002 * normal(x, y, seed)
        })
    };
    let (flash, room) = (scene(20, 1.3, 1), scene(70, 1.0, 2));
    let options = SubtractOptions {
        align: false,
        ..SubtractOptions::default()
    };
    let found = subtract(&flash, std::slice::from_ref(&room), &options).unwrap();
    assert!(found.light.0[(80, 40)][0].is_nan());
    assert!(found.light.0[(5, 5)][0].is_finite());
    let expected = 400.0 / (120.0 * 90.0);
    assert!((0.9 * expected..1.6 * expected).contains(&found.report.moved_fraction));
    let kept = subtract(
        &flash,
        &[room],
        &SubtractOptions {
            motion: false,
            ..options
        },
    )
    .unwrap();
    assert!(kept.light.0[(80, 40)][0] < 0.0);
    assert_eq!(kept.report.moved_fraction, 0.0);
}

#[test]
fn a_bracket_is_interpolated_to_the_flashs_moment() {
    let at = |mut frame: ColorFrame, milliseconds: u64| {
        frame.at = Timestamp::from_nanos(milliseconds * 1_000_000);
        frame
    };
    // The room brightens by 0.1 from 0 to 100 ms; the flash fires at 25 ms and adds 0.3.
    let before = at(float_frame(16, 16, Illumination::Ambient, |_, _| 0.2), 0);
    let flash = at(
        float_frame(16, 16, Illumination::Flash, |_, _| 0.225 + 0.3),
        25,
    );
    let after = at(float_frame(16, 16, Illumination::Ambient, |_, _| 0.3), 100);
    let found = subtract(&flash, &[before, after], &SubtractOptions::default()).unwrap();
    assert!(
        found
            .light
            .0
            .samples()
            .iter()
            .all(|rgb| (rgb[2] - 0.3).abs() < 1e-6)
    );
    assert!((found.report.ambient_to_flash - 0.75).abs() < 1e-4);
}

#[test]
fn flash_only_frames_pass_through_with_their_noise() {
    let flash = float_frame(64, 48, Illumination::Flash, |x, y| {
        0.5 + 0.01 * normal(x, y, 3)
    });
    let found = subtract(&flash, &[], &SubtractOptions::default()).unwrap();
    assert_eq!(found.light, linearise(&flash).unwrap());
    assert_eq!(found.report.ambient_to_flash, 0.0);
    assert_eq!(found.report.alignment, AlignmentOutcome::NotNeeded);
    // 0.5 / 0.01 in each of three equal channels, told as if they were independent.
    let expected = 20.0 * (50.0f32 * 3f32.sqrt()).log10();
    assert!(
        (found.report.snr_db - expected).abs() < 1.5,
        "{} dB",
        found.report.snr_db
    );
}

#[test]
fn no_flash_signal_is_reported_and_no_pixel_is_an_error() {
    let dark = |seed| {
        float_frame(64, 48, Illumination::Flash, move |x, y| {
            0.2 + 0.01 * normal(x, y, seed)
        })
    };
    let found = subtract(&dark(1), &[dark(2)], &SubtractOptions::default()).unwrap();
    assert!(found.report.weak_fraction > 0.9);
    assert!((0.4..0.6).contains(&found.report.negative_fraction));
    assert!(found.report.snr_db < 0.0);
    let white = frame(
        Pixels::Rgb8(Plane::filled(8, 8, [255; 3])),
        Illumination::Flash,
    );
    assert_eq!(
        subtract(&white, &[], &SubtractOptions::default()).unwrap_err(),
        RadiometryError::NoUsablePixel {
            clipped_percent: 100.0
        }
    );
    let other = frame(
        Pixels::Rgb8(Plane::filled(8, 9, [5; 3])),
        Illumination::Ambient,
    );
    assert!(matches!(
        subtract(&white, &[other], &SubtractOptions::default()),
        Err(RadiometryError::SizesDiffer { .. })
    ));
}
