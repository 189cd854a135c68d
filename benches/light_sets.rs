//! Sets of lights for environments: chosen for the scene against fixed counts.
//!
//! `cargo bench --profile dev --bench light_sets -- [--out DIR] [--map MAP.hdr]… CAPTURE…` compares them
//! for every capture folder under every map, and under the maps of its own truth
//! (`truth/environment_NNN.hdr` beside the true picture `.exr`), prints one table and writes
//! `light_sets.csv`, `.png` and `.svg` into DIR.

#![expect(clippy::print_stdout, reason = "the table is the point")]

use captured::{
    develop::{Options, develop},
    eval::{
        charts,
        light_sets::{COUNTS, LightSetRun, SetFigures, compare, csv},
    },
    folder::{self, Limits, Samples, decode_limited},
};
use drivers::Plane;
use std::path::{Path, PathBuf};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (mut captures, mut maps, mut out) = (Vec::new(), Vec::new(), None);
    let mut asked = false;
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--bench" => asked = true,
            "--map" => maps.extend(arguments.next().map(PathBuf::from)),
            "--out" => out = arguments.next().map(PathBuf::from),
            _ => captures.push(PathBuf::from(argument)),
        }
    }
    // `cargo test --benches` only wants to know that it runs.
    if !asked {
        return;
    }
    let mut runs = Vec::new();
    for capture in &captures {
        runs.extend(runs_of(capture, &maps));
    }
    if runs.is_empty() {
        println!("nothing to compare: name capture folders, and maps with --map or in their truth");
        return;
    }
    table(&runs);
    if let Some(out) = out {
        std::fs::create_dir_all(&out).expect("DIR of --out can be made");
        let mut files = charts::light_sets(&runs).expect("a chart");
        files.push(("light_sets.csv".to_owned(), csv(&runs).into_bytes()));
        for (name, contents) in files {
            std::fs::write(out.join(name), contents).expect("DIR of --out can be written");
        }
    }
}

fn runs_of(capture: &Path, maps: &[PathBuf]) -> Vec<LightSetRun> {
    let shot = folder::read(capture).expect("a capture folder").shot;
    let development = develop(&shot, &Options::default(), &mut |_| ()).expect("it develops");
    let name = stem(capture);
    let run = |map: &Path, truth: Option<&Plane<[f32; 3]>>| {
        compare([&name, &stem(map)], &development, &picture(map), truth)
    };
    let mut runs: Vec<LightSetRun> = maps.iter().filter_map(|map| run(map, None)).collect();
    for number in 0.. {
        let map = capture.join(format!("truth/environment_{number:03}.hdr"));
        if !map.is_file() {
            break;
        }
        let truth = picture(&map.with_extension("exr"));
        runs.extend(run(&map, Some(&truth)));
    }
    runs
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn picture(path: &Path) -> Plane<[f32; 3]> {
    match decode_limited(path, None, Limits::default())
        .expect("a picture")
        .samples
    {
        Samples::RgbF32(plane) => plane,
        other => panic!(
            "{}: holds {}; give linear light",
            path.display(),
            other.describe()
        ),
    }
}

fn table(runs: &[LightSetRun]) {
    println!(
        "{} scenes under a map; medians, and in brackets 5 to 95 %\n",
        runs.len()
    );
    println!(
        "| lights | used | ms | change, steps of 255 | PSNR to a dense sum, dB | PSNR to truth, dB |"
    );
    println!("|---|---|---|---|---|---|");
    line("chosen", runs.iter().map(|run| &run.chosen));
    for (place, count) in COUNTS.iter().enumerate() {
        line(&count.to_string(), runs.iter().map(|run| &run.fixed[place]));
    }
    let noise = spread(runs.iter().map(LightSetRun::noise_steps));
    let capped = runs.iter().filter(|run| run.found.capped).count();
    println!("\nnoise {noise} steps; {capped} of {} capped", runs.len());
}

fn line<'a>(name: &str, sets: impl Iterator<Item = &'a SetFigures> + Clone) {
    println!(
        "| {name} | {} | {} | {} | {} | {} |",
        spread(sets.clone().map(|set| set.lights as f64)),
        spread(sets.clone().map(|set| set.milliseconds)),
        spread(sets.clone().map(|set| set.change_steps)),
        spread(sets.clone().map(|set| set.dense_psnr_db)),
        spread(sets.filter_map(|set| set.truth_psnr_db)),
    );
}

fn spread(values: impl Iterator<Item = f64>) -> String {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    if values.is_empty() {
        return "—".to_owned();
    }
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    format!("{:.2} ({:.2}–{:.2})", at(0.5), at(0.05), at(0.95))
}
