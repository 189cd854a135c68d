//! Noise of a Time-of-Flight camera.

use super::{
    CorruptionError,
    depth_grid::{NEAREST_METRES, metres, with_metres},
    field::upper,
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// Shares of the median amplitude beyond which the noise changes no more.
const AMPLITUDES: [f32; 2] = [0.04, 25.0];

/// Gaussian noise on depth, its sigma `millimetres` at the median amplitude and falling with the
/// root of the amplitude (Lange & Seitz 2001, the signal's own photons). Without amplitude it is
/// taken to fall with the square of distance.
pub(super) fn on_shot(
    shot: &Shot,
    millimetres: f32,
    chance: Chance,
) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let strength = match &shot.depth.amplitude {
        Some(amplitude) => amplitude.clone(),
        None => clean.map(|z| z.powi(-2)),
    };
    let answered = strength.samples().iter().zip(clean.samples());
    let answered = answered.filter_map(|(strength, z)| z.is_finite().then_some(*strength));
    let median = upper(answered, 50.0).unwrap_or(1.0).max(f32::MIN_POSITIVE);
    let noisy = Plane::from_fn(width, height, |x, y| {
        let z = clean[(x, y)];
        let share = strength[(x, y)] / median;
        let share = if share.is_nan() {
            // Unknown amplitude counts as the weakest.
            AMPLITUDES[0]
        } else {
            share.clamp(AMPLITUDES[0], AMPLITUDES[1])
        };
        let sigma = 1e-3 * millimetres / share.sqrt();
        let noisy = z + sigma * chance.normal((y * width + x) as u64);
        if z.is_finite() {
            noisy.max(NEAREST_METRES)
        } else {
            f32::NAN
        }
    });
    Ok(with_metres(shot, noisy))
}
