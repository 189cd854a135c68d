//! One capture taken through every row.

use super::bench::{Bench, scaled};
use super::cost::Cost;
use super::evaluation::{EvalError, EvalOptions};
use super::grid::stretched;
use super::light_error::{GridMismatch, ScaleFit, light_error};
use super::methods::{DepthGiven, MethodError, Subject, SurfaceAnswer, of_scene};
use super::report::{CaptureReport, SceneReport, ShadowTruth, SilentRow, StageCost};
use super::roster::Roster;
use super::row_run::RowRun;
use super::surface_error::{normal_error, roughness_error};
use crate::develop::{self, Development, Stage};
use crate::folder::{Capture, FolderError, Truth};
use crate::radiometry::LinearImage;
use drivers::Plane;
use glam::Vec3;
use std::time::Instant;

/// Develops the capture, compares the surfaces of every row, and its pictures light by light.
/// `tell` is told the fraction done.
pub(super) fn evaluate_capture(
    capture: &Capture,
    depth: DepthGiven,
    roster: &Roster,
    options: &EvalOptions,
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
        silent: Vec::new(),
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
    let surfaces = TrueSurfaces::read(truth, development.scene.scale_known)?;
    report.scene = surfaces
        .compare(&of_scene(&development), &counts, surfaces.scale_known)
        .map_err(grid)?;
    let subject = Subject {
        capture,
        development: &development,
        depth,
    };
    let (mut runs, silent) = studied(roster, subject)?;
    report.silent = silent;
    let found = runs.iter().map(|run| {
        let scale_known = run.scale_is_known(surfaces.scale_known);
        surfaces.compare(&run.study.surfaces(), &counts, scale_known)
    });
    let found: Vec<SceneReport> = found.collect::<Result<_, _>>().map_err(grid)?;
    report.scale_known &= truth.scale_known;
    tell(0.2);
    if truth.lights.is_empty() {
        report
            .remarks
            .push("no lights in truth/lights.toml: relighting is not compared".to_owned());
    } else {
        relight(&mut report, &mut runs, subject, truth, counts, tell)?;
    }
    for (run, surfaces) in runs.into_iter().zip(found) {
        let label = run.row.label.clone();
        match run.report(report.scale_known, surfaces) {
            Some(row) => report.rows.push(row),
            None if truth.lights.is_empty() => {}
            None => report.silent.push(SilentRow {
                label,
                reason: "answered no pixel that counts".to_owned(),
            }),
        }
    }
    Ok(report)
}

/// Has every method look at the capture; those with nothing to say, with their reasons.
pub(super) fn studied<'a>(
    roster: &'a Roster,
    subject: Subject<'a>,
) -> Result<(Vec<RowRun<'a>>, Vec<SilentRow>), EvalError> {
    let mut runs = Vec::new();
    let mut silent = Vec::new();
    for row in roster.rows() {
        let Ok(method) = &row.method else {
            continue;
        };
        match method.study(subject) {
            Ok(study) => runs.push(RowRun::new(row, method.scale_is_free(), study)),
            Err(MethodError::Silent(reason)) => silent.push(SilentRow {
                label: row.label.clone(),
                reason,
            }),
            // What was broken on purpose may break a method, too.
            Err(source) if subject.depth == DepthGiven::Spoiled => silent.push(SilentRow {
                label: row.label.clone(),
                reason: source.to_string(),
            }),
            Err(source) => return Err(EvalError::method(&subject.capture.name, row, source)),
        }
    }
    Ok((runs, silent))
}

/// Takes every row through every light, twice: for its best scale, and to compare.
fn relight(
    report: &mut CaptureReport,
    runs: &mut [RowRun<'_>],
    subject: Subject<'_>,
    truth: &Truth,
    counts: Plane<bool>,
    tell: &mut dyn FnMut(f32),
) -> Result<(), EvalError> {
    let bench = Bench::new(subject.capture, truth, subject.development, counts)?;
    report.truth_exposure = f64::from(bench.exposure);
    report.shadow_truth = bench.shadow_truth();
    if report.shadow_truth == ShadowTruth::Absent {
        report.remarks.push(
            "no shadow pictures, and too few lights or no true normals to derive them".to_owned(),
        );
    }
    let lights = truth.lights.len();
    let done = |passed: usize| 0.2 + 0.8 * passed as f32 / (2 * lights) as f32;
    for light in 0..lights {
        bench.fit_scales(light, report.scale_known, runs)?;
        tell(done(light + 1));
    }
    for light in 0..lights {
        bench.compare(light, report.scale_known, runs)?;
        tell(done(lights + light + 1));
    }
    Ok(())
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

/// The surfaces of the truth, read once for all rows.
struct TrueSurfaces {
    albedo: Option<LinearImage>,
    normal: Option<Plane<Vec3>>,
    roughness: Option<Plane<f32>>,
    /// False when nobody knows the scale of albedo.
    scale_known: bool,
}

impl TrueSurfaces {
    fn read(truth: &Truth, scale_known: bool) -> Result<Self, FolderError> {
        Ok(Self {
            albedo: truth.albedo()?,
            normal: truth.normal()?,
            roughness: truth.roughness()?,
            scale_known,
        })
    }

    /// Compares what is in both, albedo after its best scale unless that is known.
    fn compare(
        &self,
        found: &SurfaceAnswer<'_>,
        counts: &Plane<bool>,
        scale_known: bool,
    ) -> Result<SceneReport, GridMismatch> {
        let size = counts.size();
        let mut report = SceneReport {
            albedo_scale: 1.0,
            ..SceneReport::default()
        };
        if let (Some(found), Some(truth)) = (&found.albedo, &self.albedo) {
            let mut found = stretched(found, size).into_owned();
            if !scale_known {
                let mut fit = ScaleFit::default();
                fit.add_picture(&found, &truth.0, counts);
                report.albedo_scale = fit.scale();
                found = scaled(&found, fit.scale());
            }
            report.albedo = light_error(&found, &truth.0, counts)?;
        }
        if let (Some(found), Some(truth)) = (&found.normal, &self.normal) {
            report.normal = normal_error(&stretched(found, size), truth, counts)?;
        }
        if let (Some(found), Some(truth)) = (&found.roughness, &self.roughness) {
            report.roughness = roughness_error(&stretched(found, size), truth, counts)?;
        }
        Ok(report)
    }
}
