//! Surfaces as a network corrects them.

use super::super::{Channels, Network, NetworkError, paper::plane};
use super::{calmed, finite};
use crate::{relight::networks::paper::answers, scene::Scene};
use rayon::prelude::*;

/// The smoothest that a network may call a surface.
const SMOOTHEST: f32 = 0.01;

/// The scene with the network's corrections; `given` is what [`super::Sight::given`] made of it.
///
/// The albedo is multiplied by what it says and the roughness replaced, where they are known; the albedo keeps to
/// [0, 1] where its scale is known.
///
/// # Errors
/// [`NetworkError`] of the network.
pub fn corrected(
    scene: &Scene,
    given: &Channels,
    network: &dyn Network,
) -> Result<Scene, NetworkError> {
    let wanted = [("factor", 3), ("roughness", 1)];
    let [factor, roughness] = answers(network, &[("sight", given)], &wanted)?;
    let size = scene.albedo.size();
    let factors = calmed(&plane::<3>(&factor), size);
    let roughness = calmed(&plane::<1>(&roughness).map(|[value]| *value), size);
    let most = if scene.scale_known { 1.0 } else { f32::MAX };
    let mut out = scene.clone();
    let albedos = out.albedo.samples_mut().par_iter_mut();
    albedos
        .zip(factors.samples())
        .for_each(|(albedo, factors)| {
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
