//! Matte reflectance from the flash's own light.

use super::{fill::local_mean, karis::karis_at_lens};
use drivers::{FlashLamp, Plane};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// What one pixel says about its reflectance before matte and highlight are told apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reflection {
    /// Flash-only light × distance² / intensity: albedo·cos + π·f·cos. NaN = unknown.
    pub value: [f32; 3],
    /// Variance of `value` (one channel) from the light alone.
    pub variance: f32,
    /// Cosine between the normal and the direction to the flash; NaN = unknown.
    pub cosine: f32,
}

/// Takes distance and lamp out of the flash-only light.
pub(super) fn reflections(
    light: &Plane<[f32; 3]>,
    variance: &Plane<f32>,
    depth_metres: &Plane<f32>,
    normal: &Plane<Vec3>,
    rays: &Plane<Vec2>,
    flash: &FlashLamp,
) -> Plane<Reflection> {
    let lamp = flash.position_metres.as_vec3();
    let per_intensity = 1.0 / flash.intensity.unwrap_or(1.0);
    let (width, height) = light.size();
    let nothing = Reflection {
        value: [f32::NAN; 3],
        variance: f32::NAN,
        cosine: f32::NAN,
    };
    let mut plane = Plane::filled(width, height, nothing);
    plane
        .samples_mut()
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, out)| {
            let point = rays.samples()[i].extend(1.0) * depth_metres.samples()[i];
            let to_lamp = lamp - point;
            let beam = flash.beam.strength((-to_lamp).as_dvec3()) as f32;
            let scale = to_lamp.length_squared() * per_intensity / beam;
            out.value = light.samples()[i].map(|v| v * scale);
            out.variance = variance.samples()[i] * scale * scale;
            out.cosine = normal.samples()[i].dot(to_lamp) / to_lamp.length();
        });
    plane
}

/// How far a surface's albedo strays from its surroundings', at most: the prior's deviation.
const PRIOR_SIGMA: f32 = 0.2;

/// Normals are never better than this, radians: it keeps the division from exploding at grazing
/// angles even where the depth claims to be perfect.
const NORMAL_SIGMA_RADIANS: f32 = 0.05;

/// Cosine between normal and flash below which only the normal can be wrong.
const LEAST_COSINE: f32 = 0.05;

/// Pixels over which the scale of a surface is compared with that of its surroundings.
const SURROUNDINGS_PIXELS: f32 = 64.0;

/// Uncertain detail is brighter than its surroundings by this factor at most.
const MOST_CONTRAST: f32 = 1.6;

/// Albedo beyond which light over cosine is not followed, before the surroundings are heard.
const MOST_PLAIN: f32 = 1.5;

/// Mean of the three channels.
fn brightness([red, green, blue]: [f32; 3]) -> f32 {
    (red + green + blue) / 3.0
}

/// Share of pixels that may be brighter than [`BRIGHT_ALBEDO`] where the flash's intensity is
/// unknown.
const BRIGHT_SHARE: f32 = 0.05;

/// Albedo the brightest surfaces are given where the flash's intensity is unknown: white paint.
const BRIGHT_ALBEDO: f32 = 0.8;

/// Factor that makes the scene's brightest surfaces plausible; 1 when there is no evidence.
pub(super) fn plausible_scale(reflections: &Plane<Reflection>) -> f32 {
    let stride = reflections.len().div_ceil(100_000).max(1);
    let mut facing: Vec<f32> = reflections
        .samples()
        .iter()
        .step_by(stride)
        .filter(|r| r.cosine > 0.3)
        .map(|r| (r.value[0] + r.value[1] + r.value[2]) / (3.0 * r.cosine))
        .filter(|brightness| *brightness > 0.0 && brightness.is_finite())
        .collect();
    if facing.is_empty() {
        return 1.0;
    }
    let rank = ((1.0 - BRIGHT_SHARE) * (facing.len() - 1) as f32) as usize;
    let (_, bright, _) = facing.select_nth_unstable_by(rank, f32::total_cmp);
    BRIGHT_ALBEDO / *bright
}

