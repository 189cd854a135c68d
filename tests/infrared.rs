//! The depth camera's infrared light in the place of a flash, on a scene of which everything is known.

use captured::{
    infrared::{InfraredError, lit_by_infrared},
    shot::Shot,
};
use drivers::{
    Beam, ColorFrame, DepthFrame, Distortion, Exposure, FlashLamp, Illumination, Intrinsics,
    Pixels, Plane, Rig, Timestamp, Transfer,
};
use glam::DVec3;

const SIZE: (usize, usize) = (96, 64);

/// Paint: two colors as bright as each other, in stripes.
fn albedo(y: usize) -> [f32; 3] {
    if (y / 8).is_multiple_of(2) {
        [0.6, 0.3, 0.3]
    } else {
        [0.3, 0.3, 0.6]
    }
}

/// The lower half is twice as far away.
fn metres(y: usize) -> f32 {
    if y < SIZE.1 / 2 { 1.0 } else { 2.0 }
}

/// The room lights the left with a quarter of what it lights the right with.
fn room(x: usize) -> f32 {
    if x < SIZE.0 / 2 { 0.25 } else { 1.0 }
}

fn infrared(y: usize) -> f32 {
    7.0 * 0.4 / metres(y).powi(2)
}

fn photograph(light: Illumination, value: impl Fn(usize, usize) -> [f32; 3] + Sync) -> ColorFrame {
    ColorFrame {
        at: Timestamp::from_nanos(0),
        sequence: 0,
        light,
        exposure: Exposure::UNIT,
        pixels: Pixels::RgbF32(Plane::from_fn(SIZE.0, SIZE.1, value)),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    }
}

fn shot() -> Shot {
    let color = Intrinsics {
        width: SIZE.0,
        height: SIZE.1,
        fx: 90.0,
        fy: 90.0,
        cx: 47.5,
        cy: 31.5,
        distortion: Distortion::None {},
    };
    Shot {
        // Nobody looks at it.
        flash: photograph(Illumination::Flash, |_, _| [0.0; 3]),
        ambient: vec![photograph(Illumination::Ambient, |x, y| {
            albedo(y).map(|channel| channel * room(x))
        })],
        depth: DepthFrame {
            at: Timestamp::from_nanos(0),
            sequence: 0,
            metres: Plane::from_fn(SIZE.0, SIZE.1, |_, y| metres(y)),
            amplitude: Some(Plane::from_fn(SIZE.0, SIZE.1, |_, y| infrared(y))),
            sigma: None,
        },
        rig: Rig {
            color,
            depth: None,
            flash: FlashLamp {
                position_metres: DVec3::new(0.02, 0.0, 0.0),
                intensity: Some(1.0),
                beam: Beam::default(),
            },
        },
        mask: None,
    }
}

fn picture(shot: &Shot) -> Plane<[f32; 3]> {
    match &lit_by_infrared(shot).unwrap().flash.pixels {
        Pixels::RgbF32(plane) => plane.clone(),
        other => panic!("{:?}", other.size()),
    }
}

#[test]
fn it_has_the_rooms_colors_and_hardly_its_shadows_and_falls_off_as_a_flash_at_the_depth_camera() {
    let lit = picture(&shot());
    for y in [4, 12, 52, 60] {
        for x in [10, 80] {
            let [red, _, blue] = lit[(x, y)];
            let [paint_red, _, paint_blue] = albedo(y);
            assert!(
                (red / blue - paint_red / paint_blue).abs() < 1e-3,
                "{x} {y}"
            );
        }
        // The room's own picture differs by four.
        let shadow = lit[(80, y)][1] / lit[(10, y)][1];
        assert!((1.0..1.5).contains(&shadow), "{y}: {shadow}");
    }
    for x in [10, 80] {
        let fall = lit[(x, 4)][1] / lit[(x, 52)][1];
        assert!((fall / 4.0 - 1.0).abs() < 0.02, "{x}: {fall}");
    }
    let found = lit_by_infrared(&shot()).unwrap();
    assert!(found.ambient.is_empty());
    assert_eq!(found.rig.flash.intensity, None);
    assert_eq!(found.rig.flash.position_metres, DVec3::ZERO);
}

#[test]
fn where_infrared_has_no_answer_the_photograph_goes_on_as_bright_as_around_there() {
    let whole = picture(&shot());
    let mut holed = shot();
    let hole = |x: usize, y: usize| (70..80).contains(&x) && (10..20).contains(&y);
    holed.depth.amplitude = Some(Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
        if hole(x, y) { 0.0 } else { infrared(y) }
    }));
    let found = picture(&holed);
    for (x, y) in [(71, 11), (75, 15), (79, 19), (40, 15)] {
        for c in 0..3 {
            let change = found[(x, y)][c] / whole[(x, y)][c];
            assert!((change - 1.0).abs() < 0.05, "{x} {y}: {change}");
        }
    }
}

#[test]
fn a_shot_that_lacks_a_picture_is_refused_by_what_it_lacks() {
    let mut shot = shot();
    shot.depth.amplitude = Some(Plane::filled(SIZE.0, SIZE.1, 0.0));
    assert!(matches!(lit_by_infrared(&shot), Err(InfraredError::Dark)));
    shot.depth.amplitude = None;
    assert!(matches!(
        lit_by_infrared(&shot),
        Err(InfraredError::NoAmplitude)
    ));
    shot.ambient.clear();
    let error = lit_by_infrared(&shot).unwrap_err();
    assert!(matches!(error, InfraredError::NoRoom));
    assert!(error.to_string().contains("ambient.png"));
}
