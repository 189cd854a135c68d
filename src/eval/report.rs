//! What an evaluation found: one report over captures, rows (methods) and lights.

use super::beside::OtherBackend;
use super::cost::Cost;
use super::light_error::{Decibel, LightError};
use super::light_sets::LightSetRun;
use super::made::Made;
use super::ours::Chosen;
use super::published::Published;
use super::regions::RegionError;
use super::shadow_error::ShadowError;
use super::stability::StabilityReport;
use super::summary::{RowSummary, mean};
use super::surface_error::{NormalError, RoughnessError};
use crate::corruption::DepthNoise;
use serde::{Deserialize, Serialize};

/// Everything one run of `eval` measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Version of this layout.
    pub format: u32,
    /// How the numbers were made, in words.
    pub protocol: Vec<String>,
    /// When and by what they were made.
    pub made: Made,
    /// Where they were made.
    pub machine: Machine,
    /// One entry per capture, with the depth as it is.
    pub captures: Vec<CaptureReport>,
    /// The same captures with noise on the depth, where that was asked for.
    pub noisy: Option<NoisyReport>,
    /// The rows of every table, those that are missing too, averaged over captures.
    pub rows: Vec<RowSummary>,
    /// Rows of networks as another backend ran them, from a report beside this one.
    pub other_backends: Vec<OtherBackend>,
    /// What captures made worse cost each row, where that was asked for.
    pub stability: Option<StabilityReport>,
    /// Sets of lights for environment maps, where they were compared.
    pub light_sets: Vec<LightSetRun>,
    /// What the reference method's authors printed, of other data.
    pub published: Vec<Published>,
}

/// Captures with noise on their depth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoisyReport {
    /// The noise.
    pub noise: DepthNoise,
    /// Its seed; each capture's noise follows from it and the capture's name.
    pub seed: u64,
    /// One entry per capture, in the order of [`Report::captures`].
    pub captures: Vec<CaptureReport>,
}

impl Report {
    /// Names of the captures, in their order.
    pub fn capture_names(&self) -> Vec<&str> {
        let names = self.captures.iter().map(|capture| capture.name.as_str());
        names.collect()
    }
}

/// The machine behind the milliseconds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// What the processor calls itself; `None` where the system does not say.
    pub processor: Option<String>,
    /// Processor architecture and system, e.g. `x86_64-linux`.
    pub target: String,
    /// Threads the data-parallel loops ran on.
    pub threads: usize,
    /// False when the program was built without optimisation's last step, so that its
    /// milliseconds only compare with each other.
    pub release_build: bool,
}

/// Where the true cast shadows come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShadowTruth {
    /// `shadow_NNN.png` in the capture folder.
    Given,
    /// Photographs far darker than a matte surface facing the lamp would be.
    Derived,
    /// There is none.
    Absent,
}

/// One capture's results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaptureReport {
    /// Name of its folder.
    pub name: String,
    /// Pixels per row.
    pub width: usize,
    /// Rows of pixels.
    pub height: usize,
    /// Pixels inside the mask.
    pub counted_pixels: usize,
    /// False when every row was compared after its best global scale.
    pub scale_known: bool,
    /// What the true pictures were multiplied by so that white is 1; 1 where the scale is known.
    pub truth_exposure: f64,
    /// Where the true cast shadows come from.
    pub shadow_truth: ShadowTruth,
    /// Milliseconds per stage of the road from shot to scene, in their order.
    pub stages: Vec<StageCost>,
    /// The developed scene against the truth.
    pub scene: SceneReport,
    /// The rows that answered.
    pub rows: Vec<RowReport>,
    /// The rows that did not.
    pub silent: Vec<SilentRow>,
    /// What could not be measured on this capture, and why.
    pub remarks: Vec<String>,
}

/// What one stage of the road cost.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageCost {
    /// The stage's name.
    pub stage: String,
    /// Its time.
    pub cost: Cost,
}

/// Estimated surfaces against true ones; `None` where the capture has no such truth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneReport {
    /// Diffuse albedo.
    pub albedo: Option<LightError>,
    /// What albedo was multiplied by before comparing; 1 where the scale is known.
    pub albedo_scale: f64,
    /// Normals.
    pub normal: Option<NormalError>,
    /// Roughness.
    pub roughness: Option<RoughnessError>,
}

/// A method that said nothing about a capture.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SilentRow {
    /// As in [`super::roster::Row::label`].
    pub label: String,
    /// Why.
    pub reason: String,
}

impl SceneReport {
    /// Whether nothing was compared.
    pub fn is_empty(&self) -> bool {
        self.albedo.is_none() && self.normal.is_none() && self.roughness.is_none()
    }
}

