//! Milliseconds, GFLOP/s and memory of every network on every backend, at 256 × 256.
//!
//! `cargo bench --bench inference` prints one table of the models that this program accepts and that
//! are there; `-- --models DIR` takes those of DIR/manifest.toml instead. A backend is chosen once
//! per process, and memory is counted per process, so each line comes from a process of its own.

#![expect(clippy::print_stdout, reason = "the table is the point")]

use captured::{
    inference::{Backend, Manifest, Model, ModelFile, NetworkSession, Runtime, Settings, find},
    relight::networks::{Channels, Network},
};
use std::{
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

const SIDE: usize = 256;
/// Answers timed, after one that is not.
const ROUNDS: usize = 15;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    // `cargo test --benches` only wants to know that it runs.
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let value = |name: &str| {
        let place = arguments.iter().position(|argument| argument == name)?;
        arguments.get(place + 1).cloned()
    };
    let models = value("--models").map(PathBuf::from);
    let manifest = match &models {
        None => Manifest::embedded().expect("a manifest"),
        Some(folder) => {
            let path = folder.join("manifest.toml");
            let text = std::fs::read_to_string(&path).expect("DIR/manifest.toml");
            Manifest::parse(&text).expect("a manifest")
        }
    };
    let settings = Settings {
        models,
        runtime: value("--runtime").map(PathBuf::from),
        threads: value("--threads").and_then(|threads| threads.parse().ok()),
    };
    match value("--model").and_then(|index| index.parse::<usize>().ok()) {
        Some(index) => line(&manifest.models()[index], &settings),
        None => table(&manifest, &settings),
    }
}

/// Runs this program once per line.
fn table(manifest: &Manifest, settings: &Settings) {
    println!(
        "| network | backend | threads | load ms | median ms | best ms | CPU ms | GFLOP/s | peak MiB |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let library = find(settings).ok().map(|found| found.path);
    if library.is_none() {
        println!("| – | ONNX Runtime: its library was not found | | | | | | | |");
    }
    // No library: tract.
    let nowhere = Some(PathBuf::from("/nonexistent"));
    let backends = [(library, &[1, 2][..]), (nowhere, &[1][..])];
    for (library, threads) in backends {
        let Some(library) = library else { continue };
        for (index, model) in manifest.models().iter().enumerate() {
            if ModelFile::read(model, settings).is_err() {
                continue;
            }
            for threads in threads {
                of_a_process(index, &library, *threads, settings);
            }
        }
    }
}

fn of_a_process(index: usize, library: &Path, threads: usize, settings: &Settings) {
    let mut command = Command::new(std::env::current_exe().expect("a program"));
    command
        .arg("--bench")
        .args(["--model", &index.to_string()])
        .args(["--threads", &threads.to_string()])
        .arg("--runtime")
        .arg(library);
    if let Some(models) = &settings.models {
        command.arg("--models").arg(models);
    }
    let done = command.status().expect("this program again");
    assert!(done.success(), "model {index}: {done}");
}

fn line(model: &Model, settings: &Settings) {
    let file = ModelFile::read(model, settings).expect("an accepted model");
    let runtime = Runtime::start(settings).expect("a runtime");
    let before = memory("VmRSS:");
    let began = Instant::now();
    let session = NetworkSession::new(file, runtime, settings.threads());
    session.prepare((SIDE, SIDE)).expect("a session");
    let loading = milliseconds(began);
    let inputs: Vec<(&str, Channels)> = model
        .inputs
        .iter()
        .map(|signal| (signal.name.as_str(), ramp(signal.channels() as usize)))
        .collect();
    let given: Vec<(&str, &Channels)> = inputs.iter().map(|(name, c)| (*name, c)).collect();
    let wanted: Vec<&str> = model
        .outputs
        .iter()
        .map(|signal| signal.name.as_str())
        .collect();
    let mut times = Vec::with_capacity(ROUNDS);
    let mut spent = 0.0;
    for round in 0..=ROUNDS {
        if round == 1 {
            spent = processor_milliseconds();
        }
        let began = Instant::now();
        let answers = session.answer(&given, &wanted).expect("an answer");
        assert_eq!(answers.len(), wanted.len());
        if round > 0 {
            times.push(milliseconds(began));
        }
    }
    let spent = (processor_milliseconds() - spent) / ROUNDS as f64;
    times.sort_by(f64::total_cmp);
    let median = times[ROUNDS / 2];
    println!(
        "| {} ({}), {:.1} M | {} | {} | {loading:.0} | {median:.1} | {:.1} | {spent:.0} | {:.1} | {:.0} |",
        model.name,
        model.variant,
        model.parameters as f64 / 1e6,
        name(&runtime.backend),
        runtime.backend.threads(settings.threads()),
        times[0],
        model.gflop_256 / median * 1e3,
        memory("VmHWM:") - before,
    );
}

fn name(backend: &Backend) -> String {
    backend.description()
}

fn milliseconds(began: Instant) -> f64 {
    began.elapsed().as_secs_f64() * 1e3
}

/// Processor time of all threads of this process, milliseconds; Linux counts in hundredths of a second.
/// On a shared machine it wanders less than the time on the wall.
fn processor_milliseconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The second field is a name in parentheses, which may hold blanks.
    let after_name = text.rsplit(')').next().unwrap_or_default();
    let fields: Vec<&str> = after_name.split_whitespace().collect();
    let ticks = |place: usize| {
        fields
            .get(place)
            .and_then(|field| field.parse::<f64>().ok())
    };
    match (ticks(11), ticks(12)) {
        (Some(user), Some(system)) => 10.0 * (user + system),
        _ => f64::NAN,
    }
}

/// Smooth pictures: of constant ones some kernels make short work.
fn ramp(count: usize) -> Channels {
    let pixels = SIDE * SIDE;
    let value = |index: usize| ((index % 997) as f32 / 997.0 + (index / pixels) as f32) % 1.0;
    Channels {
        size: (SIDE, SIDE),
        count,
        samples: (0..count * pixels).map(value).collect(),
    }
}

/// MiB of this process, as Linux counts them.
fn memory(what: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(what));
    let kilobytes = line.and_then(|rest| rest.split_whitespace().next()?.parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1024.0
}
