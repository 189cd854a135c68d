//! Near and large lamps, held against a ray-cast world and against each other.

use captured::{
    relight::{
        AreaLamp, Emitter, Lamp, Luminaire, Preparation, Prepared, RelightOptions, Relit, Shadows,
        summed,
    },
    scene::{Material, Scene},
};
use drivers::{
    Plane,
    synthetic::{Options, World},
};
use glam::Vec3;

fn world(text: &str) -> World {
    World::new(&Options::parse(text).expect("options"))
}

/// The world's own truth as a scene: what is left to err are the backs of things.
fn scene(world: &World) -> Scene {
    let truth = world.truth();
    let (width, height) = truth.depth_metres.size();
    Scene {
        camera: world.rig().color,
        depth_sigma_metres: Plane::filled(width, height, 1e-5),
        thickness_metres: Plane::filled(width, height, 0.12),
        normal: truth.normal,
        albedo: truth.albedo,
        roughness: truth.roughness,
        depth_metres: truth.depth_metres,
        confidence: Plane::filled(width, height, 1.0),
        scale_known: true,
        flash_lit: true,
        material: Material::Varying,
        shine: None,
    }
}

fn prepared(world: &World) -> Prepared {
    Prepared::new(&scene(world), Preparation::default())
}

/// Light straight from the lamp.
const DIRECT: RelightOptions = RelightOptions {
    shadows: Shadows::Doubted,
    indirect: captured::relight::Indirect::None,
};

/// Root mean square of the difference of two pictures, as a share of that of the second.
fn apart(a: &Relit, b: &Relit) -> f64 {
    let (mut sum, mut of) = (0.0, 0.0);
    for (a, b) in a.light.0.samples().iter().zip(b.light.0.samples()) {
        for (a, b) in a
            .iter()
            .zip(b)
            .filter(|(a, b)| a.is_finite() && b.is_finite())
        {
            sum += f64::from((a - b).powi(2));
            of += f64::from(b.powi(2));
        }
    }
    (sum / of).sqrt()
}

/// Around, above and in front of what stands on the desk, and beside the lens.
const PLACES: [[f32; 3]; 7] = [
    [-0.7, 0.2, -0.6],
    [0.7, 0.3, -0.3],
    [0.1, 0.8, -0.9],
    [0.5, 0.05, -1.0],
    [-0.3, 0.4, 0.0],
    [0.0, 0.5, 0.6],
    [0.02, 0.0, -0.02],
];

#[test]
fn a_near_lamp_lights_and_shades_as_rays_cast_in_the_world_do() {
    for layout in ["desk?width=240", "statue?width=240"] {
        let world = world(layout);
        let prepared = prepared(&world);
        for place in PLACES {
            let truth = world.relit_near(Vec3::from(place));
            let ours = prepared.relight(Emitter::at_person(place).unwrap(), DIRECT);
            let (mut known, mut wrong) = (0, 0);
            let mut errors = Vec::new();
            let pixels = ours.light.0.samples().iter().zip(ours.shadow.samples());
            let told = truth.light.samples().iter().zip(truth.shadow.samples());
            for ((light, shadow), (true_light, true_shadow)) in pixels.zip(told) {
                if !(shadow.is_finite() && true_shadow.is_finite()) {
                    continue;
                }
                known += 1;
                wrong += usize::from((shadow - true_shadow).abs() > 0.5);
                if *shadow > 0.99 && *true_shadow > 0.99 {
                    errors.extend((0..3).map(|c| (light[c] / true_light[c] - 1.0).abs()));
                }
            }
            assert!(known > 40_000, "{layout} {place:?}: {known}");
            // What one depth map does not know: backs, and what stands outside the picture.
            let wrong = wrong as f64 / known as f64;
            assert!(
                wrong < 0.1,
                "{layout} {place:?}: {wrong} of the shadow is wrong"
            );
            errors.sort_unstable_by(f32::total_cmp);
            let at = |share: f64| errors[(share * errors.len() as f64) as usize];
            // Single precision, and grazing light where a cosine is nearly nothing.
            assert!(at(0.5) < 1e-3, "{layout} {place:?}: median {}", at(0.5));
            assert!(at(0.95) < 1e-2, "{layout} {place:?}: 95 % {}", at(0.95));
        }
    }
}

#[test]
fn a_lamp_at_the_place_of_the_flash_casts_next_to_no_shadow() {
    let prepared = prepared(&world("desk?width=240"));
    let lit = prepared.relight(Emitter::at_person([0.0; 3]).unwrap(), DIRECT);
    let known: Vec<f32> = lit
        .shadow
        .samples()
        .iter()
        .copied()
        .filter(|s| s.is_finite())
        .collect();
    let dark = known.iter().filter(|shadow| **shadow < 0.5).count();
    assert!(dark * 200 < known.len(), "{dark} of {}", known.len());
}

