//! How far a picture is from the true one: MSE, PSNR, SSIM and scale-invariant MSE.

use super::ssim::similarity;
use drivers::Plane;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

/// Two planes that should lie on one grid do not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "{what}: {found:?} pixels were answered but the truth has {truth:?}; \
     give truth on the color camera's grid"
)]
pub struct GridMismatch {
    /// Which quantity.
    pub what: &'static str,
    /// `(width, height)` of the answer.
    pub found: (usize, usize),
    /// `(width, height)` of the truth or mask.
    pub truth: (usize, usize),
}

/// Fails unless all sizes are that of `found`.
pub(super) fn same_grid(
    what: &'static str,
    found: (usize, usize),
    others: &[(usize, usize)],
) -> Result<(), GridMismatch> {
    match others.iter().find(|other| **other != found) {
        Some(&truth) => Err(GridMismatch { what, found, truth }),
        None => Ok(()),
    }
}

/// Peak signal-to-noise ratio, `10 log10(1 / MSE)` for values in [0, 1]; +∞ for equal pictures.
///
/// Written to JSON as a number, or as the text `"inf"`, which JSON has no number for.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Decibel(pub f64);

impl Decibel {
    /// From a mean squared error of values whose peak is 1.
    pub fn from_mse(mse: f64) -> Self {
        Self(-10.0 * mse.log10())
    }
}

impl Serialize for Decibel {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0.is_finite() {
            serializer.serialize_f64(self.0)
        } else {
            serializer.serialize_str(&self.to_string())
        }
    }
}

impl<'de> Deserialize<'de> for Decibel {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Number(f64),
            Text(String),
        }
        match Written::deserialize(deserializer)? {
            Written::Number(decibel) => Ok(Self(decibel)),
            Written::Text(text) if text == "inf" => Ok(Self(f64::INFINITY)),
            Written::Text(text) => Err(serde::de::Error::custom(format!("\"{text}\" dB"))),
        }
    }
}

impl std::fmt::Display for Decibel {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0 == f64::INFINITY {
            formatter.pad("inf")
        } else {
            formatter.pad(&format!("{:.2}", self.0))
        }
    }
}

/// The error of one picture (relit light or albedo) against its truth.
///
/// Both are clipped to [0, 1] first, white Lambertian = 1.0. Means run over the three channels of
/// the pixels that count, that have a truth and that were answered.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LightError {
    /// Mean squared error in linear light.
    pub linear_mse: f64,
    /// PSNR in linear light.
    pub linear_psnr_db: Decibel,
    /// Mean squared error after the sRGB curve (IEC 61966-2-1).
    pub srgb_mse: f64,
    /// PSNR after the sRGB curve.
    pub srgb_psnr_db: Decibel,
    /// Structural similarity after the sRGB curve (Wang et al. 2004); `None` on pictures smaller
    /// than its window.
    pub srgb_ssim: Option<f64>,
    /// Mean squared error in linear light after the best scale for this picture alone, not clipped:
    /// min over s of mean (s·found − truth)².
    pub scale_invariant_mse: f64,
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that count and have a truth, but were not answered (NaN); not in the means.
    pub unanswered: usize,
}

/// Compares two pictures where `counts` is true; `None` when no pixel can be compared.
///
/// # Errors
/// [`GridMismatch`] when the three planes do not share one size.
pub fn light_error(
    found: &Plane<[f32; 3]>,
    truth: &Plane<[f32; 3]>,
    counts: &Plane<bool>,
) -> Result<Option<LightError>, GridMismatch> {
    same_grid("light", found.size(), &[truth.size(), counts.size()])?;
    let (compared, unanswered) = comparable(found, truth, counts);
    let mut sums = SquaredError::default();
    let mut fit = ScaleFit::default();
    for ((found, truth), _) in found
        .samples()
        .iter()
        .zip(truth.samples())
        .zip(compared.samples())
        .filter(|(_, on)| **on)
    {
        sums.add(found, truth);
        fit.add(found, truth);
    }
    let Some((linear_mse, srgb_mse)) = sums.means() else {
        return Ok(None);
    };
    Ok(Some(LightError {
        linear_mse,
        linear_psnr_db: Decibel::from_mse(linear_mse),
        srgb_mse,
        srgb_psnr_db: Decibel::from_mse(srgb_mse),
        srgb_ssim: similarity(&encoded(found), &encoded(truth), &compared),
        scale_invariant_mse: fit.residual_mse(),
        pixels: sums.pixels,
        unanswered,
    }))
}

/// Squared differences in linear light alone, which cost a fiftieth of [`light_error`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct LinearError {
    squares: f64,
    /// Pixels compared.
    pub(super) pixels: usize,
    /// Pixels that count and have a truth, but were not answered.
    pub(super) unanswered: usize,
}

