//! Surfaces as a network corrects them.

use super::super::{Channels, Network, NetworkError, paper::plane};
use super::{calmed, finite};
use crate::{relight::networks::paper::answers, scene::Scene};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// The smoothest that a network may call a surface.
const SMOOTHEST: f32 = 0.01;

/// Cosine toward the camera below which light is not divided by it; `models/compact/tasks.py` has the same.
const LEAST_COSINE: f32 = 0.15;

/// The scene with the network's corrections; `given` is what [`super::Sight::given`] made of it.
///
/// Normals are turned and the roughness replaced, where they are known. The closed form's albedo is the flash's light over
/// the cosine of its own normal: it is divided anew by that of the turned one, then multiplied by what the network says;
/// it keeps to [0, 1] where its scale is known.
///
/// # Errors
/// [`NetworkError`] of the network.
pub fn corrected(
    scene: &Scene,
    given: &Channels,
    network: &dyn Network,
) -> Result<Scene, NetworkError> {
    let wanted = [("normal", 3), ("factor", 3), ("roughness", 1)];
    let [turns, factor, roughness] = answers(network, &[("sight", given)], &wanted)?;
    let size = scene.albedo.size();
    let turns = calmed(&plane::<3>(&turns), size);
    let factors = calmed(&plane::<3>(&factor), size);
    let roughness = calmed(&plane::<1>(&roughness).map(|[value]| *value), size);
    let most = if scene.scale_known { 1.0 } else { f32::MAX };
    let mut out = scene.clone();
    let width = size.0.max(1);
    let surfaces = out.albedo.samples_mut().par_iter_mut();
    let surfaces = surfaces.zip(out.normal.samples_mut()).enumerate();
    surfaces.for_each(|(index, (albedo, normal))| {
        let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
        let Some(ray) = scene.camera.ray(pixel) else {
            return;
        };
        let toward = -ray.as_vec3().normalize_or_zero();
        let [right, up, near] = turns.samples()[index].map(finite);
        let turned = (*normal + Vec3::new(right, -up, -near)).normalize_or_zero();
        if normal.is_finite() && turned != Vec3::ZERO {
            // Light that does not fall off as a flash's was not divided by a cosine.
            if scene.flash_lit {
                let cosine = |normal: Vec3| normal.dot(toward).max(LEAST_COSINE);
                let anew = cosine(*normal) / cosine(turned);
                *albedo = albedo.map(|value| value * anew);
            }
            *normal = turned;
        }
        let factors = factors.samples()[index];
        // Not `min`, which would make something known of NaN.
        *albedo = std::array::from_fn(|c| {
            let value = albedo[c] * finite(factors[c]).exp();
            if value > most { most } else { value }
        });
    });
    let roughnesses = out.roughness.samples_mut().iter_mut();
    for (value, found) in roughnesses.zip(roughness.samples()) {
        if !value.is_nan() {
            *value = finite(*found).clamp(SMOOTHEST, 1.0);
        }
    }
    Ok(out)
}
