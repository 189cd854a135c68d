//! Captures with truth → [`Report`].

use super::cost::{Cost, percentile};
use super::grid::stretched;
use super::light_error::{GridMismatch, LightError, ScaleFit, light_error};
use super::methods::{Answer, ClosedForm, DoNothing, MISSING, Matte, Method};
use super::photometric::{MatteFit, brightness};
use super::regions::{RegionSums, Regions, Surfaces};
use super::report::{
    CaptureReport, LightReport, Machine, MeanError, Report, RowFigures, RowReport, RowSummary,
    SceneReport, ShadowTruth, StageCost, WorstLight,
};
use super::shadow_error::ShadowTally;
use super::surface_error::{normal_error, roughness_error};
use crate::develop::{self, DevelopError, Development, Stage};
use crate::folder::{Capture, FolderError, Truth, TruthLight};
use crate::relight::{Lamp, LampError, RelightOptions};
use drivers::Plane;
use glam::Vec3;
use std::time::Instant;
use thiserror::Error;

/// Share of the true pictures' values (brightest channel) that white leaves below it, where
/// the truth's own scale is unknown.
const WHITE_QUANTILE: f64 = 0.99;
/// Most values looked at to find it.
const WHITE_SAMPLES: usize = 4_000_000;
/// Most values held to derive cast shadows from photographs: 1 GiB.
const DERIVATION_VALUES: usize = 1 << 28;

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

fn scaled(light: &Plane<[f32; 3]>, scale: f64) -> Plane<[f32; 3]> {
    light.map(|light| light.map(|value| value * scale as f32))
}

/// What one light should have come out as.
struct LitTruth {
    /// At the capture's exposure.
    picture: Plane<[f32; 3]>,
    /// 0 = shadow, 1 = lit, NaN = not known.
    shadow: Option<Plane<f32>>,
}

/// One row on its way through the lights of a capture.
struct RowRun<'a> {
    method: &'a dyn Method,
    fit: ScaleFit,
    milliseconds: Vec<f64>,
    lights: Vec<LightReport>,
    shadows: ShadowTally,
    regions: RegionSums,
}

impl<'a> RowRun<'a> {
    fn new(method: &'a dyn Method) -> Self {
        Self {
            method,
            fit: ScaleFit::default(),
            milliseconds: Vec::new(),
            lights: Vec::new(),
            shadows: ShadowTally::default(),
            regions: RegionSums::default(),
        }
    }

    /// The factor its pictures are multiplied by.
    fn scale(&self, scale_known: bool) -> f64 {
        if scale_known && !self.method.scale_is_free() {
            1.0
        } else {
            self.fit.scale()
        }
    }

    /// What it came to; `None` when no light could be compared.
    fn report(self, scale_known: bool) -> Option<RowReport> {
        let errors = || self.lights.iter().map(|light| &light.error);
        let worst = self.lights.iter().min_by(|a, b| {
            a.error
                .linear_psnr_db
                .0
                .total_cmp(&b.error.linear_psnr_db.0)
        })?;
        Some(RowReport {
            row: self.method.row(),
            name: self.method.name().to_owned(),
            scale: self.scale(scale_known),
            mean: MeanError::of_lights(errors())?,
            worst: WorstLight {
                light: worst.light,
                direction: worst.direction,
                linear_psnr_db: worst.error.linear_psnr_db,
                srgb_psnr_db: worst.error.srgb_psnr_db,
            },
            shadow: self.shadows.error(),
            regions: self.regions.errors(),
            relight: Cost::of(self.milliseconds),
            lights: self.lights,
        })
    }
}

/// One capture laid out for comparing: truth at its exposure, regions, derived shadows.
struct Bench<'a> {
    name: &'a str,
    lights: &'a [TruthLight],
    development: &'a Development,
    counts: Plane<bool>,
    regions: Regions,
    exposure: f32,
    /// True normals and the matte fit, where shadows are derived.
    derivation: Option<(Plane<Vec3>, MatteFit)>,
}

