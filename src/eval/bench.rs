//! One capture on the bench: its truth laid out, and each row taken through its lights.

use super::cost::percentile;
use super::evaluation::EvalError;
use super::grid::stretched;
use super::light_error::{LightError, light_error};
use super::methods::{Answer, AnswerTime};
use super::photometric::{MatteFit, brightness};
use super::regions::{Regions, Surfaces};
use super::report::{LightReport, ShadowTruth};
use super::row_run::RowRun;
use super::shadow_error::ShadowTally;
use crate::develop::Development;
use crate::folder::{Capture, Truth, TruthLight};
use crate::relight::Lamp;
use drivers::Plane;
use glam::Vec3;
use std::time::Instant;

/// Share of the true pictures' values (brightest channel) that white leaves below it, where
/// the truth's own scale is unknown.
const WHITE_QUANTILE: f64 = 0.99;
/// Most values looked at to find it.
const WHITE_SAMPLES: usize = 4_000_000;
/// Most values held to derive cast shadows from photographs: 1 GiB.
const DERIVATION_VALUES: usize = 1 << 28;

/// A picture multiplied by one factor.
pub(super) fn scaled(light: &Plane<[f32; 3]>, scale: f64) -> Plane<[f32; 3]> {
    light.map(|light| light.map(|value| value * scale as f32))
}

/// What one light should have come out as.
pub(super) struct LitTruth {
    /// At the capture's exposure.
    pub(super) picture: Plane<[f32; 3]>,
    /// 0 = shadow, 1 = lit, NaN = not known.
    shadow: Option<Plane<f32>>,
}

/// One capture laid out for comparing: truth at its exposure, regions, derived shadows.
pub(super) struct Bench<'a> {
    name: &'a str,
    lights: &'a [TruthLight],
    counts: Plane<bool>,
    regions: Regions,
    /// What true pictures are multiplied by.
    pub(super) exposure: f32,
    /// True normals and the matte fit, where shadows are derived.
    derivation: Option<(Plane<Vec3>, MatteFit)>,
}

impl<'a> Bench<'a> {
    /// Looks at every true picture once: white, regions, derived shadows.
    pub(super) fn new(
        capture: &'a Capture,
        truth: &'a Truth,
        development: &Development,
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
            counts,
            regions,
            exposure,
            derivation,
        })
    }

    /// Where the true cast shadows come from.
    pub(super) fn shadow_truth(&self) -> ShadowTruth {
        if self.lights.iter().any(|light| light.shadow.is_some()) {
            ShadowTruth::Given
        } else if self.derivation.is_some() {
            ShadowTruth::Derived
        } else {
            ShadowTruth::Absent
        }
    }

    /// The true picture at its exposure, and the true shadow map.
    pub(super) fn truth(&self, light: usize) -> Result<LitTruth, EvalError> {
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

    /// One row's answer to one light, on the grid of the truth; `None` when it has none.
    pub(super) fn answer(
        &self,
        light: usize,
        run: &mut RowRun<'_>,
    ) -> Result<Option<Answer>, EvalError> {
        let lamp = Lamp::from_person(self.lights[light].toward_person).map_err(|source| {
            EvalError::Light {
                capture: self.name.to_owned(),
                light,
                source,
            }
        })?;
        let began = Instant::now();
        let answer = run.study.relight(light, &lamp);
        let spent = began.elapsed().as_secs_f64() * 1e3;
        let answer = answer.map_err(|source| EvalError::method(self.name, run.row, source))?;
        let Some(answer) = answer else {
            return Ok(None);
        };
        run.milliseconds.extend(match answer.time {
            AnswerTime::Call => Some(spent),
            AnswerTime::Elsewhere(milliseconds) => milliseconds,
        });
        let size = self.counts.size();
        Ok(Some(Answer {
            light: stretched(&answer.light, size).into_owned(),
            shadow: answer
                .shadow
                .map(|shadow| stretched(&shadow, size).into_owned()),
            time: answer.time,
        }))
    }

    /// First pass: adds one light to every row's best scale.
    pub(super) fn fit_scales(
        &self,
        light: usize,
        scale_known: bool,
        runs: &mut [RowRun<'_>],
    ) -> Result<(), EvalError> {
        let mut needing = runs
            .iter_mut()
            .filter(|run| !run.scale_is_known(scale_known))
            .peekable();
        if needing.peek().is_none() {
            return Ok(());
        }
        let truth = self.truth(light)?.picture;
        for run in needing {
            if let Some(answer) = self.answer(light, run)? {
                run.fit.add_picture(&answer.light, &truth, &self.counts);
            }
        }
        Ok(())
    }

    /// Second pass: compares every row under one light.
    pub(super) fn compare(
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
            let Some(answer) = self.answer(light, run)? else {
                run.absent_lights += 1;
                continue;
            };
            let found = scaled(&answer.light, run.scale(scale_known));
            let error: Option<LightError> =
                light_error(&found, &truth, &self.counts).map_err(grid)?;
            let tally = answer
                .shadow
                .as_ref()
                .zip(true_shadow.as_ref())
                .map(|(found, truth)| ShadowTally::of(found, truth, &self.counts))
                .transpose()
                .map_err(grid)?
                .unwrap_or_default();
            run.shadows.add(&tally);
            self.regions
                .tally(&mut run.regions, &found, &truth, true_shadow.as_ref());
            match error {
                Some(error) => run.lights.push(LightReport {
                    light,
                    direction: self.lights[light].toward_person,
                    error,
                    shadow: tally.error(),
                }),
                None => run.absent_lights += 1,
            }
        }
        Ok(())
    }
}
