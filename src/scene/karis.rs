//! The Karis 2013 highlight lobe: what a surface adds to its matte reflection.

use std::f32::consts::PI;

/// Reflectance of a dielectric seen head on (paper: F0 = 0.05).
pub const F0: f32 = 0.05;

/// Smallest roughness the lobe is evaluated at: below it the peak is narrower than any pixel and
/// higher than `f32` can hold to a useful precision.
pub const ROUGHNESS_FLOOR: f32 = 0.03;

/// The highlight's BRDF, in 1/sr.
///
/// f = D·F·G / (4 (n·l)(n·v)), with
/// D = α² / (π((n·h)²(α² − 1) + 1)²), α = roughness²;
/// G = G1(n·l)·G1(n·v), G1(x) = x / (x(1 − k) + k), k = (roughness + 1)²/8;
/// F = F0 + (1 − F0)·2^((−5.55473 (v·h) − 6.98316)(v·h)).
///
/// A surface of diffuse albedo a then sends `E·(n·l)·(a + π f)` toward the camera, where E is the
/// value of a white Lambertian patch facing the lamp. `roughness` lies in (0, 1] and is raised to
/// [`ROUGHNESS_FLOOR`]; zero where lamp or camera stand behind the surface; NaN for NaN.
///
/// Source: B. Karis, "Real Shading in Unreal Engine 4" (2013), as used by Qiu et al. (3DV 2020),
/// whose appendix misprints the denominator, D and the base of the Fresnel term.
pub fn karis(n_dot_l: f32, n_dot_v: f32, n_dot_h: f32, v_dot_h: f32, roughness: f32) -> f32 {
    if n_dot_l <= 0.0 || n_dot_v <= 0.0 {
        return 0.0;
    }
    let roughness = raised(roughness);
    let alpha = roughness * roughness;
    let alpha2 = alpha * alpha;
    let n_dot_h = n_dot_h.clamp(0.0, 1.0);
    // (n·h)²(α² − 1) + 1 without the cancellation near the peak of a narrow lobe.
    let spread = (1.0 - n_dot_h) * (1.0 + n_dot_h) + n_dot_h * n_dot_h * alpha2;
    let distribution = alpha2 / (PI * spread * spread);
    let k = (roughness + 1.0) * (roughness + 1.0) / 8.0;
    // G1(x) / x: the cosines of the denominator cancel here instead of dividing by zero.
    let masking = |x: f32| 1.0 / (x * (1.0 - k) + k);
    let v_dot_h = v_dot_h.clamp(0.0, 1.0);
    let fresnel = F0 + (1.0 - F0) * ((-5.55473 * v_dot_h - 6.98316) * v_dot_h).exp2();
    0.25 * distribution * fresnel * (masking(n_dot_l) * masking(n_dot_v))
}

/// `π f` for a lamp at the lens, where l = v = h: the highlight in units of albedo.
///
/// `cosine` is n·l = n·v = n·h.
pub fn karis_at_lens(cosine: f32, roughness: f32) -> f32 {
    PI * karis(cosine, cosine, cosine, 1.0, roughness)
}

/// `f32::clamp` keeps NaN where `min` and `max` would not: unknown must stay unknown.
fn raised(roughness: f32) -> f32 {
    roughness.clamp(ROUGHNESS_FLOOR, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lobe_equals_the_formula_evaluated_elsewhere() {
        struct Case {
            arguments: [f32; 5],
            expected: f32,
        }
        // From tests/golden/karis.py (Python floats, the formula as printed above).
        let cases = [
            Case {
                arguments: [1.0, 1.0, 1.0, 1.0, 0.2],
                expected: 2.4947412e+00,
            },
            Case {
                arguments: [1.0, 1.0, 1.0, 1.0, 1.0],
                expected: 3.991_586e-3,
            },
            Case {
                arguments: [0.8, 0.6, 0.95, 0.7, 0.3],
                expected: 5.583_803e-3,
            },
            Case {
                arguments: [0.3, 0.9, 0.7, 0.75, 0.6],
                expected: 3.3956978e-03,
            },
            Case {
                arguments: [0.05, 0.1, 0.999, 0.02, 0.15],
                expected: 1.136_196e2,
            },
            Case {
                arguments: [0.5, 0.5, 0.2, 0.4, 0.9],
                expected: 1.2642827e-02,
            },
            Case {
                arguments: [0.99, 0.98, 0.9999, 0.99, 0.05],
                expected: 6.020_662e-1,
            },
        ];
        for Case {
            arguments: [l, v, h, vh, r],
            expected,
        } in cases
        {
            let got = karis(l, v, h, vh, r);
            // f32 against f64: a few roundings.
            assert!(
                (got / expected - 1.0).abs() < 1e-5,
                "{l} {v} {h} {vh} {r}: {got} ≠ {expected}"
            );
        }
    }

    #[test]
    fn nothing_shines_from_behind_and_unknown_stays_unknown() {
        assert_eq!(karis(-0.1, 0.5, 0.5, 0.5, 0.5), 0.0);
        assert_eq!(karis(0.5, 0.0, 0.5, 0.5, 0.5), 0.0);
        assert!(karis(0.5, 0.5, f32::NAN, 0.5, 0.5).is_nan());
        assert!(karis(0.5, 0.5, 0.5, 0.5, f32::NAN).is_nan());
    }

    proptest! {
        #[test]
        fn lamp_and_camera_may_change_places(
            l in 0.01f32..1.0, v in 0.01f32..1.0, h in 0.0f32..1.0, vh in 0.0f32..1.0, r in 0.0f32..1.0,
        ) {
            prop_assert_eq!(karis(l, v, h, vh, r), karis(v, l, h, vh, r));
        }

        #[test]
        fn lobe_is_finite_and_not_negative(
            l in 0.0f32..1.0, v in 0.0f32..1.0, h in 0.0f32..1.0, vh in 0.0f32..1.0, r in 0.0f32..1.0,
        ) {
            let f = karis(l, v, h, vh, r);
            prop_assert!(f.is_finite() && f >= 0.0);
        }
    }
}
