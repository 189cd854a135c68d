//! Captures with truth → [`Report`].

use super::bench::{Bench, RowRun, scaled};
use super::cost::Cost;
use super::grid::stretched;
use super::light_error::{GridMismatch, ScaleFit, light_error};
use super::methods::{ClosedForm, DoNothing, MISSING, Matte, Method};
use super::report::{
    CaptureReport, Machine, Report, RowFigures, RowReport, RowSummary, SceneReport, ShadowTruth,
    StageCost,
};
use super::surface_error::{normal_error, roughness_error};
use crate::develop::{self, DevelopError, Development, Stage};
use crate::folder::{Capture, FolderError, Truth};
use crate::relight::{LampError, RelightOptions};
use drivers::Plane;
use std::time::Instant;
use thiserror::Error;

/// What to evaluate and how.
#[derive(Debug, Clone, Copy)]
pub struct EvalOptions {
    /// How shots are developed.
    pub develop: develop::Options,
    /// What the closed form models.
    pub relight: RelightOptions,
    /// How often each shot is developed, for the stages' median time; at least 1.
    pub development_runs: usize,
}

impl Default for EvalOptions {
    fn default() -> Self {
        Self {
            develop: develop::Options::default(),
            relight: RelightOptions::default(),
            development_runs: 3,
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
}

/// Develops every capture, relights it with every row's method under every true light, and
/// compares. A capture without truth still gives its stages' times.
///
/// # Errors
/// The first [`EvalError`] met.
pub fn evaluate(
    captures: &[Capture],
    options: &EvalOptions,
    mut progress: impl FnMut(Progress<'_>),
) -> Result<Report, EvalError> {
    let closed_form = ClosedForm {
        options: options.relight,
    };
    let methods: [&dyn Method; 3] = [&DoNothing, &Matte, &closed_form];
    let mut reports = Vec::with_capacity(captures.len());
    for (done, capture) in captures.iter().enumerate() {
        let mut tell = |fraction: f32| {
            progress(Progress {
                capture: &capture.name,
                captures_done: done as f32 + fraction,
                captures: captures.len(),
            });
        };
        tell(0.0);
        reports.push(evaluate_capture(capture, options, &methods, &mut tell)?);
        tell(1.0);
    }
    let rows = summaries(&methods, &reports);
    Ok(Report {
        format: 1,
        protocol: PROTOCOL.iter().map(|line| (*line).to_owned()).collect(),
        machine: machine(),
        captures: reports,
        rows,
    })
}

/// What every figure of a report rests on.
const PROTOCOL: [&str; 8] = [
    "Values are clipped to [0, 1], white Lambertian facing the lamp = 1; true pictures are divided by their lamp's intensity.",
    "Only pixels inside mask.png with a truth count; pixels a method does not answer are left out of its means and counted.",
    "Where the scale of the truth or of the flash is unknown, every row is multiplied by its best factor (least squares, linear light, one for all lights of a capture); row 1 always is.",
    "Where the scale of the truth is unknown, it is exposed so that 99 % of its values (brightest channel, all lights) lie under 1.",
    "PSNR of a row is the mean over lights of the picture's PSNR; IoU, balanced error and regions are pooled over lights.",
    "si-MSE is taken after the best factor for each picture alone, unclipped.",
    "Shadow truth is shadow_NNN.png, or derived: n·l > 0.2, 3 pixels inside the mask, and darker than 0.3 of the matte brightness (60 % quantile over lights) is cast shadow.",
    "Milliseconds are wall-clock, of this machine and build.",
];

fn machine() -> Machine {
    Machine {
        target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
        threads: rayon::current_num_threads(),
        release_build: !cfg!(debug_assertions),
    }
}

fn summaries(methods: &[&dyn Method], reports: &[CaptureReport]) -> Vec<RowSummary> {
    let present = methods.iter().map(|method| {
        let results: Vec<&RowReport> = reports
            .iter()
            .flat_map(|capture| &capture.rows)
            .filter(|row| row.row == method.row())
            .collect();
        RowSummary {
            row: method.row(),
            name: method.name().to_owned(),
            figures: RowFigures::of(&results),
        }
    });
    let missing = MISSING.iter().map(|(row, name, reason)| RowSummary {
        row: *row,
        name: (*name).to_owned(),
        figures: RowFigures::Missing {
            reason: (*reason).to_owned(),
        },
    });
    present.chain(missing).collect()
}

fn evaluate_capture(
    capture: &Capture,
    options: &EvalOptions,
    methods: &[&dyn Method],
    tell: &mut dyn FnMut(f32),
) -> Result<CaptureReport, EvalError> {
    let (development, stages) = developed(capture, options)?;
    let (width, height) = capture.shot.flash.pixels.size();
    let counts = capture
        .shot
        .mask
        .clone()
        .unwrap_or_else(|| Plane::filled(width, height, true));
    let mut report = CaptureReport {
        name: capture.name.clone(),
        width,
        height,
        counted_pixels: counts.samples().iter().filter(|counts| **counts).count(),
        scale_known: development.scene.scale_known,
        truth_exposure: 1.0,
        shadow_truth: ShadowTruth::Absent,
        stages,
        scene: SceneReport::default(),
        rows: Vec::new(),
        remarks: Vec::new(),
    };
    let Some(truth) = &capture.truth else {
        report
            .remarks
            .push("no truth folder: nothing to compare with".to_owned());
        return Ok(report);
    };
    let grid = |source| EvalError::Grid {
        capture: capture.name.clone(),
        source,
    };
    report.scene = scene_report(&development, truth, &counts)?.map_err(grid)?;
    if truth.lights.is_empty() {
        report
            .remarks
            .push("no lights in truth/lights.toml: relighting is not compared".to_owned());
        return Ok(report);
    }
    report.scale_known &= truth.scale_known;
    let bench = Bench::new(capture, truth, &development, counts)?;
    report.truth_exposure = f64::from(bench.exposure);
    report.shadow_truth = bench.shadow_truth();
    if report.shadow_truth == ShadowTruth::Absent {
        report.remarks.push(
            "no shadow pictures, and too few lights or no true normals to derive them".to_owned(),
        );
    }
    tell(0.2);
    let mut runs: Vec<RowRun<'_>> = methods.iter().map(|method| RowRun::new(*method)).collect();
    let passes = 2 * truth.lights.len();
    for light in 0..truth.lights.len() {
        bench.fit_scales(light, report.scale_known, &mut runs)?;
        tell(0.2 + 0.8 * (light + 1) as f32 / passes as f32);
    }
    for light in 0..truth.lights.len() {
        bench.compare(light, report.scale_known, &mut runs)?;
        tell(0.2 + 0.8 * (truth.lights.len() + light + 1) as f32 / passes as f32);
    }
    for run in runs {
        let name = run.method.name().to_owned();
        match run.report(report.scale_known) {
            Some(row) => report.rows.push(row),
            None => report
                .remarks
                .push(format!("{name}: answered no pixel that counts")),
        }
    }
    Ok(report)
}

/// Develops the shot as often as asked, and times each stage.
fn developed(
    capture: &Capture,
    options: &EvalOptions,
) -> Result<(Development, Vec<StageCost>), EvalError> {
    let mut times: Vec<(Stage, Vec<f64>)> = Vec::new();
    let mut last = None;
    for _ in 0..options.development_runs.max(1) {
        // Let go of the run before, so that only one lies in memory.
        drop(last.take());
        let mut running: Option<(Stage, Instant)> = None;
        let mut end = |running: &mut Option<(Stage, Instant)>| {
            if let Some((stage, began)) = running.take() {
                let milliseconds = began.elapsed().as_secs_f64() * 1e3;
                match times.iter_mut().find(|(known, _)| *known == stage) {
                    Some((_, runs)) => runs.push(milliseconds),
                    None => times.push((stage, vec![milliseconds])),
                }
            }
        };
        let mut observer = |stage: Stage| {
            end(&mut running);
            running = Some((stage, Instant::now()));
        };
        let development = develop::develop(&capture.shot, &options.develop, &mut observer)
            .map_err(|source| EvalError::Develop {
                capture: capture.name.clone(),
                source,
            })?;
        end(&mut running);
        last = Some(development);
    }
    let stages = times
        .into_iter()
        .filter_map(|(stage, runs)| {
            Some(StageCost {
                stage: format!("{stage:?}").to_lowercase(),
                cost: Cost::of(runs)?,
            })
        })
        .collect();
    match last {
        Some(development) => Ok((development, stages)),
        None => unreachable!("the loop above runs at least once"),
    }
}

/// Surfaces against truth; errors of reading outside, of comparing inside.
fn scene_report(
    development: &Development,
    truth: &Truth,
    counts: &Plane<bool>,
) -> Result<Result<SceneReport, GridMismatch>, FolderError> {
    let scene = &development.scene;
    let size = counts.size();
    let (albedo, normal, roughness) = (truth.albedo()?, truth.normal()?, truth.roughness()?);
    let compare = || {
        let mut report = SceneReport {
            albedo_scale: 1.0,
            ..SceneReport::default()
        };
        if let Some(albedo) = albedo {
            let mut found = stretched(&scene.albedo, size).into_owned();
            if !scene.scale_known {
                let mut fit = ScaleFit::default();
                fit.add_picture(&found, &albedo.0, counts);
                report.albedo_scale = fit.scale();
                found = scaled(&found, fit.scale());
            }
            report.albedo = light_error(&found, &albedo.0, counts)?;
        }
        if let Some(normal) = normal {
            report.normal = normal_error(&stretched(&scene.normal, size), &normal, counts)?;
        }
        if let Some(roughness) = roughness {
            report.roughness =
                roughness_error(&stretched(&scene.roughness, size), &roughness, counts)?;
        }
        Ok(report)
    };
    Ok(compare())
}
