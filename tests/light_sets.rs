//! Sets of lights for environments: what they promise about the picture, on scenes made here.

use captured::{
    radiometry::transfer::srgb_encode,
    relight::{
        Environment, Found, Indirect, Lamp, LightSet, Preparation, Prepared, RelightOptions,
    },
    scene::{Material, Scene},
};
use drivers::{Distortion, Intrinsics, Plane};
use glam::Vec3;

const SIDE: usize = 160;

/// A wall that faces the camera, and before it a few steps that throw shadows.
fn planes(steps: bool, roughness: f32) -> Scene {
    let camera = Intrinsics {
        width: SIDE,
        height: SIDE,
        fx: 150.0,
        fy: 150.0,
        cx: 79.5,
        cy: 79.5,
        distortion: Distortion::None {},
    };
    let near = |x: usize, y: usize| {
        let post = (40..70).contains(&x) && (30..120).contains(&y);
        let block = (95..130).contains(&x) && (70..100).contains(&y);
        steps && (post || block)
    };
    Scene {
        camera,
        depth_metres: Plane::from_fn(SIDE, SIDE, |x, y| if near(x, y) { 1.2 } else { 1.5 }),
        depth_sigma_metres: Plane::filled(SIDE, SIDE, 0.001),
        thickness_metres: Plane::filled(SIDE, SIDE, 0.2),
        normal: Plane::filled(SIDE, SIDE, -Vec3::Z),
        albedo: Plane::from_fn(SIDE, SIDE, |x, y| {
            if (x / 8 + y / 8) % 2 == 0 {
                [0.7, 0.5, 0.3]
            } else {
                [0.3, 0.4, 0.6]
            }
        }),
        roughness: Plane::filled(SIDE, SIDE, roughness),
        confidence: Plane::filled(SIDE, SIDE, 1.0),
        scale_known: true,
        flash_lit: true,
        material: Material::Varying,
        shine: None,
    }
}

fn scene(steps: bool, roughness: f32) -> Prepared {
    Prepared::new(&planes(steps, roughness), Preparation::default())
}

