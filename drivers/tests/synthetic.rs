//! The synthetic rig: its pictures, its truth and its calibration agree.

use drivers::{
    Device, Frame, Illumination, Pixels, Plane, Settings,
    synthetic::{FLASH_INTENSITY, Layout, Options, Synthetic, World},
};
use glam::{DVec2, Vec3};
use std::time::Duration;

fn options(layout: Layout) -> Options {
    Options {
        layout,
        width: 96,
        height: 72,
        depth_width: 48,
        ..Options::default()
    }
}

fn frames(options: Options, settings: &Settings, count: usize) -> Vec<Frame> {
    let mut device = Synthetic::new(options);
    let mut stream = device.start(settings).unwrap();
    (0..count)
        .map(|_| stream.next_frame(Duration::ZERO).unwrap())
        .collect()
}

fn floats(frame: &Frame) -> Option<(&Plane<[f32; 3]>, Illumination)> {
    match frame {
        Frame::Color(color) => match &color.pixels {
            Pixels::RgbF32(plane) => Some((plane, color.light)),
            _ => None,
        },
        Frame::Depth(_) => None,
    }
}

fn quiet(layout: Layout) -> Options {
    Options {
        noise: 0.0,
        pixels: drivers::synthetic::PixelKind::RgbF32,
        ..options(layout)
    }
}

#[test]
fn every_layout_fills_the_picture_and_lies_within_reach() {
    for layout in Layout::ALL {
        let truth = World::new(&options(layout)).truth();
        for (x, y) in (0..72).flat_map(|y| (0..96).map(move |x| (x, y))) {
            let z = truth.depth_metres[(x, y)];
            assert!((0.3..3.0).contains(&z), "{layout:?} ({x}, {y}): {z} m");
            assert!((truth.normal[(x, y)].length() - 1.0).abs() < 1e-5);
            assert!(truth.albedo[(x, y)].iter().all(|a| (0.0..=1.0).contains(a)));
        }
    }
}

#[test]
fn relit_light_is_the_diffuse_part_and_a_highlight_and_nothing_in_shadow() {
    for layout in Layout::ALL {
        let world = World::new(&options(layout));
        let truth = world.truth();
        let direction = Vec3::new(0.5, 0.6, 0.8).normalize();
        // To camera axes: x right, y down, z forward.
        let toward = Vec3::new(direction.x, -direction.y, -direction.z);
        let relit = world.relit(direction);
        let (mut lit, mut dark) = (0, 0);
        for place in 0..truth.albedo.len() {
            let cosine = truth.normal.samples()[place].dot(toward);
            for c in 0..3 {
                let light = relit.light.samples()[place][c];
                let diffuse = truth.albedo.samples()[place][c] * cosine.max(0.0);
                if relit.shadow.samples()[place] == 1.0 {
                    lit += 1;
                    assert!(
                        light >= diffuse - 1e-5,
                        "{layout:?}: {light} under {diffuse}"
                    );
                    // With F0 = 0.05 a rough surface adds little.
                    if truth.roughness.samples()[place] > 0.8 && cosine > 0.3 {
                        assert!(light < diffuse + 0.1, "{layout:?}: {light} over {diffuse}");
                    }
                } else {
                    dark += 1;
                    assert_eq!(light, 0.0);
                }
            }
        }
        assert!(
            lit > 1000 && dark > 100,
            "{layout:?}: {lit} lit, {dark} dark"
        );
    }
}

#[test]
fn light_from_the_camera_casts_no_shadow() {
    for layout in Layout::ALL {
        let relit = World::new(&options(layout)).relit(Vec3::Z);
        let dark = relit.shadow.samples().iter().filter(|v| **v == 0.0).count();
        // A directional light is not quite the view from one point: a rim a few pixels wide is dark.
        assert!(dark * 8 < relit.shadow.len(), "{layout:?}: {dark}");
    }
}

#[test]
fn flash_minus_ambient_is_the_light_of_the_flash_alone() {
    for layout in Layout::ALL {
        let settings = Settings::default();
        let taken = frames(quiet(layout), &settings, 4);
        let pictures: Vec<_> = taken.iter().filter_map(floats).collect();
        let [
            (ambient, Illumination::Ambient),
            (flash, Illumination::Flash),
        ] = pictures[..]
        else {
            panic!("expected an ambient frame and a flash frame");
        };
        let expected = World::new(&quiet(layout)).flash_light();
        let factor = 0.01;
        let mut checked = 0;
        for place in 0..expected.len() {
            for c in 0..3 {
                let (lit, unlit) = (flash.samples()[place][c], ambient.samples()[place][c]);
                if lit < 1.0 {
                    checked += 1;
                    let wanted = expected.samples()[place][c] * factor;
                    assert!((lit - unlit - wanted).abs() < 1e-5, "{layout:?}");
                }
            }
        }
        // Highlights may clip; most of the picture must not.
        assert!(
            checked * 10 > expected.len() * 3 * 9,
            "{layout:?}: {checked}"
        );
    }
}

