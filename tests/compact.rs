//! What the compact networks are fed, and what becomes of what they say: with networks that say what a test wants.

use captured::{
    radiometry::LinearImage,
    registration::RegisteredDepth,
    relight::{
        Emitter, Lamp, Preparation, Prepared, RelightOptions, Relit, Shadows,
        networks::{
            Channels, Network, NetworkError, NetworkRecord,
            compact::{Correction, Sight, UNSHADOWED, corrected},
        },
    },
    scene::{Material, Scene},
};
use drivers::{Distortion, Intrinsics, Plane};
use glam::Vec3;

/// Width and height: no finer grid is asked for, and both are multiples of 16.
const SIZE: (usize, usize) = (96, 64);
/// Value of white at a metre.
const INTENSITY: f32 = 0.8;

/// A post before a wall, and a strip at the left of which nothing is known.
fn scene() -> Scene {
    let (width, height) = SIZE;
    let camera = Intrinsics {
        width,
        height,
        fx: 90.0,
        fy: 90.0,
        cx: 47.5,
        cy: 31.5,
        distortion: Distortion::None {},
    };
    let unknown = |x: usize| x < 5;
    Scene {
        camera,
        depth_metres: Plane::from_fn(width, height, |x, y| match x {
            _ if unknown(x) => f32::NAN,
            40..50 if (10..50).contains(&y) => 1.0,
            _ => 1.5,
        }),
        depth_sigma_metres: Plane::filled(width, height, 0.002),
        thickness_metres: Plane::filled(width, height, 0.1),
        normal: Plane::filled(width, height, Vec3::NEG_Z),
        albedo: Plane::from_fn(width, height, |x, _| {
            if unknown(x) {
                [f32::NAN; 3]
            } else {
                [0.25, 0.36, 0.49]
            }
        }),
        roughness: Plane::filled(width, height, 0.6),
        confidence: Plane::filled(width, height, 0.9),
        scale_known: true,
        flash_lit: true,
        material: Material::Varying,
        shine: None,
    }
}

