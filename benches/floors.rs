//! Every stage against its floor: the bytes it must read and write, at the pace of a copy, or the operations it must
//! do, at the pace of multiply–adds.
//!
//! `cargo bench --bench floors [-- --large] [--runtime LIBRARY]` prints one table: 256², 512² and 1080p on one and two
//! threads, with `--large` 12 megapixels too. Copy and multiply–adds are timed in the same run.

#![expect(clippy::print_stdout, reason = "the table is the point")]

#[expect(dead_code, reason = "the bench of stages uses the rest")]
mod world;

use captured::{
    develop::{Grid, Options, develop},
    inference::{Settings, load_compact},
    radiometry::subtract,
    relight::{Emitter, Lamp, Prepared, RelightOptions, networks::compact::Correction},
};
use drivers::Plane;
use rayon::prelude::*;
use std::{hint::black_box, path::PathBuf, time::Instant};

/// Lamps that are asked one after another.
const IN_A_ROW: usize = 8;

/// What a stage must do at least.
#[derive(Clone, Copy)]
enum Floor {
    /// Bytes read and written once, a pixel.
    Bytes(usize),
    /// Operations in all.
    Operations(f64),
}

/// Paces of the machine on so many threads.
struct Paces {
    bytes_a_ms: f64,
    operations_a_ms: f64,
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    // `cargo test --benches` only wants to know that it runs.
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let runtime = arguments
        .iter()
        .position(|argument| argument == "--runtime");
    let runtime = runtime
        .and_then(|place| arguments.get(place + 1))
        .map(PathBuf::from);
    let mut sizes = vec![(256, 256), (512, 512), (1920, 1080)];
    if arguments.iter().any(|argument| argument == "--large") {
        sizes.push((4000, 3000));
    }
    println!("| stage | size | threads | ms | floor ms | times the floor |");
    println!("|---|---|---|---|---|---|");
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let paces = Paces::measured();
            for &size in &sizes {
                stages(size, threads, &paces, runtime.as_ref());
            }
        });
    }
}