impl<'a> Bench<'a> {
    fn new(
        capture: &'a Capture,
        truth: &'a Truth,
        development: &'a Development,
        counts: Plane<bool>,
    ) -> Result<Self, EvalError> {
        let lights = &truth.lights;
        let given = lights.iter().any(|light| light.shadow.is_some());
        let normal = truth
            .normal()?
            .filter(|_| !given && counts.len().saturating_mul(lights.len()) <= DERIVATION_VALUES);
        let mut photographs = Vec::new();
        let mut whites = Vec::new();
        let stride = (counts.len() * lights.len() / WHITE_SAMPLES).max(1);
        for light in lights {
            let (picture, _) = light.load()?;
            if !truth.scale_known {
                let values = picture
                    .0
                    .samples()
                    .iter()
                    .zip(counts.samples())
                    .step_by(stride);
                whites.extend(
                    values
                        .filter(|(_, counts)| **counts)
                        .filter_map(|(light, _)| {
                            let brightest = light.iter().copied().fold(f32::NAN, f32::max);
                            brightest.is_finite().then_some(f64::from(brightest))
                        }),
                );
            }
            if normal.is_some() {
                photographs.push((light.toward_light(), brightness(&picture.0)));
            }
        }
        let white = percentile(&mut whites, WHITE_QUANTILE).filter(|white| *white > 0.0);
        let exposure = white.map_or(1.0, |white| (1.0 / white) as f32);
        let derivation = normal.and_then(|normal| {
            let fit = MatteFit::new(&normal, &photographs, &counts)?;
            Some((normal, fit))
        });
        let albedo = match (truth.albedo()?, &derivation) {
            (Some(albedo), _) => Some(brightness(&albedo.0)),
            (None, Some((_, fit))) => Some(fit.reflectance().map(|value| value * exposure)),
            (None, None) => None,
        };
        let roughness = truth.roughness()?;
        let depth = match truth.depth()? {
            Some(depth) => Some(depth),
            None => truth.registered_depth()?,
        };
        let surfaces = Surfaces {
            depth_metres: depth.as_ref().or(Some(&development.registered.metres)),
            roughness: roughness.as_ref(),
            albedo: albedo.as_ref(),
        };
        let regions = Regions::new(&surfaces, &counts);
        Ok(Self {
            name: &capture.name,
            lights,
            development,
            counts,
            regions,
            exposure,
            derivation,
        })
    }

    fn shadow_truth(&self) -> ShadowTruth {
        if self.lights.iter().any(|light| light.shadow.is_some()) {
            ShadowTruth::Given
        } else if self.derivation.is_some() {
            ShadowTruth::Derived
        } else {
            ShadowTruth::Absent
        }
    }

    /// The true picture at its exposure, and the true shadow map.
    fn truth(&self, light: usize) -> Result<LitTruth, EvalError> {
        let light = &self.lights[light];
        let (picture, given) = light.load()?;
        let shadow = given.or_else(|| {
            let (normal, fit) = self.derivation.as_ref()?;
            Some(fit.cast_shadow(normal, light.toward_light(), &brightness(&picture.0)))
        });
        Ok(LitTruth {
            picture: scaled(&picture.0, f64::from(self.exposure)),
            shadow,
        })
    }

    fn answer(&self, light: usize, run: &mut RowRun<'_>) -> Result<Answer, EvalError> {
        let lamp = Lamp::from_person(self.lights[light].toward_person).map_err(|source| {
            EvalError::Light {
                capture: self.name.to_owned(),
                light,
                source,
            }
        })?;
        let began = Instant::now();
        let answer = run.method.relight(self.development, &lamp);
        run.milliseconds.push(began.elapsed().as_secs_f64() * 1e3);
        let size = self.counts.size();
        Ok(Answer {
            light: stretched(&answer.light, size).into_owned(),
            shadow: stretched(&answer.shadow, size).into_owned(),
        })
    }

    fn fit_scales(
        &self,
        light: usize,
        scale_known: bool,
        runs: &mut [RowRun<'_>],
    ) -> Result<(), EvalError> {
        let truth = self.truth(light)?.picture;
        for run in runs
            .iter_mut()
            .filter(|run| !scale_known || run.method.scale_is_free())
        {
            let answer = self.answer(light, run)?;
            run.fit.add_picture(&answer.light, &truth, &self.counts);
        }
        Ok(())
    }

    fn compare(
        &self,
        light: usize,
        scale_known: bool,
        runs: &mut [RowRun<'_>],
    ) -> Result<(), EvalError> {
        let grid = |source| EvalError::Grid {
            capture: self.name.to_owned(),
            source,
        };
        let LitTruth {
            picture: truth,
            shadow: true_shadow,
        } = self.truth(light)?;
        for run in runs {
            let answer = self.answer(light, run)?;
            let found = scaled(&answer.light, run.scale(scale_known));
            let error: Option<LightError> =
                light_error(&found, &truth, &self.counts).map_err(grid)?;
            let tally = true_shadow
                .as_ref()
                .map(|shadow| ShadowTally::of(&answer.shadow, shadow, &self.counts))
                .transpose()
                .map_err(grid)?
                .unwrap_or_default();
            run.shadows.add(&tally);
            self.regions
                .tally(&mut run.regions, &found, &truth, true_shadow.as_ref());
            if let Some(error) = error {
                let direction = self.lights[light].toward_person;
                run.lights.push(LightReport {
                    light,
                    direction,
                    error,
                    shadow: tally.error(),
                });
            }
        }
        Ok(())
    }
}