/// One method on one capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RowReport {
    /// Its number, as in [`super::methods::Method::row`].
    pub row: u8,
    /// As in [`super::roster::Row::label`].
    pub label: String,
    /// Its name.
    pub name: String,
    /// What it takes the scene to be made of, against the truth.
    pub surfaces: SceneReport,
    /// Lights of the truth that it did not answer, or answered no pixel of.
    pub absent_lights: usize,
    /// The terms it modelled the capture with, where it chose them.
    pub terms: Option<Chosen>,
    /// Its pictures against the truth; `None` when it answered no light.
    #[serde(flatten)]
    pub relit: Option<RelitReport>,
}

/// One method's relit pictures of one capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RelitReport {
    /// The one factor, over all lights, that its pictures were multiplied by.
    pub scale: f64,
    /// Means over the lights.
    pub mean: MeanError,
    /// The light of lowest PSNR in linear light.
    pub worst: WorstLight,
    /// Shadows over all lights together.
    pub shadow: Option<ShadowError>,
    /// By region, pooled over the lights.
    pub regions: Vec<RegionError>,
    /// One picture under one new light.
    pub relight: Option<Cost>,
    /// By light.
    pub lights: Vec<LightReport>,
}

/// Means over lights (or, in [`super::summary::RowFigures`], over captures of those means).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeanError {
    /// Of [`LightError::linear_mse`].
    pub linear_mse: f64,
    /// Of [`LightError::linear_psnr_db`].
    pub linear_psnr_db: Decibel,
    /// Of [`LightError::srgb_mse`].
    pub srgb_mse: f64,
    /// Of [`LightError::srgb_psnr_db`].
    pub srgb_psnr_db: Decibel,
    /// Of [`LightError::srgb_ssim`], over the pictures that have one.
    pub srgb_ssim: Option<f64>,
    /// Of [`LightError::scale_invariant_mse`].
    pub scale_invariant_mse: f64,
    /// Fraction of the pixels with a truth that were answered.
    pub answered_fraction: f64,
}

impl MeanError {
    /// The mean over pictures; `None` without one.
    pub(super) fn of_lights<'a>(
        lights: impl Iterator<Item = &'a LightError> + Clone,
    ) -> Option<Self> {
        let answered: usize = lights.clone().map(|light| light.pixels).sum();
        let unanswered: usize = lights.clone().map(|light| light.unanswered).sum();
        Some(Self {
            linear_mse: mean(lights.clone().map(|light| light.linear_mse))?,
            linear_psnr_db: Decibel(mean(lights.clone().map(|light| light.linear_psnr_db.0))?),
            srgb_mse: mean(lights.clone().map(|light| light.srgb_mse))?,
            srgb_psnr_db: Decibel(mean(lights.clone().map(|light| light.srgb_psnr_db.0))?),
            srgb_ssim: mean(lights.clone().filter_map(|light| light.srgb_ssim)),
            scale_invariant_mse: mean(lights.map(|light| light.scale_invariant_mse))?,
            answered_fraction: answered as f64 / (answered + unanswered).max(1) as f64,
        })
    }

    /// The mean of means; `None` without one.
    pub(super) fn of_captures<'a>(
        captures: impl Iterator<Item = &'a Self> + Clone,
    ) -> Option<Self> {
        Some(Self {
            linear_mse: mean(captures.clone().map(|one| one.linear_mse))?,
            linear_psnr_db: Decibel(mean(captures.clone().map(|one| one.linear_psnr_db.0))?),
            srgb_mse: mean(captures.clone().map(|one| one.srgb_mse))?,
            srgb_psnr_db: Decibel(mean(captures.clone().map(|one| one.srgb_psnr_db.0))?),
            srgb_ssim: mean(captures.clone().filter_map(|one| one.srgb_ssim)),
            scale_invariant_mse: mean(captures.clone().map(|one| one.scale_invariant_mse))?,
            answered_fraction: mean(captures.map(|one| one.answered_fraction))?,
        })
    }
}

/// The light a method did worst under.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WorstLight {
    /// Index among the capture's lights.
    pub light: usize,
    /// Toward the light; x right, y up, z toward the camera.
    pub direction: [f32; 3],
    /// PSNR in linear light.
    pub linear_psnr_db: Decibel,
    /// PSNR in sRGB.
    pub srgb_psnr_db: Decibel,
}

/// One method under one light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LightReport {
    /// Index among the capture's lights.
    pub light: usize,
    /// Toward the light, unit length; x right, y up, z toward the camera.
    pub direction: [f32; 3],
    /// The picture's error.
    pub error: LightError,
    /// The shadow's error.
    pub shadow: Option<ShadowError>,
}

impl LightReport {
    /// Angle between the light and the camera's axis, degrees.
    pub fn off_axis_degrees(&self) -> f64 {
        let [x, y, z] = self.direction.map(f64::from);
        x.hypot(y).atan2(z).to_degrees()
    }
}
