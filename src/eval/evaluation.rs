//! Captures with truth → [`Report`].

use super::capture_run::evaluate_capture;
use super::ledger::Ledger;
use super::light_error::GridMismatch;
use super::made::Made;
use super::methods::{DepthGiven, MethodError};
use super::published::PUBLISHED;
use super::report::{CaptureReport, Machine, NoisyReport, Report};
use super::roster::{Roster, Row};
use super::stability::{self, CaptureCells, Spoiling, StabilityReport};
use super::summary::{RowFigures, RowSummary};
use crate::corruption::DepthNoise;
use crate::develop::{self, DevelopError};
use crate::folder::{Capture, FolderError};
use crate::relight::LampError;
use drivers::chance::Chance;
use thiserror::Error;

/// How to evaluate.
#[derive(Debug, Clone)]
pub struct EvalOptions {
    /// How shots are developed.
    pub develop: develop::Options,
    /// How often each shot is developed, for the stages' median time; at least 1.
    pub development_runs: usize,
    /// What to put on the depth for a second pass; `None` = no second pass.
    pub noisy: Option<NoisyDepth>,
    /// How to make captures worse for the stability run; `None` = no such run.
    pub spoiling: Option<Spoiling>,
}

/// Noise for a second pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoisyDepth {
    /// How much.
    pub noise: DepthNoise,
    /// Of the noise.
    pub seed: u64,
}

impl Default for EvalOptions {
    fn default() -> Self {
        Self {
            develop: develop::Options::default(),
            development_runs: 3,
            noisy: None,
            spoiling: None,
        }
    }
}

/// How far an evaluation has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress<'a> {
    /// The capture in work.
    pub capture: &'a str,
    /// What is done to it: `noisy depth`, a corruption as in `jpeg:3`; empty for the capture as it
    /// came.
    pub state: &'a str,
    /// Fraction of the captures' states that are done.
    pub done: f32,
}

/// Why a capture could not be evaluated.
#[derive(Debug, Error)]
pub enum EvalError {
    /// Its truth cannot be read.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// It cannot be developed.
    #[error("{capture}: {source}")]
    Develop {
        /// Name of the capture.
        capture: String,
        /// The cause.
        source: DevelopError,
    },
    /// A truth of another size than the photograph.
    #[error("{capture}: {source}")]
    Grid {
        /// Name of the capture.
        capture: String,
        /// The cause.
        source: GridMismatch,
    },
    /// A light from nowhere.
    #[error("{capture}: truth/lights.toml: light {light}: {source}")]
    Light {
        /// Name of the capture.
        capture: String,
        /// Index of the light.
        light: usize,
        /// The cause.
        source: LampError,
    },
    /// A method that failed.
    #[error("{capture}: row {row}: {source}")]
    Method {
        /// Name of the capture.
        capture: String,
        /// Label and name of the row.
        row: String,
        /// The cause.
        source: Box<MethodError>,
    },
}

impl EvalError {
    pub(super) fn method(capture: &str, row: &Row, source: MethodError) -> Self {
        Self::Method {
            capture: capture.to_owned(),
            row: format!("{} {}", row.label, row.name),
            source: Box::new(source),
        }
    }
}