/// Says the same of every pixel: each output by name, one number a channel.
struct Says(Vec<(&'static str, Vec<f32>)>);

impl Network for Says {
    fn answer(
        &self,
        given: &[(&str, &Channels)],
        wanted: &[&str],
    ) -> Result<Vec<Channels>, NetworkError> {
        let size = given[0].1.size;
        let answer = |name: &&str| {
            let (_, values) = self.0.iter().find(|(own, _)| own == name).unwrap();
            let plane = |value: &f32| vec![*value; size.0 * size.1];
            Channels {
                size,
                count: values.len(),
                samples: values.iter().flat_map(plane).collect(),
            }
        };
        Ok(wanted.iter().map(answer).collect())
    }

    fn record(&self) -> NetworkRecord {
        unreachable!("asked by no correction that succeeds")
    }
}

fn surfaces(normal: [f32; 3], factor: f32, roughness: f32) -> Says {
    Says(vec![
        ("normal", normal.to_vec()),
        ("factor", vec![factor; 3]),
        ("roughness", vec![roughness]),
    ])
}

fn light(weight: f32, shadow: f32, bounced: [f32; 3]) -> Says {
    Says(vec![
        ("weight", vec![weight]),
        ("shadow", vec![shadow]),
        ("bounced", bounced.to_vec()),
    ])
}

fn sight_of(scene: &Scene, amplitude: Option<Plane<f32>>) -> Channels {
    let registered = RegisteredDepth {
        metres: scene.depth_metres.map(|z| z * 1.01),
        sigma_metres: scene.depth_sigma_metres.clone(),
        measured: Plane::filled(SIZE.0, SIZE.1, true),
        amplitude,
    };
    let sight = Sight {
        scene,
        light: &LinearImage(scene.depth_metres.map(|z| [0.5 * INTENSITY / (z * z); 3])),
        registered: &registered,
        intensity: INTENSITY,
    };
    sight.given()
}

#[test]
fn a_network_of_surfaces_is_fed_the_closed_form_in_units_of_its_own_and_nothing_where_nothing_is_known()
 {
    let scene = scene();
    let given = sight_of(&scene, None);
    assert_eq!((given.size, given.count), (SIZE, 16));
    let at = |x: usize, y: usize| -> Vec<f32> {
        (0..16).map(|c| given.channel(c)[y * SIZE.0 + x]).collect()
    };
    assert_eq!(at(2, 20), [0.0; 16]);
    let seen = at(47, 31);
    // The normal faces the camera, the albedo is a square, the light is half that of white at the distance.
    for (found, expected) in
        seen.iter()
            .zip([0.0, 0.0, 1.0, 0.5, 0.6, 0.7, 0.5f32.sqrt(), 1.0, 0.6])
    {
        assert!((found - expected).abs() < 2e-3, "{seen:?}");
    }
    assert!((seen[9] - 2.0 * (1.0f32 / 1.5).ln()).abs() < 1e-5);
    assert!((seen[10] - 0.3).abs() < 1e-3);
    assert_eq!(seen[12..], [0.9, 0.0, 0.0, 1.0]);
    // The amplitude of one white material: its median becomes a half, wherever it stands.
    let amplitude = scene.depth_metres.map(|z| 7.0 / (z * z));
    let given = sight_of(&scene, Some(amplitude));
    let middle = given.channel(13)[31 * SIZE.0 + 47];
    // A little less: the median stands aside of the middle, and so a little farther away.
    assert!((middle - 0.45).abs() < 0.02, "{middle}");
    assert_eq!(given.channel(14)[31 * SIZE.0 + 47], 1.0);
}

#[test]
fn surfaces_change_by_what_the_network_says_and_only_where_they_are_known() {
    let scene = scene();
    let given = sight_of(&scene, None);
    let turned = |scene: &Scene, normal, factor, roughness| {
        corrected(scene, &given, &surfaces(normal, factor, roughness)).unwrap()
    };
    let told = |factor, roughness| turned(&scene, [0.0; 3], factor, roughness);
    let same = told(0.0, 0.6);
    for (found, before) in same.albedo.samples().iter().zip(scene.albedo.samples()) {
        assert_eq!(found.map(f32::to_bits), before.map(f32::to_bits));
    }
    let at = (60, 20);
    let other = told(2.0f32.ln(), 0.3);
    assert!((other.albedo[at][1] - 0.72).abs() < 1e-5);
    assert!((other.roughness[at] - 0.3).abs() < 1e-6);
    assert!(other.albedo[(2, 20)].iter().all(|value| value.is_nan()));
    assert_eq!(other.normal[at], scene.normal[at]);
    assert_eq!(other.depth_metres[at], scene.depth_metres[at]);
    // Twice 0.49 stays below one; eight times would not.
    assert_eq!(told(8.0f32.ln(), 0.6).albedo[at], [1.0; 3]);
}

#[test]
fn a_turned_surface_sends_as_much_of_the_flash_back_as_it_did() {
    let scene = scene();
    let given = sight_of(&scene, None);
    let turned = |scene: &Scene| {
        // Up, and the camera's axes have y down.
        corrected(scene, &given, &surfaces([0.0, 0.5, 0.0], 0.0, 0.6)).unwrap()
    };
    let flash_lit = turned(&scene);
    let at = (60, 20);
    let pixel = glam::DVec2::new(60.0, 20.0);
    let toward = -scene.camera.ray(pixel).unwrap().as_vec3().normalize();
    assert!(flash_lit.normal[at].y < -0.4 && flash_lit.normal[at].is_normalized());
    for c in 0..3 {
        let sent = |scene: &Scene| scene.albedo[at][c] * scene.normal[at].dot(toward);
        assert!((sent(&flash_lit) - sent(&scene)).abs() < 1e-4);
    }
    // Light that does not fall off as a flash's was not divided by a cosine.
    let evenly = Scene {
        flash_lit: false,
        ..scene.clone()
    };
    assert_eq!(turned(&evenly).albedo[at], scene.albedo[at]);
}

#[test]
fn light_changes_by_what_the_network_says() {
    let scene = scene();
    let prepared = Prepared::new(&scene, Preparation::default());
    let correction = Correction::of(&scene, &prepared);
    let color = [1.0, 0.5, 2.0];
    let lamp = Lamp::from_person([0.8, 0.2, 0.5])
        .unwrap()
        .with_color(color)
        .unwrap();
    let corrected = RelightOptions {
        shadows: Shadows::Guessed,
        ..RelightOptions::default()
    };
    let closed = prepared.relight(&lamp, corrected);
    assert!(
        closed.shadow.samples().iter().any(|seen| *seen < 0.1),
        "no shadow to correct"
    );
    let lit = |lamp: &Lamp, says: &Says| {
        let lamps = [lamp.into()];
        let mut relit = correction.relit(&prepared, &lamps, says);
        relit.next().unwrap().unwrap()
    };
    let told = |says: &Says| lit(&lamp, says);
    let apart = |a: &LinearImage, b: &LinearImage| -> f32 {
        let pixels = a.0.samples().iter().zip(b.0.samples());
        let known = pixels.filter(|(a, _)| a[0].is_finite());
        known
            .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max))
            .fold(0.0, f32::max)
    };

    assert!(apart(&told(&light(0.0, 1.0, [0.0; 3])).light, &closed.light) < 1e-5);

    // All is lit: what was in shadow gets the direct light too.
    let clear = told(&light(1.0, 1.0, [0.0; 3]));
    let direct = prepared.relight(&lamp, UNSHADOWED);
    for (index, seen) in clear.shadow.samples().iter().enumerate() {
        let expected: [f32; 3] = std::array::from_fn(|c| {
            let missing =
                (1.0 - closed.shadow.samples()[index]) * direct.light.0.samples()[index][c];
            closed.light.0.samples()[index][c] + missing
        });
        if scene.albedo.samples()[index][0].is_finite() {
            assert_eq!(*seen, 1.0);
            assert!((clear.light.0.samples()[index][2] - expected[2]).abs() < 1e-5);
        } else {
            assert!(seen.is_nan() && clear.light.0.samples()[index][0].is_nan());
        }
    }

    // What is turned away from a lamp stays dark, whatever is said.
    let behind = Lamp::from_person([0.6, 0.0, -0.4]).unwrap();
    let says = light(1.0, 1.0, [0.0; 3]);
    let away = lit(&behind, &says);
    let known = away.shadow.samples().iter().filter(|seen| !seen.is_nan());
    assert!(known.clone().count() > 0 && known.clone().all(|seen| *seen == 0.0));

    // Bounced light is reflected by the albedo, in the lamp's color.
    let bounced = told(&light(0.0, 0.0, [0.1, 0.2, 0.3]));
    let at = (70, 30);
    for (c, said) in [0.1, 0.2, 0.3].into_iter().enumerate() {
        let more = bounced.light.0[at][c] - closed.light.0[at][c];
        let expected = said * scene.albedo[at][c] * color[c];
        assert!((more - expected).abs() < 1e-5, "{more} {expected}");
    }
}

