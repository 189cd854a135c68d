//! How far to trust a pixel.

use super::albedo::Reflection;
use drivers::Plane;

/// Depth noise at which a pixel is half trusted, as a share of its depth.
const HALF_TRUSTED_DEPTH: f32 = 0.02;

/// Trust left where depth was filled in rather than measured.
const FILLED: f32 = 0.5;

/// Trust left where the light is clipped or unknown and albedo comes from the surroundings.
const DARK: f32 = 0.2;

/// Confidence 0 to 1: signal-to-noise of the flash × grazing angle × depth noise × measured;
/// 0 without depth.
///
/// Half trust stands at a signal of three standard deviations, at 72° of grazing (cosine 0.3) and
/// at a depth noise of 2 %.
pub(super) fn confidence(
    reflections: &Plane<Reflection>,
    depth_metres: &Plane<f32>,
    depth_sigma_metres: &Plane<f32>,
    measured: &Plane<bool>,
) -> Plane<f32> {
    let (width, height) = reflections.size();
    Plane::from_fn(width, height, |x, y| {
        let Reflection {
            value,
            variance,
            cosine,
        } = reflections[(x, y)];
        let depth = depth_metres[(x, y)];
        if depth.is_nan() || cosine.is_nan() {
            return 0.0;
        }
        let half = |amount: f32, at: f32| {
            let share = (amount.max(0.0) / at).powi(2);
            if share.is_finite() {
                share / (1.0 + share)
            } else {
                1.0
            }
        };
        let signal = (value[0] + value[1] + value[2]) / 3.0;
        let light = if signal.is_nan() {
            DARK
        } else {
            half(signal, 3.0 * variance.max(1e-12).sqrt())
        };
        let geometry = half(
            HALF_TRUSTED_DEPTH * depth,
            depth_sigma_metres[(x, y)].max(1e-9),
        );
        let seen = if measured[(x, y)] { 1.0 } else { FILLED };
        light * half(cosine, 0.3) * geometry * seen
    })
}
