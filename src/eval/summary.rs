//! The rows of the table: each method's figures over all captures, or why there are none.

use super::directions::{WorstDirection, lights_of};
use super::light_error::Decibel;
use super::report::{CaptureReport, LightReport, MeanError, RowReport, SilentRow};
use super::roster::Row;
use serde::Serialize;

/// One row of the table that stands in every report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowSummary {
    /// Its number, as in [`super::methods::Method::row`].
    pub row: u8,
    /// As in [`super::roster::Row::label`].
    pub label: String,
    /// Its name.
    pub name: String,
    /// Numbers that training set, of all networks that it may ask; `None` where nobody knows.
    pub parameters: Option<u64>,
    /// What runs its networks, where it has any.
    pub backend: Option<String>,
    /// Its figures, or why there are none.
    #[serde(flatten)]
    pub figures: RowFigures,
    /// The same with noise on the depth, where that was asked for.
    pub noisy: Option<RowFigures>,
}

/// A row's figures over all captures.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum RowFigures {
    /// It was run.
    Present(Box<Figures>),
    /// It was not run.
    Missing {
        /// Why.
        reason: String,
    },
}

/// Means over the captures that a row answered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// Captures it answered.
    pub captures: usize,
    /// Captures with truth that it did not answer.
    pub absent_captures: usize,
    /// Lights of the captures it answered that it did not answer, or no pixel of; 0 for a row
    /// that relights nothing.
    pub absent_lights: usize,
    /// Means over captures of the means over lights; `None` for a row that relights nothing.
    pub mean: Option<MeanError>,
    /// Lowest PSNR in linear light over all captures and lights.
    pub worst_linear_psnr_db: Option<Decibel>,
    /// The part of the hemisphere of lowest mean PSNR, over the lights of all captures.
    pub worst_direction: Option<WorstDirection>,
    /// Mean over captures of the pooled shadow IoU, where there is shadow truth.
    pub shadow_iou: Option<f64>,
    /// Mean over captures of the shadow MSE, where there is shadow truth.
    pub shadow_mse: Option<f64>,
    /// Mean over captures of the median milliseconds per relit picture.
    pub relight_ms: Option<f64>,
    /// Means over captures, where there is such truth and such an answer.
    pub surfaces: SurfaceMeans,
}

/// Mean squared errors of surfaces, means over captures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "as in SceneReport")]
pub struct SurfaceMeans {
    pub albedo_linear_mse: Option<f64>,
    pub albedo_srgb_mse: Option<f64>,
    pub normal_unsigned_mse: Option<f64>,
    pub normal_signed_mse: Option<f64>,
    pub normal_mean_degrees: Option<f64>,
    pub roughness_mse: Option<f64>,
}

impl RowSummary {
    pub(super) fn of(row: &Row, figures: RowFigures, noisy: Option<RowFigures>) -> Self {
        let networks = row
            .method
            .as_ref()
            .ok()
            .and_then(|method| method.networks());
        let networks = networks.as_deref();
        Self {
            row: row.number,
            label: row.label.clone(),
            name: row.name.clone(),
            parameters: networks.map(|all| all.iter().map(|one| one.parameters).sum()),
            backend: networks.and_then(|all| Some(all.first()?.backend.clone())),
            figures,
            noisy,
        }
    }
}

impl RowFigures {
    /// The figures, where there are any.
    pub fn present(&self) -> Option<&Figures> {
        match self {
            Self::Present(figures) => Some(figures),
            Self::Missing { .. } => None,
        }
    }

    /// Averages one row's results over captures.
    pub(super) fn of(row: &Row, captures: &[CaptureReport]) -> Self {
        if let Err(reason) = &row.method {
            return Self::Missing {
                reason: reason.clone(),
            };
        }
        let of_row = |label: &String| *label == row.label;
        let results: Vec<&RowReport> = captures
            .iter()
            .flat_map(|capture| &capture.rows)
            .filter(|result| of_row(&result.label))
            .collect();
        let silent: Vec<&SilentRow> = captures
            .iter()
            .flat_map(|capture| &capture.silent)
            .filter(|silent| of_row(&silent.label))
            .collect();
        if results.is_empty() {
            let reason = match silent.first() {
                Some(silent) => silent.reason.clone(),
                None => "no capture has truth for it".to_owned(),
            };
            return Self::Missing { reason };
        }
        let lights = lights_of(captures, &row.label);
        Self::Present(Box::new(Figures::of(&results, &lights, silent.len())))
    }
}

impl Figures {
    /// Of at least one result.
    fn of(results: &[&RowReport], lights: &[(&str, &LightReport)], absent_captures: usize) -> Self {
        let relit = || results.iter().filter_map(|row| row.relit.as_ref());
        let worst = relit()
            .map(|relit| relit.worst.linear_psnr_db.0)
            .min_by(f64::total_cmp);
        let shadows = || relit().filter_map(|relit| relit.shadow);
        let absent = results.iter().map(|row| row.absent_lights).sum();
        let surfaces = || results.iter().map(|row| &row.surfaces);
        let albedo = || surfaces().filter_map(|scene| scene.albedo);
        let normal = || surfaces().filter_map(|scene| scene.normal);
        let roughness = surfaces().filter_map(|scene| scene.roughness);
        Self {
            captures: results.len(),
            absent_captures,
            absent_lights: if worst.is_some() { absent } else { 0 },
            mean: MeanError::of_captures(relit().map(|relit| &relit.mean)),
            worst_linear_psnr_db: worst.map(Decibel),
            worst_direction: WorstDirection::of(lights),
            shadow_iou: mean(shadows().filter_map(|shadow| shadow.iou)),
            shadow_mse: mean(shadows().map(|shadow| shadow.mse)),
            relight_ms: mean(relit().filter_map(|relit| Some(relit.relight?.median_ms))),
            surfaces: SurfaceMeans {
                albedo_linear_mse: mean(albedo().map(|error| error.linear_mse)),
                albedo_srgb_mse: mean(albedo().map(|error| error.srgb_mse)),
                normal_unsigned_mse: mean(normal().map(|error| error.unsigned_mse)),
                normal_signed_mse: mean(normal().map(|error| error.signed_mse)),
                normal_mean_degrees: mean(normal().map(|error| error.mean_degrees)),
                roughness_mse: mean(roughness.map(|error| error.mse)),
            },
        }
    }

    /// What is missing from the means, in words; `None` when nothing is.
    pub fn shortfall(&self) -> Option<String> {
        let counted = |number: usize, what: &str| {
            let plural = if number == 1 { "" } else { "s" };
            (number > 0).then(|| format!("{number} {what}{plural}"))
        };
        let missing = [
            counted(self.absent_captures, "capture"),
            counted(self.absent_lights, "light"),
        ];
        let missing: Vec<String> = missing.into_iter().flatten().collect();
        (!missing.is_empty()).then(|| format!("no answer for {}", missing.join(" and ")))
    }
}

/// Arithmetic mean; `None` without a value.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, number) = values.fold((0.0, 0_usize), |(sum, number), value| {
        (sum + value, number + 1)
    });
    (number > 0).then(|| sum / number as f64)
}
