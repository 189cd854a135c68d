//! Swept shadows, corrected by a network where the slabs are unsure.
//!
//! A sweep knows where it guesses: bodies thinner or thicker than assumed would answer otherwise, and
//! noisy depth leaves a probability. There its answer and that of the paper's ShadowNet are weighed by
//! their squared errors, pixel by pixel; where the sweep is sure the network is not heard.

use super::{
    Feed, Network, NetworkError,
    frame::seen_from,
    grid::resampled,
    paper::{answers, plane},
};
use crate::relight::{Indirect, Lamp, Prepared, RelightOptions, Relit, Shadows};
use drivers::Plane;

/// Mean squared error of the network's shadows: that of the shipped weights on the rendered
/// validation captures (`models/cards/paper-clean-shadow.md`).
pub const NETWORK_ERROR: f32 = 0.06;
/// The same of swept shadows where nothing hints at an error.
const SWEPT_ERROR: f32 = 0.004;
/// Bodies may be so many times thinner or thicker than guessed.
const THICKNESS_DOUBT: f32 = 2.5;

/// Expected squared error of swept visibility that is `seen`, and would be `thin` and `thick` with
/// other thicknesses; all in [0, 1].
fn swept_error(seen: f32, thin: f32, thick: f32) -> f32 {
    let doubt = 0.5 * (thin - thick);
    SWEPT_ERROR + doubt * doubt + seen * (1.0 - seen)
}

/// A scene with bodies thinner and thicker than guessed.
#[derive(Debug, Clone)]
pub struct Doubt {
    thin: Prepared,
    thick: Prepared,
}

impl Doubt {
    /// Of a scene that casts shadows.
    pub fn of(prepared: &Prepared) -> Self {
        Self {
            thin: prepared.with_thickness(1.0 / THICKNESS_DOUBT),
            thick: prepared.with_thickness(THICKNESS_DOUBT),
        }
    }

    /// Expected squared error of the scene's swept visibility under a lamp; NaN = unknown.
    pub fn swept_errors(&self, lamp: &Lamp, shadow: &Plane<f32>) -> Plane<f32> {
        let (thin, thick) = (self.thin.visibility(lamp), self.thick.visibility(lamp));
        let others = thin.samples().iter().zip(thick.samples());
        let errors = shadow.samples().iter().zip(others);
        let errors = errors.map(|(seen, (thin, thick))| swept_error(*seen, *thin, *thick));
        Plane::new(shadow.width(), shadow.height(), errors.collect()).expect("one per pixel")
    }

    /// What a network is expected to correct under a lamp, where the swept answer's `errors` are known
    /// and `direct` is the light without any shadow: the error that goes when both answers are weighed by
    /// their errors, root mean square over the picture, linear light of white = 1.
    pub fn correctable(errors: &Plane<f32>, direct: &Relit) -> f32 {
        let (mut sum, mut count) = (0.0f64, 0.0f64);
        for (light, error) in direct.light.0.samples().iter().zip(errors.samples()) {
            let goes = error * error / (error + NETWORK_ERROR);
            let brightness = light.map(|value| value.clamp(0.0, 1.0)).iter().sum::<f32>() / 3.0;
            let worth = goes * brightness * brightness;
            if worth.is_finite() {
                sum += f64::from(worth);
                count += 1.0;
            }
        }
        (sum / count.max(1.0)).sqrt() as f32
    }

    /// The scene under one lamp, its shadows corrected by what `network` says of `feed`; the network is
    /// not asked where it is expected to correct no more than `least` ([`Self::correctable`]).
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn relight(
        &self,
        prepared: &Prepared,
        lamp: &Lamp,
        network: &dyn Network,
        feed: &Feed,
        least: f32,
    ) -> Result<Relit, NetworkError> {
        let mut relit = prepared.relight(lamp, RelightOptions::default());
        let direct = prepared.relight(lamp, UNSHADOWED);
        let errors = self.swept_errors(lamp, &relit.shadow);
        if Self::correctable(&errors, &direct) <= least {
            return Ok(relit);
        }
        let cloud = seen_from(lamp.person_direction(), &feed.cloud);
        let [answer] = answers(network, &[("cloud", &cloud)], &[("shadow", 1)])?;
        let told = resampled(&plane::<1>(&answer).map(|[told]| *told), prepared.size());
        let corrected = relit.light.0.samples_mut().iter_mut();
        let corrected = corrected.zip(relit.shadow.samples_mut());
        for (index, (light, shadow)) in corrected.enumerate() {
            // Nothing is lit that is turned away.
            if direct.shadow.samples()[index] > 0.0 {
                let error = errors.samples()[index];
                let weight = error / (error + NETWORK_ERROR);
                let step = weight * (told.samples()[index] - *shadow);
                *shadow += step;
                let direct = direct.light.0.samples()[index];
                *light = std::array::from_fn(|c| light[c] + step * direct[c]);
            }
        }
        Ok(relit)
    }
}

/// The light that comes straight from the lamp, as if nothing stood in its way.
pub const UNSHADOWED: RelightOptions = RelightOptions {
    shadows: Shadows::None,
    indirect: Indirect::None,
};