/// Albedo per pixel.
///
/// The most probable albedo given `value − highlight = albedo·cos + noise` and a prior at the mean
/// of its surroundings. Noise is that of the light and that of the cosine, which rules at grazing
/// angles; there the surroundings set the brightness and the photograph the detail. Where the light
/// is unknown, the answer is the surroundings'. NaN without depth. Clamped to [0, 1].
pub(super) fn albedo(
    reflections: &Plane<Reflection>,
    roughness: Option<&Plane<f32>>,
    normal_sigma: &Plane<f32>,
) -> Plane<[f32; 3]> {
    let (width, height) = reflections.size();
    // Per pixel: albedo by plain division, and the information (1/variance) behind it.
    let mut plain = Plane::filled(width, height, [f32::NAN; 3]);
    let mut information = Plane::filled(width, height, 0.0f32);
    // The share of its noise that hides the pixel's own detail: all but that of the
    // depth, which is the neighbours' too.
    let mut hidden = Plane::filled(width, height, 1.0f32);
    plain
        .samples_mut()
        .par_iter_mut()
        .zip(information.samples_mut())
        .zip(hidden.samples_mut())
        .enumerate()
        .for_each(|(i, ((plain, information), hidden))| {
            let Reflection {
                value,
                variance,
                cosine,
            } = reflections.samples()[i];
            if value[0].is_nan() || cosine.is_nan() {
                return;
            }
            // What is seen cannot face away: there the normal is wrong and only the scale unknown.
            let cosine = cosine.max(LEAST_COSINE);
            let highlight = roughness.map_or(0.0, |of| karis_at_lens(cosine, of.samples()[i]));
            *plain = value.map(|v| v / cosine - highlight);
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            let slack = |tilt: f32| sine * tilt + 0.5 * tilt * tilt;
            let measured = normal_sigma.samples()[i];
            // A highlight taken away leaves an error of its own size behind.
            let doubt = highlight * cosine;
            let brightness = brightness(*plain).max(0.0);
            let tilted = |tilt: f32| (brightness * slack(tilt)).powi(2);
            let noise = variance
                + tilted(measured.hypot(NORMAL_SIGMA_RADIANS))
                + 0.25 * doubt * doubt
                // Below this, quantisation and stray light rule.
                + 1e-6;
            *hidden = 1.0 - (tilted(measured) / noise).min(1.0);
            // Nothing is much brighter than white, whatever its cosine says.
            let excess = (brightness / MOST_PLAIN).max(1.0);
            *plain = plain.map(|albedo| albedo / excess);
            *information = cosine * cosine / noise;
            if information.is_nan() {
                *information = 0.0;
            }
        });
    let around = local_mean(&plain, &information, 1.0 / (0.05 * 0.05));
    // The same, uncertain cosines and all: what the surroundings must be scaled by to be believed.
    let known = plain.map(|albedo| f32::from(u8::from(!albedo[0].is_nan())));
    let here = local_mean(&plain, &known, SURROUNDINGS_PIXELS);
    plain
        .samples_mut()
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, albedo)| {
            if reflections.samples()[i].cosine.is_nan() {
                *albedo = [f32::NAN; 3];
                return;
            }
            let weight = information.samples()[i];
            let around = around.samples()[i];
            let pull = 1.0 / (PRIOR_SIGMA * PRIOR_SIGMA);
            if weight > 0.0 {
                // A cosine that is off scales the pixel and its neighbours alike, so the surroundings
                // correct the scale and leave the picture's own detail; light that is noisy tells
                // nothing of its own.
                let scale = brightness(around) / brightness(here.samples()[i]).max(1e-3);
                let most = MOST_CONTRAST * brightness(around) / brightness(*albedo).max(1e-3);
                let scale = scale.min(most).max(0.0);
                let hidden = hidden.samples()[i];
                *albedo = std::array::from_fn(|k| {
                    let scaled = albedo[k] * scale;
                    let prior = scaled + (around[k] - scaled) * hidden;
                    ((albedo[k] * weight + prior * pull) / (weight + pull)).clamp(0.0, 1.0)
                });
            } else {
                *albedo = around.map(|p| p.clamp(0.0, 1.0));
            }
        });
    plain
}