#[test]
fn lamps_in_a_row_are_lit_as_each_alone() {
    let scene = scene();
    let prepared = Prepared::new(&scene, Preparation::default());
    let correction = Correction::of(&scene, &prepared);
    let says = light(0.5, 0.3, [0.1, 0.0, 0.2]);
    let lamps: Vec<Emitter> = [[0.8, 0.2, 0.5], [-0.3, 0.9, 0.2], [0.0, 0.1, 1.0]]
        .into_iter()
        .map(|toward| Emitter::from(&Lamp::from_person(toward).unwrap()))
        .collect();
    let all = correction.relit(&prepared, &lamps, &says);
    let all: Vec<Relit> = all.collect::<Result<_, _>>().unwrap();
    assert_eq!(all.len(), lamps.len());
    let bits = |relit: &Relit| -> Vec<u32> {
        let light = relit.light.0.samples().as_flattened().iter();
        light.map(|value| value.to_bits()).collect()
    };
    for (lamp, one) in lamps.iter().zip(&all) {
        let lamp = [*lamp];
        let mut alone = correction.relit(&prepared, &lamp, &says);
        assert_eq!(bits(&alone.next().unwrap().unwrap()), bits(one));
    }
    assert_ne!(bits(&all[0]), bits(&all[1]));
}