#[test]
fn flash_light_follows_the_inverse_square_and_the_cosine() {
    let world = World::new(&options(Layout::Wall));
    let (truth, light, rig) = (world.truth(), world.flash_light(), world.rig());
    let mut checked = 0;
    for (x, y) in (0..72).flat_map(|y| (0..96).map(move |x| (x, y))) {
        let ray = rig.color.ray(DVec2::new(x as f64, y as f64)).unwrap();
        let point = ray * f64::from(truth.depth_metres[(x, y)]);
        let toward = rig.flash.position_metres - point;
        let cosine = truth.normal[(x, y)].as_dvec3().dot(toward.normalize());
        let strength = f64::from(FLASH_INTENSITY) / toward.length_squared() * cosine;
        let albedo = f64::from(light[(x, y)][1]) / strength;
        let known = f64::from(truth.albedo[(x, y)][1]);
        if light[(x, y)][1] > 0.0 && cosine > 0.3 {
            checked += 1;
            // What is above is the highlight of a rough surface, at most π f of roughness 0.9.
            assert!(
                (-1e-4..0.06).contains(&(albedo - known)),
                "({x}, {y}): {albedo} against {known}"
            );
        }
    }
    assert!(checked > 6000, "{checked}");
}

#[test]
fn depth_lands_on_the_truth_when_carried_over_by_the_calibration() {
    for layout in Layout::ALL {
        let world = World::new(&options(layout));
        let (truth, rig) = (world.truth(), world.rig());
        let camera = rig.depth.unwrap();
        let taken = frames(
            Options {
                noise: 0.0,
                ..options(layout)
            },
            &Settings::default(),
            2,
        );
        let Some(Frame::Depth(depth)) = taken.iter().find(|frame| matches!(frame, Frame::Depth(_)))
        else {
            panic!("no depth frame");
        };
        let (mut near, mut all) = (0, 0);
        for (x, y) in (0..36).flat_map(|y| (0..48).map(move |x| (x, y))) {
            let z = depth.metres[(x, y)];
            let Some(ray) = camera.lens.ray(DVec2::new(x as f64, y as f64)) else {
                continue;
            };
            if z.is_nan() {
                continue;
            }
            let point = camera.to_color.apply(ray * f64::from(z));
            let Some(pixel) = rig.color.project(point) else {
                continue;
            };
            let known = truth
                .depth_metres
                .get(pixel.x.round() as usize, pixel.y.round() as usize);
            if let (Some(known), true) = (known, pixel.min_element() >= -0.4) {
                all += 1;
                // Half a pixel of a slanted surface is up to 1 cm; edges may land on either side.
                near += usize::from((f64::from(*known) - point.z).abs() < 0.01);
            }
        }
        assert!(
            all > 800 && near * 10 > all * 9,
            "{layout:?}: {near} of {all}"
        );
    }
}

#[test]
fn depth_noise_has_the_sigma_it_states() {
    let perfect = frames(
        Options {
            noise: 0.0,
            ..options(Layout::Desk)
        },
        &Settings::default(),
        2,
    );
    let noisy = frames(options(Layout::Desk), &Settings::default(), 2);
    let (Frame::Depth(clean), Frame::Depth(noisy)) = (&perfect[1], &noisy[1]) else {
        panic!("no depth")
    };
    let sigma = noisy.sigma.as_ref().unwrap();
    let scores: Vec<f64> = (0..clean.metres.len())
        .map(|i| {
            f64::from((noisy.metres.samples()[i] - clean.metres.samples()[i]) / sigma.samples()[i])
        })
        .filter(|score| !score.is_nan())
        .collect();
    let variance = scores.iter().map(|s| s * s).sum::<f64>() / scores.len() as f64;
    // Four standard errors of a variance.
    let error = 4.0 * (2.0 / scores.len() as f64).sqrt();
    assert!((variance - 1.0).abs() < error, "{variance} ± {error}");
}

