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
            let scale = to_lamp.length_squared() * per_intensity;
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

/// Albedo per pixel, and its standard deviation.
///
/// The most probable albedo given `value − highlight = albedo·cos + noise` and a prior at the mean
/// of its surroundings. Noise is that of the light and that of the cosine, which rules at grazing
/// angles; there, and where the light is unknown, the answer is the surroundings'. NaN without
/// depth. Clamped to [0, 1].
pub(super) fn albedo(
    reflections: &Plane<Reflection>,
    roughness: &Plane<f32>,
    normal_sigma: &Plane<f32>,
) -> (Plane<[f32; 3]>, Plane<f32>) {
    let (width, height) = reflections.size();
    // Per pixel: albedo by plain division, and the information (1/variance) behind it.
    let mut plain = Plane::filled(width, height, [f32::NAN; 3]);
    let mut information = Plane::filled(width, height, 0.0f32);
    plain
        .samples_mut()
        .par_iter_mut()
        .zip(information.samples_mut())
        .enumerate()
        .for_each(|(i, (plain, information))| {
            let Reflection {
                value,
                variance,
                cosine,
            } = reflections.samples()[i];
            if value[0].is_nan() || cosine.is_nan() || cosine <= 1e-3 {
                return;
            }
            let highlight = karis_at_lens(cosine, roughness.samples()[i]);
            *plain = value.map(|v| v / cosine - highlight);
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            let tilt = normal_sigma.samples()[i].hypot(NORMAL_SIGMA_RADIANS);
            let slack = sine * tilt + 0.5 * tilt * tilt;
            // A highlight taken away leaves an error of its own size behind.
            let doubt = highlight * cosine;
            let brightness = (plain[0] + plain[1] + plain[2]).max(0.0) / 3.0;
            let noise = variance
                + (brightness * slack).powi(2)
                + 0.25 * doubt * doubt
                // Below this, quantisation and stray light rule.
                + 1e-6;
            *information = cosine * cosine / noise;
            if information.is_nan() {
                *information = 0.0;
            }
        });
    let around = local_mean(&plain, &information, 1.0 / (0.05 * 0.05));
    let mut sigma = Plane::filled(width, height, f32::NAN);
    plain
        .samples_mut()
        .par_iter_mut()
        .zip(sigma.samples_mut())
        .enumerate()
        .for_each(|(i, (albedo, sigma))| {
            if reflections.samples()[i].cosine.is_nan() {
                *albedo = [f32::NAN; 3];
                return;
            }
            let weight = information.samples()[i];
            let prior = around.samples()[i];
            let pull = 1.0 / (PRIOR_SIGMA * PRIOR_SIGMA);
            if weight > 0.0 {
                *albedo = std::array::from_fn(|k| {
                    ((albedo[k] * weight + prior[k] * pull) / (weight + pull)).clamp(0.0, 1.0)
                });
            } else {
                *albedo = prior.map(|p| p.clamp(0.0, 1.0));
            }
            *sigma = 1.0 / (weight + pull).sqrt();
        });
    (plain, sigma)
}