/// Maps with the difficulties of real ones.
fn maps() -> [(&'static str, Plane<[f32; 3]>); 5] {
    let map = |light: fn(usize, usize) -> [f32; 3]| Plane::from_fn(128, 64, light);
    [
        ("uniform", map(|_, _| [1.0; 3])),
        (
            "sky over ground",
            map(|_, y| {
                if y < 32 {
                    [0.6, 0.8, 1.2]
                } else {
                    [0.2, 0.15, 0.1]
                }
            }),
        ),
        (
            "one pixel of sun",
            map(|x, y| {
                if (x, y) == (10, 20) {
                    [1e4; 3]
                } else {
                    [0.5; 3]
                }
            }),
        ),
        (
            "windows of many colors",
            map(|x, y| {
                if x % 16 < 5 && y % 8 < 4 {
                    [(x % 3) as f32, (y % 5) as f32, 1.0].map(|v| 4.0 * v)
                } else {
                    [0.02; 3]
                }
            }),
        ),
        (
            "opposite sides",
            map(|x, _| {
                if (32..36).contains(&(x % 64)) {
                    [3.0, 2.0, 1.0]
                } else {
                    [0.0; 3]
                }
            }),
        ),
    ]
}

fn choose(prepared: &Prepared, environment: &Environment, noise: f32) -> (LightSet, Found) {
    let map = prepared.visibility_map(&LightSet::whole(environment));
    prepared.light_set(environment, &map, &move |_, _| noise)
}

fn lit(prepared: &Prepared, set: &LightSet) -> Plane<[f32; 3]> {
    let options = RelightOptions {
        indirect: Indirect::None,
        ..Default::default()
    };
    prepared
        .environment(&prepared.visibility_map(set), set, options)
        .light
        .0
}

/// Root mean square difference of the sRGB pictures, white at the 99th percentile of the first.
fn difference(whole: &Plane<[f32; 3]>, few: &Plane<[f32; 3]>) -> f32 {
    let mut brightest: Vec<f32> = whole
        .samples()
        .iter()
        .map(|p| p[0].max(p[1]).max(p[2]))
        .collect();
    brightest.sort_by(f32::total_cmp);
    let white = brightest[brightest.len() * 99 / 100];
    let squares = whole
        .samples()
        .as_flattened()
        .iter()
        .zip(few.samples().as_flattened());
    let sum: f64 = squares
        .map(|(a, b)| f64::from(srgb_encode(a / white) - srgb_encode(b / white)).powi(2))
        .sum();
    (sum / (3 * whole.len()) as f64).sqrt() as f32
}

#[test]
fn the_whole_picture_changes_no_more_than_was_found_on_a_few_pixels_of_it() {
    for (roughness, steps) in [(0.9, true), (0.3, true)] {
        let prepared = scene(steps, roughness);
        for (name, map) in maps() {
            let environment = Environment::new(&map).unwrap();
            let whole = lit(&prepared, &LightSet::whole(&environment));
            for noise in [0.0, 0.02, 0.1] {
                let (set, found) = choose(&prepared, &environment, noise);
                assert_eq!(set.count(), found.lights);
                let change = difference(&whole, &lit(&prepared, &set));
                assert!(
                    change <= found.noise,
                    "{name}, roughness {roughness}, noise {noise}: {change}, {found:?}"
                );
                assert!(found.rms_change <= found.noise, "{found:?}");
            }
        }
    }
}

#[test]
fn a_uniform_sky_needs_few_lights_on_a_matte_wall() {
    let environment = Environment::new(&Plane::filled(128, 64, [1.0; 3])).unwrap();
    let wall = Scene {
        material: Material::Matte,
        ..planes(false, 1.0)
    };
    let wall = Prepared::new(&wall, Preparation::default());
    let (_, found) = choose(&wall, &environment, 0.0);
    assert!(found.lights <= 16 && !found.capped, "{found:?}");
    assert!(found.of > 240, "{found:?}");
}

#[test]
fn a_sun_is_never_averaged_away() {
    for (x, y) in [(10, 20), (120, 5), (100, 40)] {
        let map = Plane::from_fn(128, 64, |at_x, at_y| {
            if (at_x, at_y) == (x, y) {
                [1e4; 3]
            } else {
                [1.0; 3]
            }
        });
        let environment = Environment::new(&map).unwrap();
        let power = |lamp: &&Lamp| lamp.color[0];
        let sun = environment
            .lamps()
            .max_by(|a, b| power(a).total_cmp(&power(b)))
            .unwrap();
        // The sky's cells have 0.01 each.
        assert!(power(&sun) > 1.0, "({x}, {y}) lights nothing");
        for noise in [0.0, 0.3] {
            let (set, _) = choose(&scene(true, 0.9), &environment, noise);
            assert!(
                set.lamps().any(|lamp| lamp == sun),
                "({x}, {y}), noise {noise}"
            );
        }
        for count in [2, 4, 16] {
            let set = LightSet::of_count(&environment, count);
            assert!(
                set.lamps().any(|lamp| lamp == sun),
                "({x}, {y}), {count} lights"
            );
        }
    }
}

#[test]
fn the_picture_is_as_bright_under_the_set_as_under_all_lights() {
    let prepared = scene(true, 0.5);
    let brightness = |set: &LightSet| -> f64 {
        lit(&prepared, set)
            .samples()
            .as_flattened()
            .iter()
            .map(|v| f64::from(*v))
            .sum()
    };
    for (name, map) in maps() {
        let environment = Environment::new(&map).unwrap();
        let whole = brightness(&LightSet::whole(&environment));
        for noise in [0.0, 0.1, 0.5] {
            let few = brightness(&choose(&prepared, &environment, noise).0);
            // On the sample it is the same, except for lights that hardly reach anything.
            assert!(
                (few / whole - 1.0).abs() < 0.01,
                "{name}, {noise}: {}",
                few / whole
            );
        }
    }
}

#[test]
fn light_times_direction_is_the_same_for_any_set() {
    let sum = |lamps: &mut dyn Iterator<Item = &Lamp>| -> Vec3 {
        lamps
            .map(|lamp| lamp.toward() * lamp.color.iter().sum::<f32>())
            .sum()
    };
    for (name, map) in maps().into_iter().take(4) {
        let environment = Environment::new(&map).unwrap();
        let all = sum(&mut environment.lamps());
        for count in [2, 4, 16, 64, 256] {
            let few = sum(&mut LightSet::of_count(&environment, count).lamps());
            assert!(
                (few - all).length() < 1e-4 * all.length(),
                "{name}, {count}: {few} {all}"
            );
        }
    }
}

#[test]
fn fewer_lights_are_enough_where_there_is_more_noise() {
    let prepared = scene(true, 0.5);
    for (name, map) in maps() {
        let environment = Environment::new(&map).unwrap();
        let counts = [0.3, 0.1, 0.03, 0.01, 0.0]
            .map(|noise| choose(&prepared, &environment, noise).1.lights);
        assert!(counts.is_sorted(), "{name}: {counts:?}");
        if name != "opposite sides" {
            assert!(counts[0] < counts[4], "{name}: {counts:?}");
        }
    }
}

#[test]
fn the_exposure_of_a_map_does_not_matter() {
    let prepared = scene(true, 0.5);
    for (name, map) in maps() {
        let found = [1.0, 1024.0].map(|gain| {
            let map = map.map(|pixel| pixel.map(|light| gain * light));
            choose(&prepared, &Environment::new(&map).unwrap(), 0.02)
                .1
                .lights
        });
        assert_eq!(found[0], found[1], "{name}");
    }
}

#[test]
fn a_fixed_count_is_kept_as_far_as_there_are_lights() {
    let [_, _, _, (_, windows), _] = maps();
    let environment = Environment::new(&windows).unwrap();
    let all = environment.lamps().count();
    for count in [1, 4, 16, 64, 256] {
        assert_eq!(
            LightSet::of_count(&environment, count).count(),
            count.min(all)
        );
    }
    assert_eq!(LightSet::of_count(&environment, 0).count(), 1);
}

#[test]
fn a_picture_of_which_nothing_is_known_takes_one_light() {
    let mut unknown = planes(false, 1.0);
    unknown.albedo = unknown.albedo.map(|_| [f32::NAN; 3]);
    let environment = Environment::new(&Plane::filled(128, 64, [1.0; 3])).unwrap();
    let (set, found) = choose(
        &Prepared::new(&unknown, Preparation::default()),
        &environment,
        0.0,
    );
    assert_eq!((set.count(), found.rms_change), (1, 0.0));
}