#[test]
fn an_exposure_of_one_mains_period_hides_the_flicker_and_a_short_one_shows_it() {
    let spread = |seconds: f32| {
        let settings = Settings {
            exposure_seconds: Some(seconds),
            ..Settings::default()
        };
        let taken = frames(quiet(Layout::Wall), &settings, 24);
        let means: Vec<f32> = taken
            .iter()
            .filter_map(floats)
            .filter(|(_, light)| *light == Illumination::Ambient)
            .map(|(plane, _)| plane.samples().iter().map(|rgb| rgb[1]).sum::<f32>())
            .collect();
        let (low, high) = means
            .iter()
            .fold((f32::MAX, 0.0f32), |(l, h), v| (l.min(*v), h.max(*v)));
        high / low - 1.0
    };
    assert!(spread(0.01) < 1e-3, "{}", spread(0.01));
    assert!(spread(0.003) > 0.1, "{}", spread(0.003));
}

#[test]
fn all_pixel_kinds_show_the_same_picture() {
    let luma_of = |kind| -> Vec<f32> {
        let taken = frames(
            Options {
                noise: 0.0,
                pixels: kind,
                ..options(Layout::Desk)
            },
            &Settings::default(),
            1,
        );
        let Frame::Color(frame) = &taken[0] else {
            panic!("no color")
        };
        let srgb = |v: f32| {
            let v = v.clamp(0.0, 1.0);
            if v <= 0.003_130_8 {
                12.92 * v
            } else {
                1.055 * v.powf(1.0 / 2.4) - 0.055
            }
        };
        let luma = |[r, g, b]: [f32; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
        match &frame.pixels {
            Pixels::RgbF32(plane) => plane
                .samples()
                .iter()
                .map(|rgb| luma(rgb.map(srgb)))
                .collect(),
            Pixels::Rgb16(plane) => plane
                .samples()
                .iter()
                .map(|rgb| luma(rgb.map(|v| srgb(f32::from(v) / 65535.0))))
                .collect(),
            Pixels::Rgb8(plane) => plane
                .samples()
                .iter()
                .map(|rgb| luma(rgb.map(|v| f32::from(v) / 255.0)))
                .collect(),
            Pixels::Yuyv { bytes, .. } => bytes
                .iter()
                .step_by(2)
                .map(|y| (f32::from(*y) - 16.0) / 219.0)
                .collect(),
            Pixels::Nv12 {
                bytes,
                width,
                height,
            } => bytes[..width * height]
                .iter()
                .map(|y| (f32::from(*y) - 16.0) / 219.0)
                .collect(),
            Pixels::Mjpg { bytes, .. } => {
                let picture = image::load_from_memory(bytes).unwrap().to_rgb8();
                picture
                    .pixels()
                    .map(|p| luma(p.0.map(|v| f32::from(v) / 255.0)))
                    .collect()
            }
            Pixels::Bayer { samples, .. } => {
                // Green sites only, against green elsewhere: see below.
                samples
                    .samples()
                    .iter()
                    .map(|v| f32::from(*v) / 65535.0)
                    .collect()
            }
        }
    };
    use drivers::synthetic::PixelKind::{Bayer, Mjpg, Nv12, Rgb8, Rgb16, RgbF32, Yuyv};
    let reference = luma_of(RgbF32);
    // Mean error; one 8-bit code is 0.004, JPEG of quality 92 costs a few.
    for (kind, allowed) in [
        (Rgb16, 1e-4),
        (Rgb8, 0.002),
        (Yuyv, 0.002),
        (Nv12, 0.002),
        (Mjpg, 0.015),
    ] {
        let found = luma_of(kind);
        assert_eq!(found.len(), reference.len());
        let error: f32 = found
            .iter()
            .zip(&reference)
            .map(|(a, b)| (a - b).abs())
            .sum::<f32>()
            / reference.len() as f32;
        assert!(error < allowed, "{kind:?}: {error}");
    }
    let mosaic = luma_of(Bayer);
    let taken = frames(quiet(Layout::Desk), &Settings::default(), 1);
    let (picture, _) = floats(&taken[0]).unwrap();
    for (x, y, channel) in [(10, 20, 0), (11, 20, 1), (10, 21, 1), (11, 21, 2)] {
        let light = (mosaic[y * 96 + x] - 256.0 / 4095.0) / (1.0 - 256.0 / 4095.0);
        // Half a code of 12 bits.
        assert!(
            (light - picture[(x, y)][channel]).abs() < 0.6 / 3839.0,
            "{channel}"
        );
    }
}

#[test]
fn seeds_give_worlds_of_their_own() {
    let light = |seed| {
        World::new(&Options {
            seed,
            ..options(Layout::Statue)
        })
        .flash_light()
    };
    assert_eq!(light(1), light(1));
    assert_ne!(light(1), light(2));
}
