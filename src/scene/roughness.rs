//! Roughness from how the flash's reflection falls off with its angle.

use super::{albedo::Reflection, karis::karis_at_lens};
use drivers::Plane;
use rayon::prelude::*;

/// Roughness of one material, and how well the photograph shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Karis roughness in (0, 1].
    pub roughness: f32,
    /// 0 (no evidence, the default) to 1.
    pub confidence: f32,
}

/// Bins of angle between normal and flash, up to [`WIDEST_RADIANS`].
const BINS: usize = 32;

/// Beyond this angle albedo errors of the normals drown the lobe.
const WIDEST_RADIANS: f32 = 1.1;

/// Fewest pixels in a bin for its median to count.
const FEWEST: usize = 12;

/// Brightness (value / cos) against angle, as medians per bin.
struct Profile {
    /// (cosine, median brightness, standard error).
    points: Vec<(f32, f32, f32)>,
}

fn profile(reflections: &[Reflection]) -> Profile {
    let mut bins: Vec<Vec<f32>> = vec![Vec::new(); BINS];
    for r in reflections {
        let brightness = (r.value[0] + r.value[1] + r.value[2]) / (3.0 * r.cosine);
        let angle = r.cosine.min(1.0).acos();
        if brightness.is_finite() && angle < WIDEST_RADIANS {
            bins[(angle / WIDEST_RADIANS * BINS as f32) as usize].push(brightness);
        }
    }
    let points = bins
        .par_iter_mut()
        .enumerate()
        .filter(|(_, bin)| bin.len() >= FEWEST)
        .map(|(i, bin)| {
            bin.sort_unstable_by(f32::total_cmp);
            let at = |share: f32| bin[(share * (bin.len() - 1) as f32) as usize];
            // Quartiles to the standard error of a median; at least a hundredth of the value,
            // because the bins' pixels are not independent.
            let spread = (at(0.75) - at(0.25)) / 1.349;
            let error = (1.253 * spread / (bin.len() as f32).sqrt()).max(0.01 * at(0.5).abs());
            let angle = (i as f32 + 0.5) * WIDEST_RADIANS / BINS as f32;
            (angle.cos(), at(0.5), error.max(1e-4))
        })
        .collect();
    Profile { points }
}

/// Weighted squared error of `albedo + highlight(roughness)` with the best albedo.
fn misfit(profile: &Profile, roughness: f32) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for &(cosine, value, error) in &profile.points {
        let weight = 1.0 / (error * error);
        sum += weight * (value - karis_at_lens(cosine, roughness));
        weights += weight;
    }
    let albedo = (sum / weights).max(0.0);
    profile
        .points
        .iter()
        .map(|&(cosine, value, error)| {
            ((value - albedo - karis_at_lens(cosine, roughness)) / error).powi(2)
        })
        .sum()
}

/// The roughness whose lobe, on top of one albedo, explains brightness against angle best;
/// `default` where no lobe explains it much better than a matte surface.
///
/// With the flash at the lens n·l = n·v = n·h, so the whole lobe shows as one curve.
pub(super) fn fit(reflections: &[Reflection], default: f32) -> Fit {
    let profile = profile(reflections);
    let none = Fit {
        roughness: default,
        confidence: 0.0,
    };
    // A lobe has a peak and a foot; without bins for both nothing can be told.
    if profile.points.len() < 6 {
        return none;
    }
    let matte = misfit(&profile, 1.0);
    let (roughness, best) = (3..=40)
        .map(|i| i as f32 / 40.0)
        .map(|roughness| (roughness, misfit(&profile, roughness)))
        .fold((1.0, f32::INFINITY), |a, b| if b.1 < a.1 { b } else { a });
    // Chi-square left per point: a curve neither model fits is no evidence for either.
    let left = (best / profile.points.len() as f32).max(1.0);
    let gain = (matte - best) / left;
    let confidence = gain / (gain + 10.0);
    if confidence < 0.5 || confidence.is_nan() {
        return none;
    }
    Fit {
        roughness,
        confidence,
    }
}

/// Roughness of every pixel with known depth; NaN elsewhere; and the confidence of the fit.
pub(super) fn roughness(reflections: &Plane<Reflection>, default: f32) -> (Plane<f32>, f32) {
    let Fit {
        roughness,
        confidence,
    } = fit(reflections.samples(), default);
    (
        reflections.map(|r| {
            if r.cosine.is_nan() {
                f32::NAN
            } else {
                roughness
            }
        }),
        confidence,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(albedo: f32, roughness: f32) -> Vec<Reflection> {
        (0..20_000)
            .map(|i| {
                let cosine = (1.0 - (i as f32 / 20_000.0)).sqrt();
                let value = cosine * (albedo + karis_at_lens(cosine, roughness));
                Reflection {
                    value: [value; 3],
                    variance: 1e-6,
                    cosine,
                }
            })
            .collect()
    }

    #[test]
    fn roughness_of_a_shiny_ball_is_read_from_its_profile() {
        for roughness in [0.25, 0.4, 0.5] {
            let fit = fit(&ball(0.3, roughness), 0.9);
            assert!(
                (fit.roughness - roughness).abs() < 0.05,
                "{roughness}: {fit:?}"
            );
            assert!(fit.confidence > 0.5);
        }
    }

    #[test]
    fn a_matte_ball_gives_no_evidence() {
        assert_eq!(
            fit(&ball(0.3, 1.0), 0.9),
            Fit {
                roughness: 0.9,
                confidence: 0.0
            }
        );
        assert_eq!(
            fit(&[], 0.9),
            Fit {
                roughness: 0.9,
                confidence: 0.0
            }
        );
    }
}
