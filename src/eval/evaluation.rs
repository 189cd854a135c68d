//! Captures with truth → [`Report`].

use super::capture_run::evaluate_capture;
use super::light_error::GridMismatch;
use super::methods::{DepthGiven, MethodError};
use super::published::PUBLISHED;
use super::report::{Machine, NoisyReport, Report};
use super::roster::{Roster, Row};
use super::summary::{RowFigures, RowSummary};
use crate::corruption::DepthNoise;
use crate::develop::{self, DevelopError};
use crate::folder::{Capture, FolderError};
use crate::relight::LampError;
use drivers::chance::Chance;
use thiserror::Error;

/// How to evaluate.
#[derive(Debug, Clone, Copy)]
pub struct EvalOptions {
    /// How shots are developed.
    pub develop: develop::Options,
    /// How often each shot is developed, for the stages' median time; at least 1.
    pub development_runs: usize,
    /// What to put on the depth for a second pass; `None` = no second pass.
    pub noisy: Option<NoisyDepth>,
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
        }
    }
}

/// How far an evaluation has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress<'a> {
    /// The capture in work.
    pub capture: &'a str,
    /// Captures finished, with the fraction of the one in work.
    pub captures_done: f32,
    /// Captures in all.
    pub captures: usize,
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
/// compares; where noise on the depth is asked for, all of it once more with the noise. A capture
/// without truth still gives its stages' times.
///
/// # Errors
/// The first [`EvalError`] met.
pub fn evaluate(
    captures: &[Capture],
    roster: &Roster,
    options: &EvalOptions,
    mut progress: impl FnMut(Progress<'_>),
) -> Result<Report, EvalError> {
    let passes = if options.noisy.is_some() { 2 } else { 1 };
    let mut clean = Vec::with_capacity(captures.len());
    let mut noisy = Vec::new();
    for (done, capture) in captures.iter().enumerate() {
        let mut tell = |pass: usize, fraction: f32| {
            progress(Progress {
                capture: &capture.name,
                captures_done: done as f32 + (pass as f32 + fraction) / passes as f32,
                captures: captures.len(),
            });
        };
        tell(0, 0.0);
        let mut evaluated = |capture: &Capture, depth, pass| {
            let mut tell = |fraction| tell(pass, fraction);
            evaluate_capture(capture, depth, roster, options, &mut tell)
        };
        clean.push(evaluated(capture, DepthGiven::Clean, 0)?);
        if let Some(NoisyDepth { noise, seed }) = options.noisy {
            let capture = Capture {
                name: capture.name.clone(),
                shot: noise.on_shot(&capture.shot, chance_of(seed, &capture.name)),
                truth: capture.truth.clone(),
            };
            noisy.push(evaluated(&capture, DepthGiven::Noisy, 1)?);
        }
        tell(passes - 1, 1.0);
    }
    let rows = roster.rows().iter().map(|row| RowSummary {
        row: row.number,
        label: row.label.clone(),
        name: row.name.clone(),
        figures: RowFigures::of(row, &clean),
        noisy: options.noisy.map(|_| RowFigures::of(row, &noisy)),
    });
    Ok(Report {
        format: 2,
        protocol: PROTOCOL.iter().map(|line| (*line).to_owned()).collect(),
        machine: machine(),
        rows: rows.collect(),
        captures: clean,
        noisy: options.noisy.map(|NoisyDepth { noise, seed }| NoisyReport {
            noise,
            seed,
            captures: noisy,
        }),
        published: PUBLISHED.to_vec(),
    })
}

/// A source of its own for every capture, whatever stands before it in the list.
fn chance_of(seed: u64, name: &str) -> Chance {
    let own = |chance: Chance, byte: u8| chance.of(u64::from(byte));
    name.bytes().fold(Chance::new(seed), own)
}

/// What every figure of a report rests on.
const PROTOCOL: [&str; 10] = [
    "Values are clipped to [0, 1], white Lambertian facing the lamp = 1; true pictures are divided by their lamp's intensity.",
    "Only pixels inside mask.png with a truth count; pixels a method does not answer are left out of its means and counted.",
    "Where the scale of the truth or of the flash is unknown, every row is multiplied by its best factor (least squares, linear light, one for all lights of a capture); row 1 always is.",
    "Where the scale of the truth is unknown, it is exposed so that 99 % of its values (brightest channel, all lights) lie under 1.",
    "PSNR of a row is the mean over lights of the picture's PSNR; IoU, balanced error and regions are pooled over lights.",
    "si-MSE is taken after the best factor for each picture alone, unclipped.",
    "Shadow truth is shadow_NNN.png, or derived: n·l > 0.2, 3 pixels inside the mask, and darker than 0.3 of the matte brightness (60 % quantile over lights) is cast shadow.",
    "Means of a row run over the captures it answered; captures and lights without an answer are counted beside it.",
    "Noisy depth: depth brought to [0, 1] with Gaussian noise, then a Gaussian blur (sigmas stated for 256x256, noise and blur growing with the grid).",
    "Milliseconds are wall-clock, of this machine and build, or as stated in an answer's times.json.",
];

fn machine() -> Machine {
    Machine {
        target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
        threads: rayon::current_num_threads(),
        release_build: !cfg!(debug_assertions),
    }
}