impl LinearError {
    /// Of a picture times `scale`, where `counts` is true; all planes have one size.
    pub(super) fn of(
        found: &Plane<[f32; 3]>,
        scale: f64,
        truth: &Plane<[f32; 3]>,
        counts: &Plane<bool>,
    ) -> Self {
        let mut error = Self::default();
        let pixels = found.samples().iter().zip(truth.samples());
        for ((found, truth), counts) in pixels.zip(counts.samples()) {
            let known = |light: &[f32; 3]| light.iter().all(|value| value.is_finite());
            if !counts || !known(truth) {
                continue;
            }
            if !known(found) {
                error.unanswered += 1;
                continue;
            }
            for (found, truth) in found.iter().zip(truth) {
                let found = (found * scale as f32).clamp(0.0, 1.0);
                error.squares += f64::from(found - truth.clamp(0.0, 1.0)).powi(2);
            }
            error.pixels += 1;
        }
        error
    }

    /// Mean squared error of a channel; `None` without a pixel.
    pub(super) fn mse(&self) -> Option<f64> {
        (self.pixels > 0).then(|| self.squares / (3.0 * self.pixels as f64))
    }
}

/// Pixels that count and are known in both pictures, and how many lack only the answer.
fn comparable(
    found: &Plane<[f32; 3]>,
    truth: &Plane<[f32; 3]>,
    counts: &Plane<bool>,
) -> (Plane<bool>, usize) {
    let known = |light: &[f32; 3]| light.iter().all(|value| value.is_finite());
    let mut compared = counts.clone();
    let mut unanswered = 0;
    for ((on, found), truth) in compared
        .samples_mut()
        .iter_mut()
        .zip(found.samples())
        .zip(truth.samples())
    {
        *on &= known(truth);
        if *on && !known(found) {
            *on = false;
            unanswered += 1;
        }
    }
    (compared, unanswered)
}

/// Running sums of squared differences, in both spaces.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SquaredError {
    linear: f64,
    srgb: f64,
    /// Pixels added.
    pub(super) pixels: usize,
}

impl SquaredError {
    /// Adds one pixel whose values are known.
    pub(super) fn add(&mut self, found: &[f32; 3], truth: &[f32; 3]) {
        for (found, truth) in found.iter().zip(truth) {
            let (found, truth) = (found.clamp(0.0, 1.0), truth.clamp(0.0, 1.0));
            self.linear += f64::from(found - truth).powi(2);
            self.srgb += f64::from(srgb(found) - srgb(truth)).powi(2);
        }
        self.pixels += 1;
    }

    /// Mean per channel in linear light and in sRGB; `None` without a pixel.
    pub(super) fn means(&self) -> Option<(f64, f64)> {
        let values = 3.0 * self.pixels as f64;
        (self.pixels > 0).then(|| (self.linear / values, self.srgb / values))
    }
}

/// Running sums from which the least-squares scale of an answer to its truth follows.
#[derive(Debug, Clone, Copy, Default)]
pub struct ScaleFit {
    found_found: f64,
    found_truth: f64,
    truth_truth: f64,
    values: usize,
}

impl ScaleFit {
    /// Adds one pixel; NaN on either side is passed over.
    pub fn add(&mut self, found: &[f32; 3], truth: &[f32; 3]) {
        for (found, truth) in found.iter().zip(truth) {
            let (found, truth) = (f64::from(*found), f64::from(*truth));
            if found.is_finite() && truth.is_finite() {
                self.found_found += found * found;
                self.found_truth += found * truth;
                self.truth_truth += truth * truth;
                self.values += 1;
            }
        }
    }

    /// Adds every pixel that counts.
    pub fn add_picture(
        &mut self,
        found: &Plane<[f32; 3]>,
        truth: &Plane<[f32; 3]>,
        counts: &Plane<bool>,
    ) {
        for ((found, truth), counts) in found
            .samples()
            .iter()
            .zip(truth.samples())
            .zip(counts.samples())
        {
            if *counts {
                self.add(found, truth);
            }
        }
    }

    /// The scale of least squared error, ≥ 0; 1 where the answer is black and any scale would do.
    pub fn scale(&self) -> f64 {
        if self.found_found > 0.0 {
            (self.found_truth / self.found_found).max(0.0)
        } else {
            1.0
        }
    }

    /// Mean squared error that is left after [`Self::scale`]; 0 without a value.
    fn residual_mse(&self) -> f64 {
        let scale = self.scale();
        let rest =
            self.truth_truth - 2.0 * scale * self.found_truth + scale * scale * self.found_found;
        rest.max(0.0) / self.values.max(1) as f64
    }
}

/// The sRGB curve (IEC 61966-2-1) of linear light in [0, 1].
pub(super) fn srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// A picture clipped to [0, 1] and sent through the sRGB curve; NaN stays.
fn encoded(linear: &Plane<[f32; 3]>) -> Plane<[f32; 3]> {
    linear.map(|light| light.map(|value| srgb(value.clamp(0.0, 1.0))))
}
