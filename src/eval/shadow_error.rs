//! How far a shadow map is from the truth: MSE, intersection over union, balanced error rate.

use super::light_error::{GridMismatch, same_grid};
use drivers::Plane;
use serde::{Deserialize, Serialize};

/// Counts of shadow pixels, from which every rate follows; the sum of two tallies is the tally of
/// both pictures together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShadowTally {
    squares: f64,
    found_and_true: usize,
    found_only: usize,
    true_only: usize,
    lit_in_both: usize,
    unanswered: usize,
}

/// The error of a shadow map with 0 = shadow and 1 = lit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShadowError {
    /// Mean squared error.
    pub mse: f64,
    /// Shadow pixels found and true over those found or true, a shadow being a value under 0.5;
    /// `None` where there is no shadow in either.
    pub iou: Option<f64>,
    /// Mean of the miss rates of shadow and of lit pixels; `None` where the truth has only one kind.
    pub balanced_error_rate: Option<f64>,
    /// Pixels of true shadow.
    pub shadow_pixels: usize,
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that count and have a truth, but were not answered; not in the rates.
    pub unanswered: usize,
}

impl ShadowTally {
    /// Tallies one picture where `counts` is true; NaN in `truth` means the truth is not known.
    ///
    /// # Errors
    /// [`GridMismatch`] when the three planes do not share one size.
    pub fn of(
        found: &Plane<f32>,
        truth: &Plane<f32>,
        counts: &Plane<bool>,
    ) -> Result<Self, GridMismatch> {
        same_grid("shadow", found.size(), &[truth.size(), counts.size()])?;
        let mut tally = Self::default();
        for ((&found, &truth), counts) in found
            .samples()
            .iter()
            .zip(truth.samples())
            .zip(counts.samples())
        {
            if !counts || !truth.is_finite() {
                continue;
            }
            if !found.is_finite() {
                tally.unanswered += 1;
                continue;
            }
            let (found, truth) = (found.clamp(0.0, 1.0), truth.clamp(0.0, 1.0));
            tally.squares += f64::from(found - truth).powi(2);
            match (found < 0.5, truth < 0.5) {
                (true, true) => tally.found_and_true += 1,
                (true, false) => tally.found_only += 1,
                (false, true) => tally.true_only += 1,
                (false, false) => tally.lit_in_both += 1,
            }
        }
        Ok(tally)
    }

    /// Takes another picture's tally in.
    pub fn add(&mut self, other: &Self) {
        self.squares += other.squares;
        self.found_and_true += other.found_and_true;
        self.found_only += other.found_only;
        self.true_only += other.true_only;
        self.lit_in_both += other.lit_in_both;
        self.unanswered += other.unanswered;
    }

    /// The rates; `None` when no pixel was compared.
    pub fn error(&self) -> Option<ShadowError> {
        let shadow_pixels = self.found_and_true + self.true_only;
        let lit_pixels = self.found_only + self.lit_in_both;
        let pixels = shadow_pixels + lit_pixels;
        if pixels == 0 {
            return None;
        }
        let either = shadow_pixels + self.found_only;
        let rate = |part: usize, whole: usize| part as f64 / whole as f64;
        Some(ShadowError {
            mse: self.squares / pixels as f64,
            iou: (either > 0).then(|| rate(self.found_and_true, either)),
            balanced_error_rate: (shadow_pixels > 0 && lit_pixels > 0).then(|| {
                0.5 * (rate(self.true_only, shadow_pixels) + rate(self.found_only, lit_pixels))
            }),
            shadow_pixels,
            pixels,
            unanswered: self.unanswered,
        })
    }
}