/// Develops every capture, relights it with every row's method under every true light, and
/// compares; where noise on the depth is asked for, all of it once more with the noise; where
/// captures are to be made worse, the rows that answer here once more for each way and severity. A
/// capture without truth still gives its stages' times. What `ledger` holds is taken over, and what
/// is finished is put there.
///
/// # Errors
/// The first [`EvalError`] met.
pub fn evaluate(
    captures: &[Capture],
    roster: &Roster,
    options: &EvalOptions,
    ledger: &Ledger,
    mut progress: impl FnMut(Progress<'_>),
) -> Result<Report, EvalError> {
    let spoiled = options.spoiling.as_ref().map_or_else(Vec::new, |spoiling| {
        let relit = |index: &usize| has_lights(&captures[*index]);
        let relit: Vec<usize> = (0..captures.len()).filter(relit).collect();
        spread(&relit, spoiling.captures)
    });
    let plain_states = captures.len() * if options.noisy.is_some() { 2 } else { 1 };
    let states = |spoiling: &Spoiling| 1 + spoiling.ways.len() * spoiling.severities.len();
    let states_of_one = options.spoiling.as_ref().map_or(0, states);
    let all = (plain_states + spoiled.len() * states_of_one).max(1) as f32;
    let mut before = 0.0;
    let mut tell = |capture: &str, state: &str, done: f32| {
        progress(Progress {
            capture,
            state,
            done: done / all,
        });
    };
    let mut clean = Vec::with_capacity(captures.len());
    let mut noisy = Vec::new();
    let mut cells: Vec<CaptureCells> = Vec::new();
    for (index, capture) in captures.iter().enumerate() {
        let mut evaluated = |capture: &Capture, depth, state: &str| {
            if let Some(found) = ledger.found::<CaptureReport>(index, state) {
                before += 1.0;
                return Ok(found);
            }
            tell(&capture.name, state, before);
            let found = evaluate_capture(capture, depth, roster, options, &mut |fraction| {
                tell(&capture.name, state, before + fraction);
            })?;
            ledger.keep(index, state, &found);
            before += 1.0;
            Ok::<_, EvalError>(found)
        };
        clean.push(evaluated(capture, DepthGiven::Clean, "")?);
        if let Some(NoisyDepth { noise, seed }) = options.noisy {
            let capture = Capture {
                name: capture.name.clone(),
                shot: noise.on_shot(&capture.shot, chance_of(seed, &capture.name)),
                truth: capture.truth.clone(),
            };
            noisy.push(evaluated(&capture, DepthGiven::Noisy, "noisy depth")?);
        }
        if let (Some(spoiling), Some(truth)) = (&options.spoiling, &capture.truth)
            && spoiled.contains(&index)
        {
            let asked = stability::Asked {
                roster,
                options,
                spoiling,
            };
            cells.push(stability::measure(
                capture,
                truth,
                &asked,
                (ledger, index),
                &mut |state, fraction| {
                    let done = before + fraction * states_of_one as f32;
                    tell(&capture.name, state, done);
                },
            )?);
            before += states_of_one as f32;
        }
    }
    let rows = roster.rows().iter().map(|row| {
        let with_noise = options.noisy.map(|_| RowFigures::of(row, &noisy));
        RowSummary::of(row, RowFigures::of(row, &clean), with_noise)
    });
    Ok(Report {
        format: 4,
        protocol: PROTOCOL.iter().map(|line| (*line).to_owned()).collect(),
        made: Made::now(),
        machine: machine(),
        rows: rows.collect(),
        other_backends: Vec::new(),
        captures: clean,
        noisy: options.noisy.map(|NoisyDepth { noise, seed }| NoisyReport {
            noise,
            seed,
            captures: noisy,
        }),
        stability: options
            .spoiling
            .as_ref()
            .map(|spoiling| StabilityReport::of(spoiling, roster, cells)),
        light_sets: Vec::new(),
        published: PUBLISHED.to_vec(),
    })
}

/// Whether there are pictures to compare relit ones with.
fn has_lights(capture: &Capture) -> bool {
    let truth = capture.truth.as_ref();
    truth.is_some_and(|truth| !truth.lights.is_empty())
}

/// At most `most` of the indices, evenly over all of them.
fn spread(indices: &[usize], most: usize) -> Vec<usize> {
    let number = most.min(indices.len());
    let at = |place: usize| indices[place * indices.len() / number];
    (0..number).map(at).collect()
}

/// A source of its own for every capture, whatever stands before it in the list.
pub(super) fn chance_of(seed: u64, name: &str) -> Chance {
    let own = |chance: Chance, byte: u8| chance.of(u64::from(byte));
    name.bytes().fold(Chance::new(seed), own)
}

/// What every figure of a report rests on.
const PROTOCOL: [&str; 12] = [
    "Values are clipped to [0, 1], white Lambertian facing the lamp = 1; true pictures are divided by their lamp's intensity.",
    "Only pixels inside mask.png with a truth count; pixels a method does not answer are left out of its means and counted.",
    "Where the scale of the truth or of the flash is unknown, every row is multiplied by its best factor (least squares, linear light, one for all lights of a capture); row 1 always is.",
    "Where the scale of the truth is unknown, it is exposed so that 99 % of its values (brightest channel, all lights) lie under 1.",
    "PSNR of a row is the mean over lights of the picture's PSNR; IoU, balanced error and regions are pooled over lights.",
    "si-MSE is taken after the best factor for each picture alone, unclipped.",
    "Shadow truth is shadow_NNN.png, or derived: n·l > 0.2, 3 pixels inside the mask, and darker than 0.3 of the matte brightness (60 % quantile over lights) is cast shadow.",
    "Means of a row run over the captures it answered; captures and lights without an answer are counted beside it.",
    "Noisy depth: depth brought to [0, 1] with Gaussian noise, then a Gaussian blur (sigmas stated for 256x256, noise and blur growing with the grid).",
    "Stability: captures made worse by the corruptions of FlashToF-C; the rows that answer in this program, up to so many lights of each capture as stated, by the rules above; truth and exposure stay those of the capture as it came.",
    "Error growth is the mean squared error over that of the same captures as they came, means over captures first; worse than nothing: a mean above that of row 1 with the same captures made worse alike.",
    "Milliseconds are wall-clock, of this machine and build, or as stated in an answer's times.json.",
];

fn machine() -> Machine {
    let said = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let mut lines = said.lines().filter_map(|line| line.split_once(':'));
    let model = lines.find(|(key, _)| key.trim() == "model name");
    Machine {
        processor: model.map(|(_, name)| name.trim().to_owned()),
        target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
        threads: rayon::current_num_threads(),
        release_build: !cfg!(debug_assertions),
    }
}
