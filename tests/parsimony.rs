//! What is modelled of a shot: as little as a matte plane needs, as much as glossy clutter does, and the
//! same again when the noise is another.

use captured::{
    corruption::Corruption,
    develop::Options,
    parsimony::{
        CostModel, Criterion, Geometry, Glance, Model, Plan, Shadow, Terms, Workload, cost::Line,
    },
    radiometry,
    scene::Material,
    shot::Shot,
};
use drivers::{
    ColorFrame, DepthFrame, Distortion, Exposure, FlashLamp, Illumination, Intrinsics, Pixels,
    Plane, Rig, Timestamp, Transfer, chance::Chance,
};
use glam::{DVec2, DVec3, Vec3};

/// Costs in the proportions of a desktop: what is chosen does not depend on much more than their order.
fn costs() -> CostModel {
    let line = |per_megapixel_ms| Line {
        fixed_ms: 0.1,
        per_megapixel_ms,
    };
    CostModel {
        registration: line(30.0),
        flat: line(60.0),
        shape: line(60.0),
        one_roughness: line(20.0),
        varying: line(5.0),
        slabs: line(10.0),
        obscurance: line(30.0),
        lamp: line(3.0),
        sweep: line(5.0),
        correction: line(10.0),
        enlarge: line(5.0),
        reduce: line(5.0),
        surfaces_network: line(400.0),
        light_network: line(150.0),
        network_load_ms: 100.0,
        ..CostModel::default()
    }
}

fn chosen(shot: &Shot) -> (Terms, Glance) {
    let base = Options::default();
    let light = radiometry::subtract(&shot.flash, &shot.ambient, &base.subtract).unwrap();
    let glance = Glance::at(shot, &light, &base).unwrap();
    let work = Workload {
        pixels: light.light.0.len(),
        working_pixels: base.working_pixels,
        lamps: 4,
    };
    let plan = Plan::sufficient(&glance, Criterion::Visible, &costs(), work, true);
    (plan.terms, glance)
}

/// A slanted matte board that fills the picture, under a flash at the lens; depth errs by a
/// millimetre, light by half a percent.
fn board(seed: u64) -> Shot {
    let (width, height) = (256, 192);
    let lens = Intrinsics {
        width,
        height,
        fx: 240.0,
        fy: 240.0,
        cx: 127.5,
        cy: 95.5,
        distortion: Distortion::None {},
    };
    let chance = Chance::new(seed);
    let normal = Vec3::new(0.3, -0.2, -1.0).normalize();
    let at = |x: usize, y: usize| {
        let ray = lens.ray(DVec2::new(x as f64, y as f64)).unwrap().as_vec3();
        let z = normal.dot(Vec3::new(0.0, 0.0, 1.2)) / normal.dot(ray);
        (z, ray)
    };
    let flash = Plane::from_fn(width, height, |x, y| {
        let (z, ray) = at(x, y);
        let cosine = -normal.dot(ray.normalize());
        let albedo = if (x / 32 + y / 32) % 2 == 0 { 0.6 } else { 0.3 };
        let light = 0.8 * albedo * cosine / (z * z * ray.length_squared());
        let grain = 1.0 + 0.005 * chance.of(1).normal((y * width + x) as u64);
        [light * grain; 3]
    });
    let metres = Plane::from_fn(width, height, |x, y| {
        at(x, y).0 + 0.001 * chance.of(2).normal((y * width + x) as u64)
    });
    Shot {
        flash: ColorFrame {
            at: Timestamp::from_nanos(1),
            sequence: 0,
            light: Illumination::Flash,
            exposure: Exposure {
                seconds: 1.0,
                gain: 1.0,
            },
            pixels: Pixels::RgbF32(flash),
            transfer: Transfer::Linear,
            black_level: 0.0,
            white_level: 1.0,
        },
        ambient: Vec::new(),
        depth: DepthFrame {
            at: Timestamp::from_nanos(1),
            sequence: 0,
            metres,
            amplitude: None,
            sigma: None,
        },
        rig: Rig {
            color: lens,
            depth: None,
            flash: FlashLamp {
                position_metres: DVec3::ZERO,
                intensity: Some(0.8),
                beam: drivers::Beam::default(),
            },
        },
        mask: None,
    }
}

/// The shot of a bundled recording.
fn bundled(name: &str) -> Shot {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/recordings")
        .join(name);
    let mut device = drivers::open::open(&format!("replay:{}", path.display())).unwrap();
    captured::session::take(
        device.as_mut(),
        &captured::config::Config::default().capture,
        None,
    )
    .unwrap()
    .shot
}

#[test]
fn a_matte_plane_gets_no_network_no_shadow_and_no_highlight() {
    let (terms, glance) = chosen(&board(1));
    assert_eq!(terms.geometry, Geometry::Plane, "{glance:?}");
    assert_eq!(terms.material, Material::Matte, "{glance:?}");
    assert_eq!(terms.shadow, Shadow::None, "{glance:?}");
}

#[test]
fn clutter_gets_its_shape_its_shadows_and_its_highlights() {
    let (terms, glance) = chosen(&bundled("desk.mcap"));
    assert_eq!(terms.geometry, Geometry::Full, "{glance:?}");
    assert_eq!(terms.material, Material::Varying, "{glance:?}");
    assert_eq!(terms.shadow, Shadow::Network, "{glance:?}");
}

#[test]
fn other_noise_leaves_the_choice_as_it_is() {
    // A flip of a choice that lies on the edge is no bug, many are: 19 of 20 must agree.
    let agree = |choices: &[Terms]| {
        let same = |one: &Terms| choices.iter().filter(|other| *other == one).count();
        choices.iter().map(same).max().unwrap()
    };
    let boards: Vec<Terms> = (0..20).map(|seed| chosen(&board(seed)).0).collect();
    assert!(agree(&boards) >= 19, "{boards:?}");
    let desk = bundled("desk.mcap");
    let noisier = |seed| {
        let noise = |name: &str, shot: &Shot| {
            Corruption::named(name)
                .unwrap()
                .on_shot(shot, 1, seed)
                .unwrap()
        };
        chosen(&noise("tof-noise", &noise("sensor-noise", &desk))).0
    };
    let desks: Vec<Terms> = (0..20).map(noisier).collect();
    assert!(agree(&desks) >= 19, "{desks:?}");
}

#[test]
fn what_lies_beyond_the_depth_cameras_range_comes_back_to_where_it_is() {
    let clean = board(1);
    let wrapped = Corruption::named("phase-wrap").unwrap();
    let wrapped = wrapped.on_shot(&clean, 3, 1).unwrap();
    let base = Options::default();
    let work = Workload {
        pixels: clean.depth.metres.len(),
        working_pixels: base.working_pixels,
        lamps: 1,
    };
    // Share of the pixels whose depth is within two percent of the board's.
    let right = |careful: bool| {
        let light = radiometry::subtract(&wrapped.flash, &wrapped.ambient, &base.subtract).unwrap();
        let build = if careful { Model::careful } else { Model::new };
        let (plan, glance) = (Plan::closed(work), Glance::nothing_known());
        let model = build(&wrapped, light, &plan, &glance, &base, &mut |_| ()).unwrap();
        let found = model.development.scene.depth_metres.samples().iter();
        let near = found.zip(clean.depth.metres.samples());
        let near = near.filter(|(found, true_depth)| (*found / *true_depth - 1.0).abs() < 0.02);
        near.count() as f32 / clean.depth.metres.len() as f32
    };
    assert!(right(false) < 0.97, "{}", right(false));
    assert!(right(true) > 0.99, "{}", right(true));
}
