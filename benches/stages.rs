//! Medians of every stage against a plain memory copy of the same bytes, on two threads.
//!
//! `cargo bench --bench stages` prints one table. Times on a shared machine wander; the ratio to
//! the copy, taken in the same run, is what to compare.

#![expect(clippy::print_stdout, reason = "the table is the point")]

#[path = "../tests/march/mod.rs"]
mod march;
mod world;

use captured::{
    develop::{Options, develop},
    radiometry::{LinearImage, NoiseModel, linearise, subtract_linear_into},
    registration::{RegisteredDepth, RigMaps, Scratch, register_into},
    relight::{
        Environment, Indirect, Lamp, LightSet, Origin, Preparation, Prepared, RelightOptions,
        Shadows,
        visibility::{Answers, Occluders, Thickness, sweep},
    },
};
use drivers::Plane;
use rayon::prelude::*;
use std::{hint::black_box, time::Instant};

/// Runs until it has `ROUNDS` timings or has spent a while; milliseconds, sorted.
fn timings(mut work: impl FnMut()) -> Vec<f64> {
    const ROUNDS: usize = 31;
    work();
    let begun = Instant::now();
    let mut all = Vec::with_capacity(ROUNDS);
    while all.len() < ROUNDS && (all.len() < 5 || begun.elapsed().as_secs() < 8) {
        let start = Instant::now();
        work();
        all.push(start.elapsed().as_secs_f64() * 1e3);
    }
    all.sort_by(f64::total_cmp);
    all
}

fn median(sorted: &[f64]) -> f64 {
    sorted[sorted.len() / 2]
}

/// One line of the table. `bytes` is what the stage must read and write at least once; `target`
/// is what the project asks for, in milliseconds.
fn line(name: &str, bytes: usize, target: Option<f64>, work: impl FnMut()) -> f64 {
    let times = timings(work);
    let from = vec![1u8; bytes / 2];
    let mut to = vec![0u8; bytes / 2];
    let copy = median(&timings(|| {
        let share = bytes.div_ceil(4).max(1);
        to.par_chunks_mut(share)
            .zip(from.par_chunks(share))
            .for_each(|(to, from)| {
                to.copy_from_slice(from);
            });
        black_box(&to);
    }));
    let target = target.map_or(String::from("—"), |target| format!("{target:.0}"));
    println!(
        "| {name} | {:.2} | {:.2} | {target} | {:.1} | {:.1}× |",
        median(&times),
        times[0],
        bytes as f64 / 1e6,
        median(&times) / copy
    );
    median(&times)
}

fn main() {
    // `cargo test --benches` only wants to know that it runs.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build_global()
        .expect("the first pool");
    println!("| stage | median ms | best ms | target ms | MB | to a copy |");
    println!("|---|---|---|---|---|---|");
    lights();
    environments();
    marches();
    registration();
    subtraction();
    twelve_megapixels();
}

fn lights() {
    for (width, height, target) in [(512, 512, 3.0), (1920, 1080, 15.0)] {
        let scene = world::scene(width, height);
        let prepared = Prepared::new(&scene, Preparation::default());
        // Per pixel: normal, albedo, roughness and slab in; light and shadow out.
        let bytes = width * height * (12 + 12 + 4 + 8 + 12 + 4);
        let mut light = Plane::filled(width, height, [0.0; 3]);
        let mut shadow = Plane::filled(width, height, 0.0);
        for (place, direction) in [
            ("oblique", [0.5, 0.6, 0.62]),
            ("grazing", [0.9, 0.2, 0.2]),
            ("frontal", [0.0, 0.0, 1.0]),
        ] {
            let lamp = Lamp::from_person(direction).expect("a direction");
            let name = format!("one {place} light with cast shadow, {width}×{height}");
            line(&name, bytes, Some(target), || {
                let options = RelightOptions::default();
                black_box(prepared.relight_into(&lamp, options, &mut light, &mut shadow));
            });
        }
        let lamp = Lamp::from_person([0.5, 0.6, 0.62]).expect("a direction");
        line(
            &format!("the same without shadow, {width}×{height}"),
            bytes,
            None,
            || {
                let options = RelightOptions {
                    shadows: Shadows::None,
                    indirect: Indirect::None,
                };
                black_box(prepared.relight_into(&lamp, options, &mut light, &mut shadow));
            },
        );
        line(
            &format!("preparing a scene, {width}×{height}"),
            bytes,
            None,
            || {
                black_box(Prepared::new(&scene, Preparation::default()));
            },
        );
    }
}

