//! What a surface does with light.

use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// Diffuse color over a surface; lengths in metres.
#[derive(Debug, Clone, Copy)]
pub(super) enum Pattern {
    Plain([f32; 3]),
    Checker([f32; 3], [f32; 3], f64),
    Stripes([f32; 3], [f32; 3], f64),
}

/// Color, gloss and infrared albedo.
#[derive(Debug, Clone, Copy)]
pub(super) struct Material {
    pub pattern: Pattern,
    /// Karis roughness in (0, 1].
    pub roughness: f32,
    /// Albedo in the ToF camera's infrared.
    pub infrared: f32,
}

impl Material {
    /// Albedo at `place`, metres from the body's anchor along its axes.
    pub fn albedo(&self, place: DVec3) -> [f32; 3] {
        match self.pattern {
            Pattern::Plain(color) => color,
            Pattern::Checker(even, odd, cell) => {
                // The shift keeps faces, which lie at round numbers, away from cell borders.
                let cells = (place / cell + 0.37).floor();
                if (cells.x + cells.y + cells.z).rem_euclid(2.0) < 0.5 {
                    even
                } else {
                    odd
                }
            }
            Pattern::Stripes(even, odd, width) => {
                if ((place.x + place.y) / width + 0.37).floor().rem_euclid(2.0) < 0.5 {
                    even
                } else {
                    odd
                }
            }
        }
    }
}

/// The axes a pattern is laid out in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement {
    pub anchor: DVec3,
    pub axes: DMat3,
}

/// Karis's microfacet reflectance (Karis 2013), without the cosine; F0 = 0.05.
///
/// `normal`, `view` and `light` are unit vectors from the surface. Zero when either is behind it.
pub(super) fn karis(normal: DVec3, view: DVec3, light: DVec3, roughness: f64) -> f64 {
    let (nv, nl) = (normal.dot(view), normal.dot(light));
    if nv <= 1e-6 || nl <= 1e-6 {
        return 0.0;
    }
    let half = (view + light).normalize();
    let (nh, vh) = (normal.dot(half).max(0.0), view.dot(half).max(0.0));
    let alpha2 = roughness.powi(4);
    let d = alpha2 / (PI * (nh * nh * (alpha2 - 1.0) + 1.0).powi(2));
    let k = (roughness + 1.0).powi(2) / 8.0;
    let g1 = |cosine: f64| cosine / (cosine * (1.0 - k) + k);
    let f = 0.05 + 0.95 * ((-5.55473 * vh - 6.98316) * vh).exp2();
    d * f * g1(nl) * g1(nv) / (4.0 * nl * nv)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn karis_is_the_same_when_eye_and_lamp_change_places() {
        let n = DVec3::Z;
        let (v, l) = (
            DVec3::new(0.3, 0.1, 0.9).normalize(),
            DVec3::new(-0.5, 0.4, 0.6).normalize(),
        );
        assert!((karis(n, v, l, 0.4) - karis(n, l, v, 0.4)).abs() < 1e-12);
    }

    #[test]
    fn karis_straight_on_is_the_closed_form() {
        // n = v = l: D = 1/(π α²), G = 1, F = 0.05 + 0.95 · 2^(−12.53789), over 4.
        let roughness: f64 = 0.5;
        let expected = (0.05 + 0.95 * (-12.53789f64).exp2()) / (PI * roughness.powi(4) * 4.0);
        let found = karis(DVec3::Z, DVec3::Z, DVec3::Z, roughness);
        assert!((found - expected).abs() < 1e-9 * expected);
    }
}
