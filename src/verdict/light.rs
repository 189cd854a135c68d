//! What the pixels say about the light: clipping and noise.

use super::{
    Finding,
    finding::percent,
    look::{Look, quantile},
};
use rayon::prelude::*;

/// Share of clipped pixels that does harm.
const HARMFUL_CLIPPED: f32 = 0.04;
/// Noise over signal of a typical pixel.
const HARMFUL_NOISE: f32 = 0.09;
/// Signal-to-noise ratio under which a pixel is of no use.
const USABLE_SIGMAS: f32 = 3.0;
/// Pixels looked at, about.
const SAMPLES: usize = 20_000;

/// Noise of the flash's light at its median, over that light; and the share of pixels of no use.
fn noise(look: &Look<'_>) -> (f32, f32) {
    let light = &look.development.flash_only.light.0;
    let variance = &look.development.flash_only.variance;
    let step = (light.len() / SAMPLES).max(1);
    let ratios: Vec<f32> = light
        .samples()
        .par_iter()
        .zip(variance.samples())
        .step_by(step)
        .filter_map(|(rgb, variance)| {
            let mean = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
            let lit = mean > 0.02 * look.median_light;
            lit.then(|| variance.sqrt() / mean)
        })
        .collect();
    let useless = ratios
        .iter()
        .filter(|ratio| **ratio > 3f32.sqrt() / USABLE_SIGMAS)
        .count();
    let useless = useless as f32 / ratios.len().max(1) as f32;
    (quantile(ratios, 0.5).unwrap_or(0.0), useless)
}

/// Pixels at the end of the sensor's range.
pub(super) fn flash_saturation(look: &Look<'_>) -> Finding {
    let clipped = look.development.flash_only.report.clipped_fraction;
    let piled = piled_up(look);
    let affected = clipped.max(piled);
    Finding::new(
        "flash-saturation",
        affected / HARMFUL_CLIPPED,
        Some(affected),
        || {
            format!(
                "{} of the photograph is clipped and has no answer; shorten the exposure or step back",
                percent(affected)
            )
        },
    )
}

/// Share of pixels that hold exactly the brightest value there is: a sensor that clips under the
/// white level it states.
fn piled_up(look: &Look<'_>) -> f32 {
    let light = &look.development.flash_only.light.0;
    // After a subtraction equal values are no longer equal.
    if !look.shot.ambient.is_empty() {
        return 0.0;
    }
    let brightest = |rgb: &[f32; 3]| rgb[0].max(rgb[1]).max(rgb[2]);
    let most = light
        .samples()
        .par_iter()
        .map(brightest)
        .reduce(|| 0.0, f32::max);
    let at_most = light
        .samples()
        .par_iter()
        .filter(|rgb| brightest(rgb) >= most)
        .count();
    // One is always the brightest.
    at_most.saturating_sub(1) as f32 / light.len().max(1) as f32
}

/// The photograph's own noise.
pub(super) fn sensor_noise(look: &Look<'_>) -> Finding {
    let (noise, useless) = noise(look);
    Finding::new("sensor-noise", noise / HARMFUL_NOISE, Some(useless), || {
        format!(
            "the flash's light is noisy by {} of itself; use more light or a lower gain",
            percent(noise)
        )
    })
}