fn environments() {
    let scene = world::scene(512, 512);
    let prepared = Prepared::new(&scene, Preparation::default());
    let pixels = 512 * 512;
    let environment = Environment::new(&world::sky()).expect("a sky");
    let whole = LightSet::whole(&environment);
    line(
        "visibility map, 32 azimuths × 8 rings, 512²",
        pixels * 44,
        Some(40.0),
        || {
            black_box(prepared.visibility_map(&whole));
        },
    );
    let map = prepared.visibility_map(&whole);
    let options = RelightOptions {
        indirect: Indirect::None,
        ..Default::default()
    };
    let lamps = environment.lamps().count();
    line(
        &format!("environment as {lamps} shadowed lights, 512²"),
        pixels * 76,
        Some(60.0),
        || {
            black_box(prepared.environment(&map, &whole, options));
        },
    );
    let clean = |_, _| 0.0;
    line("choice of its lights, 512²", pixels * 44, None, || {
        black_box(prepared.light_set(&environment, &map, &clean));
    });
    let (set, found) = prepared.light_set(&environment, &map, &clean);
    line(
        &format!("environment as {} chosen lights, 512²", found.lights),
        pixels * 76,
        None,
        || {
            black_box(prepared.environment(&map, &set, options));
        },
    );
    let fast = prepared.environment(&map, &whole, options).light;
    let mut sum = vec![[0.0f32; 3]; pixels];
    for lamp in environment.lamps() {
        let one = prepared.relight(lamp, options).light;
        for (sum, one) in sum.iter_mut().zip(one.0.samples()) {
            *sum = std::array::from_fn(|c| sum[c] + one[c]);
        }
    }
    let (mut error, mut signal) = (0.0f64, 0.0f64);
    for (sum, fast) in sum.iter().zip(fast.0.samples()) {
        for c in 0..3 {
            error += f64::from(sum[c] - fast[c]).powi(2);
            signal += f64::from(sum[c]).powi(2);
        }
    }
    let level = |sum: f64| 10.0 * (sum / (3 * pixels) as f64).log10();
    println!(
        "\nenvironment against the sum of its {lamps} lights: error {:.1} dB under the signal; \
         brightness differs by {:.3} dB\n",
        level(signal) - level(error),
        level(
            fast.0
                .samples()
                .iter()
                .flatten()
                .map(|v| f64::from(*v).powi(2))
                .sum()
        ) - level(signal),
    );
}