#[test]
fn a_near_lamp_far_away_and_as_much_brighter_is_a_distant_one() {
    let prepared = prepared(&world("desk?width=240"));
    for direction in [[0.6, 0.5, 0.6], [-0.9, 0.1, 0.2], [0.1, 0.9, -0.05]] {
        let distant = Lamp::from_person(direction).unwrap();
        let metres = 3e3;
        let place = distant.person_direction().map(|axis| metres * axis);
        let near = Emitter::at_person(place).unwrap();
        let near = near.with_color([metres * metres; 3]).unwrap();
        let options = RelightOptions::default();
        let [distant, near] = [
            prepared.relight(&distant, options),
            prepared.relight(near, options),
        ];
        let apart = apart(&near, &distant);
        assert!(apart < 0.02, "{direction:?}: {apart}");
    }
}

/// The pictures under a large lamp and under as many small ones as stand for it.
fn chosen(prepared: &Prepared, lamp: &AreaLamp, noise: f32) -> (usize, Relit) {
    let (few, found) = prepared.area_set(lamp, &move |_, _| noise);
    assert_eq!(
        (few.len(), found.capped),
        (found.lights, false),
        "{found:?}"
    );
    (found.lights, sum(prepared, &few))
}

fn sum(prepared: &Prepared, lamps: &[Emitter]) -> Relit {
    let lit = lamps
        .iter()
        .map(|lamp| Ok::<_, ()>(prepared.relight(lamp, DIRECT)));
    summed(lit).unwrap().expect("at least one lamp")
}

#[test]
fn a_large_lamp_shrunk_to_a_point_is_that_point() {
    let prepared = prepared(&world("desk?width=240"));
    let place = [0.6, 0.4, -0.5];
    let point = prepared.relight(Emitter::at_person(place).unwrap(), DIRECT);
    let lamp = AreaLamp::ball(place, 1e-4).unwrap();
    assert_eq!(
        apart(&sum(&prepared, &lamp.emitters(1, Vec3::Z)), &point),
        0.0
    );
    // Where lines lie among pixels changes with a hair's breadth, and at edges of shadows the answer with them.
    let (lights, ball) = chosen(&prepared, &lamp, 0.05);
    let apart = apart(&ball, &point);
    assert!(lights <= 9 && apart < 0.1, "{lights} lights: {apart}");
}

#[test]
fn the_larger_a_lamp_the_softer_its_shadows_and_the_more_points_stand_for_it() {
    let prepared = prepared(&world("desk?width=240"));
    let place = [0.6, 0.5, -0.6];
    let soft = |relit: &Relit| {
        let partly = |shadow: &&f32| **shadow > 0.1 && **shadow < 0.9;
        relit.shadow.samples().iter().filter(partly).count()
    };
    let [small, large] =
        [0.02, 0.3].map(|radius| chosen(&prepared, &AreaLamp::ball(place, radius).unwrap(), 0.02));
    assert!(large.0 > small.0, "{} {}", small.0, large.0);
    assert!(large.0 >= 4 && soft(&large.1) > 2 * soft(&small.1));
    // What the chosen few leave out is less than the noise of 2 %, against many more at full size: 0.6 %.
    let lamp = AreaLamp::ball(place, 0.3).unwrap();
    let many = sum(&prepared, &lamp.emitters(16, prepared.middle()));
    let apart = apart(&large.1, &many);
    assert!(apart < 0.01, "{} lights: {apart}", large.0);
}

#[test]
fn a_panel_lights_what_it_faces_and_nothing_behind_it() {
    let prepared = prepared(&world("desk?width=240"));
    let middle = prepared.middle();
    let middle = [middle.x, -middle.y, -middle.z];
    let place = [0.0, 0.1, -0.3];
    let size = [0.02, 0.02];
    let toward = AreaLamp::panel(place, size, middle).unwrap();
    let away = AreaLamp::panel(place, size, [0.0, 0.1, 5.0]).unwrap();
    let [toward, away, point] = [
        toward.emitters(3, prepared.middle()),
        away.emitters(3, prepared.middle()),
        vec![Emitter::at_person(place).unwrap()],
    ]
    .map(|lamps| sum(&prepared, &lamps));
    // Straight ahead it is as bright as a point of its intensity, and never brighter.
    let brightest = |relit: &Relit| {
        let known = relit.light.0.samples().iter().map(|pixel| pixel[1]);
        known.filter(|value| value.is_finite()).fold(0.0, f32::max)
    };
    assert!(brightest(&away) <= 0.0, "{}", brightest(&away));
    let (panel, point) = (brightest(&toward), brightest(&point));
    assert!(
        panel > 0.5 * point && panel < 1.02 * point,
        "{panel} {point}"
    );
}

#[test]
fn a_luminaire_says_where_it_stands_as_people_do() {
    let place = [0.25, -0.5, -2.0];
    let all = [
        Luminaire::Distant(Lamp::from_person([0.0, 0.6, 0.8]).unwrap()),
        Luminaire::Near(Emitter::at_person(place).unwrap()),
        Luminaire::Area(AreaLamp::ball(place, 0.1).unwrap()),
    ];
    let said = all.map(|lamp| lamp.person_origin());
    for (said, given) in said.iter().zip([[0.0, 0.6, 0.8], place, place]) {
        assert!(
            said.iter().zip(given).all(|(a, b)| (a - b).abs() < 1e-6),
            "{said:?}"
        );
    }
}