/// The median of as many rounds as fit into two seconds, at least three, milliseconds.
fn median(mut work: impl FnMut()) -> f64 {
    let begun = Instant::now();
    let mut all = Vec::new();
    while all.len() < 3 || (all.len() < 21 && begun.elapsed().as_secs() < 2) {
        let start = Instant::now();
        work();
        all.push(start.elapsed().as_secs_f64() * 1e3);
    }
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

impl Paces {
    fn measured() -> Self {
        let bytes = 64 << 20;
        let from = vec![1u8; bytes];
        let mut to = vec![0u8; bytes];
        let share = bytes.div_ceil(rayon::current_num_threads());
        let copy = median(|| {
            let parts = to.par_chunks_mut(share).zip(from.par_chunks(share));
            parts.for_each(|(to, from)| to.copy_from_slice(from));
            black_box(&to);
        });
        // Sums enough to hide what one takes to come back.
        const SUMS: usize = 64;
        const ROUNDS: usize = 100_000;
        let adds = median(|| {
            (0..rayon::current_num_threads())
                .into_par_iter()
                .for_each(|_| {
                    let mut sums = black_box([1.0f32; SUMS]);
                    for _ in 0..ROUNDS {
                        for sum in &mut sums {
                            *sum = *sum * 0.999 + 0.001;
                        }
                    }
                    black_box(sums);
                });
        });
        let operations = 2 * SUMS * ROUNDS * rayon::current_num_threads();
        Self {
            bytes_a_ms: 2.0 * bytes as f64 / copy,
            operations_a_ms: operations as f64 / adds,
        }
    }

    fn line(
        &self,
        (name, size, threads): (&str, (usize, usize), usize),
        floor: Floor,
        work: impl FnMut(),
    ) {
        let found = median(work);
        let floor = match floor {
            Floor::Bytes(bytes) => (bytes * size.0 * size.1) as f64 / self.bytes_a_ms,
            Floor::Operations(operations) => operations / self.operations_a_ms,
        };
        let (width, height) = size;
        println!(
            "| {name} | {width}×{height} | {threads} | {found:.2} | {floor:.3} | {:.0} |",
            found / floor
        );
    }
}

fn stages(size: (usize, usize), threads: usize, paces: &Paces, runtime: Option<&PathBuf>) {
    let (width, height) = size;
    let shot = world::large_shot(width, height);
    let options = Options::default();
    let line = |name: &str, floor: Floor, work: &mut dyn FnMut()| {
        paces.line((name, size, threads), floor, work);
    };
    // Two pictures of bytes in; light and variance out.
    line(
        "subtraction, pair aligned",
        Floor::Bytes(2 * 3 + 12 + 4),
        &mut || {
            black_box(subtract(&shot.flash, &shot.ambient, &options.subtract).expect("a pair"));
        },
    );
    let mut unaligned = options.subtract;
    unaligned.align = false;
    line(
        "subtraction, not aligned",
        Floor::Bytes(2 * 3 + 12 + 4),
        &mut || {
            black_box(subtract(&shot.flash, &shot.ambient, &unaligned).expect("a pair"));
        },
    );
    let flash_only = subtract(&shot.flash, &shot.ambient, &options.subtract).expect("a pair");
    // Light in; depth, sigma, and whether it was measured out.
    let grid = || Grid::of(&shot, &flash_only, options.working_pixels).expect("depth");
    line(
        "depth onto the photograph",
        Floor::Bytes(12 + 4 + 4 + 1),
        &mut || {
            black_box(grid());
        },
    );
    let laid = grid();
    // Light, variance and depth in; albedo, normal, roughness, depth, sigma, thickness, confidence out.
    line("surfaces", Floor::Bytes(24 + 12 + 12 + 5 * 4), &mut || {
        black_box(laid.scene(&shot, &options.scene).expect("surfaces"));
    });
    let mut developed = develop(&shot, &options, &mut |_| ()).expect("a shot");
    line(
        "making shadows ready",
        Floor::Bytes(12 + 12 + 5 * 4 + 44),
        &mut || {
            black_box(Prepared::new(&developed.scene, options.prepare));
        },
    );
    let lamp = Lamp::from_person([0.5, 0.6, 0.62]).expect("a direction");
    let working = developed.prepared.size();
    let mut light = Plane::filled(working.0, working.1, [0.0; 3]);
    let mut shadow = Plane::filled(working.0, working.1, 0.0);
    line(
        "a lamp with cast shadow",
        Floor::Bytes(36 + 16),
        &mut || {
            let relight = RelightOptions::default();
            black_box(
                developed
                    .prepared
                    .relight_into(&lamp, relight, &mut light, &mut shadow),
            );
        },
    );
    if working != size {
        let relit = developed.prepared.relight(&lamp, RelightOptions::default());
        line(
            "to the photograph's size",
            Floor::Bytes(12 + 16),
            &mut || {
                black_box(developed.finish(relit.clone()));
            },
        );
    }
    let settings = Settings {
        runtime: runtime.cloned(),
        threads: Some(threads),
        ..Settings::default()
    };
    let compact = load_compact(&settings).expect("the networks of the program");
    line(
        "surfaces corrected by a network",
        Floor::Operations(1.77e9 * network_share(working)),
        &mut || {
            developed
                .refine(&shot, compact.surfaces.as_ref())
                .expect("an answer");
        },
    );
    let correction = Correction::of(&developed.scene, &developed.prepared);
    line(
        "a lamp corrected by a network",
        Floor::Operations(0.40e9 * network_share(working)),
        &mut || {
            let lamp = [Emitter::from(&lamp)];
            let mut relit = correction.relit(&developed.prepared, &lamp, compact.light.as_ref());
            black_box(relit.next().expect("one lamp").expect("an answer"));
        },
    );
    let lamps = [Emitter::from(&lamp); IN_A_ROW];
    line(
        "eight lamps in a row corrected by a network",
        Floor::Operations(IN_A_ROW as f64 * 0.40e9 * network_share(working)),
        &mut || {
            for relit in correction.relit(&developed.prepared, &lamps, compact.light.as_ref()) {
                black_box(relit.expect("an answer"));
            }
        },
    );
}

/// Pixels that networks are asked about, as a share of 256².
fn network_share((width, height): (usize, usize)) -> f64 {
    (width * height).min(65_536) as f64 / 65_536.0
}