/// The sweep against a march of 64 steps per pixel, in time and in agreement with the reference.
fn marches() {
    let scene = world::scene(512, 512);
    let occluders = Occluders::new(
        scene.camera,
        &scene.depth_metres,
        &scene.thickness_metres,
        &scene.depth_sigma_metres,
    );
    let lamp = Lamp::from_person([0.5, 0.6, 0.62]).expect("a direction");
    let bytes = 512 * 512 * 9;
    let swept = line("sweep alone, one light, 512²", bytes, None, || {
        black_box(sweep(
            &occluders,
            Origin::Distant(lamp.toward()),
            Thickness::Doubted,
        ));
    });
    let marched = line("march of 64 steps, one light, 512²", bytes, None, || {
        black_box(world::march_64(&scene, lamp.toward()));
    });
    let steps = world::march_64(&scene, lamp.toward());
    // The march takes thickness as it is guessed.
    let answer = sweep(
        &occluders,
        Origin::Distant(lamp.toward()),
        Thickness::Guessed,
    );
    let answers = Answers::new(&answer, 512);
    let mut row = vec![0.0; 512];
    let (mut by_sweep, mut by_steps, mut count) = (0, 0, 0);
    for y in (0..512).step_by(4) {
        answers.row(y, &mut row);
        for x in (0..512).step_by(4) {
            if scene.normal[(x, y)].dot(lamp.toward()) <= 0.0 {
                continue;
            }
            let metres = &scene.depth_metres;
            let clear = march::march(
                &scene.camera,
                metres,
                &scene.thickness_metres,
                Origin::Distant(lamp.toward()),
                (x, y),
            );
            count += 1;
            by_sweep += usize::from((row[x] > 0.5) == clear);
            by_steps += usize::from(steps[y * 512 + x] == clear);
        }
    }
    println!(
        "\nthe sweep is {:.0}× faster than the march; against the reference the sweep agrees on \
         {:.2} % of facing pixels, the march of 64 steps on {:.2} %\n",
        marched / swept,
        100.0 * by_sweep as f64 / count as f64,
        100.0 * by_steps as f64 / count as f64
    );
}

fn registration() {
    let (rig, frame) = world::depth_frame(640, 576, 1280, 720);
    let maps = RigMaps::new(&rig).expect("a rig");
    let mut scratch = Scratch::default();
    let mut registered = RegisteredDepth::unknown(1280, 720);
    let bytes = 640 * 576 * 4 + 1280 * 720 * 9;
    line(
        "depth 640×576 → color 1280×720",
        bytes,
        Some(8.0),
        || {
            register_into(&frame, &maps, None, &mut scratch, &mut registered).expect("depth");
        },
    );
    let guide = linearise(&world::large_shot(1280, 720).flash).expect("a photograph");
    line(
        "the same along the edges of a picture",
        bytes + 1280 * 720 * 12,
        Some(8.0),
        || {
            let guide = Some(&guide);
            register_into(&frame, &maps, guide, &mut scratch, &mut registered).expect("depth");
        },
    );
}

fn subtraction() {
    let (width, height) = (4000, 3000);
    let (flash, ambient) = world::photographs(width, height);
    let noise = NoiseModel {
        read_variance: 1e-6,
        shot_slope: 1e-4,
    };
    let mut light = LinearImage(Plane::filled(width, height, [0.0; 3]));
    let mut variance = Plane::filled(width, height, 0.0);
    line(
        "subtraction of a 12 MP pair with variance",
        width * height * 22,
        Some(60.0),
        || {
            subtract_linear_into(&flash, &ambient, [noise; 2], &mut light, &mut variance)
                .expect("a pair");
        },
    );
}

fn twelve_megapixels() {
    let before = peak_mebibytes();
    let shot = world::large_shot(4000, 3000);
    let start = Instant::now();
    let developed = develop(&shot, &Options::default(), &mut |_| {}).expect("a shot");
    let lamp = Lamp::from_person([0.5, 0.6, 0.62]).expect("a direction");
    let relit = developed.finish(developed.prepared.relight(&lamp, RelightOptions::default()));
    println!(
        "\n12 MP shot to one relit picture: {:.0} ms; peak memory of this process {:.0} MiB \
         (before: {before:.0} MiB), target 1024 MiB; {} pixels",
        start.elapsed().as_secs_f64() * 1e3,
        peak_mebibytes(),
        relit.light.0.len()
    );
}

/// Most memory this process ever held, from the kernel; 0 where it does not say.
fn peak_mebibytes() -> f64 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|status| {
            let line = status
                .lines()
                .find(|line| line.starts_with("VmHWM"))?
                .to_owned();
            line.split_whitespace().nth(1)?.parse::<f64>().ok()
        })
        .map_or(0.0, |kibibytes| kibibytes / 1024.0)
}
