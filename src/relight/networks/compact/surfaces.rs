//! Surfaces as a network corrects them.

use super::super::{Channels, Network, NetworkError, grid::resampled, paper::plane};
use super::finite;
use crate::{relight::networks::paper::answers, scene::Scene};
use drivers::Plane;
use glam::Vec3;
use rayon::prelude::*;

/// No normal is turned further away from the camera than this cosine.
const LEAST_FACING: f32 = 0.02;

/// The scene with the network's corrections; `given` is what [`super::Sight::given`] made of it.
///
/// Only what is known is corrected, and depth not at all; the albedo keeps to [0, 1] where its scale is known.
///
/// # Errors
/// [`NetworkError`] of the network.
pub fn corrected(
    scene: &Scene,
    given: &Channels,
    network: &dyn Network,
) -> Result<Scene, NetworkError> {
    let wanted = [("turn", 3), ("factor", 3), ("roughness", 1)];
    let [turn, factor, roughness] = answers(network, &[("sight", given)], &wanted)?;
    let size = scene.albedo.size();
    let turns = resampled(&plane::<3>(&turn), size);
    let factors = resampled(&plane::<3>(&factor), size);
    let roughness = resampled(&plane::<1>(&roughness).map(|[value]| *value), size);
    let most = if scene.scale_known { 1.0 } else { f32::MAX };
    let rays: Plane<Vec3> = Plane::from_fn(size.0, size.1, |x, y| {
        let ray = scene.camera.ray(glam::DVec2::new(x as f64, y as f64));
        ray.map_or(Vec3::NAN, |ray| ray.as_vec3().normalize())
    });
    let mut out = scene.clone();
    let normals = out.normal.samples_mut().par_iter_mut().enumerate();
    normals.for_each(|(index, normal)| {
        let [x, y, z] = turns.samples()[index].map(finite);
        let turned = (*normal + Vec3::new(x, -y, -z)).normalize_or_zero();
        let ray = rays.samples()[index];
        if turned.dot(ray) < -LEAST_FACING {
            *normal = turned;
        }
    });
    let albedos = out.albedo.samples_mut().par_iter_mut().enumerate();
    albedos.for_each(|(index, albedo)| {
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
            *value = finite(*found).clamp(0.01, 1.0);
        }
    }
    Ok(out)
}
