//! Surfaces as a network corrects them.

use super::{
    super::{Channels, Network, NetworkError},
    told::Told,
};
use crate::{relight::networks::paper::answers, scene::Scene};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// The smoothest that a network may call a surface.
const SMOOTHEST: f32 = 0.01;

/// The network speaks on a grid so many times coarser than its own.
const SAID_GRID: usize = 2;

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
    let turns = Told::new(&turns, SAID_GRID, size);
    let factors = Told::new(&factor, SAID_GRID, size);
    let told = Told::new(&roughness, SAID_GRID, size);
    let most = if scene.scale_known { 1.0 } else { f32::MAX };
    let mut out = scene.clone();
    let width = size.0.max(1);
    let rows = out.albedo.samples_mut().par_chunks_mut(width);
    let rows = rows.zip(out.normal.samples_mut().par_chunks_mut(width));
    let rows = rows.zip(out.roughness.samples_mut().par_chunks_mut(width));
    rows.enumerate()
        .for_each(|(y, ((albedos, normals), roughnesses))| {
            let [turns, factors, told] = [&turns, &factors, &told].map(|told| told.row(y));
            for x in 0..width {
                let Some(ray) = scene.camera.ray(DVec2::new(x as f64, y as f64)) else {
                    continue;
                };
                let toward = -ray.as_vec3().normalize_or_zero();
                let (albedo, normal) = (&mut albedos[x], &mut normals[x]);
                let [right, up, near] = [0, 1, 2].map(|axis| turns[axis][x]);
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
                // Not `min`, which would make something known of NaN.
                *albedo = std::array::from_fn(|c| {
                    let value = albedo[c] * factors[c][x].exp();
                    if value > most { most } else { value }
                });
                let roughness = &mut roughnesses[x];
                if !roughness.is_nan() {
                    *roughness = told[0][x].clamp(SMOOTHEST, 1.0);
                }
            }
        });
    Ok(out)
}
