//! Does the photograph look lit from the lens?

use super::{albedo::Reflection, regions::Regions};
use drivers::Plane;

/// Share of a flash's falloff that the light must at least follow: halfway from a room's light to
/// a flash.
const LEAST_FOLLOWED: f32 = 0.5;

/// Roughness of surfaces of which no highlight tells: the middle of what is possible.
pub(super) const UNTOLD_ROUGHNESS: f32 = 0.55;

/// What is left of the confidence where the light that made the photograph is not known.
pub(super) const UNKNOWN_LIGHT: f32 = 0.3;

/// Falloff (standard deviation of its logarithm within a surface) under which nothing can be told.
const LEAST_FALLOFF: f64 = 0.1;

/// Only surfaces of so many looked-at pixels are heard.
const FEWEST: f64 = 200.0;

/// Pixels looked at, about.
const LOOKED_AT: usize = 200_000;

/// Sums over the looked-at pixels of one surface: of the logarithms of the light and of the
/// falloff (cosine / distance²) a lamp at the lens would show.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    light: f64,
    falloff: f64,
    product: f64,
    square: f64,
}

/// How much of a flash's falloff over each surface the light follows: about 1 under a flash at the
/// lens, about 0 under a room's light; `None` where distances and slants hardly differ. Within one
/// surface, because near things may well be darker than what is behind them.
pub(super) fn followed(
    light: &Plane<[f32; 3]>,
    reflections: &Plane<Reflection>,
    regions: &Regions,
) -> Option<f32> {
    let mut surfaces = vec![Sums::default(); regions.count];
    let step = (light.len() / LOOKED_AT).max(1);
    let pixels = light.samples().iter().zip(reflections.samples());
    for ((light, reflection), region) in pixels.zip(regions.of.samples()).step_by(step) {
        let sum = |[r, g, b]: [f32; 3]| f64::from(r + g + b);
        let (bright, value) = (sum(*light), sum(reflection.value));
        let lit = bright > 0.0 && value > 0.0 && reflection.cosine > 0.1;
        let Some(region) = region.filter(|_| lit) else {
            continue;
        };
        let light = bright.ln();
        let falloff = light - (value / f64::from(reflection.cosine)).ln();
        let sums = &mut surfaces[region as usize];
        sums.count += 1.0;
        sums.light += light;
        sums.falloff += falloff;
        sums.product += light * falloff;
        sums.square += falloff * falloff;
    }
    let (mut count, mut product, mut square) = (0.0, 0.0, 0.0);
    for sums in surfaces.iter().filter(|sums| sums.count >= FEWEST) {
        count += sums.count;
        product += sums.product - sums.light * sums.falloff / sums.count;
        square += sums.square - sums.falloff * sums.falloff / sums.count;
    }
    (square > count * LEAST_FALLOFF * LEAST_FALLOFF).then(|| (product / square) as f32)
}

/// Whether a photograph that follows so much of a flash's falloff may be one of a flash.
pub(super) fn may_be_flash(followed: Option<f32>) -> bool {
    followed.is_none_or(|followed| followed >= LEAST_FOLLOWED)
}

/// Reflections as under a light that is the same everywhere: the photograph itself.
pub(super) fn evenly_lit(
    light: &Plane<[f32; 3]>,
    variance: &Plane<f32>,
    reflections: &Plane<Reflection>,
) -> Plane<Reflection> {
    let (width, height) = light.size();
    Plane::from_fn(width, height, |x, y| Reflection {
        value: light[(x, y)],
        variance: variance[(x, y)],
        // NaN stays: nothing is known of what has no normal.
        cosine: if reflections[(x, y)].cosine.is_nan() {
            f32::NAN
        } else {
            1.0
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor from 1 to 3 m, with a texture, under light that falls off `followed` times as a
    /// flash's would.
    fn floor(followed: f32) -> (Plane<[f32; 3]>, Plane<Reflection>, Regions) {
        let distance = |y: usize| 1.0 + 2.0 * y as f32 / 40.0;
        let light = Plane::from_fn(40, 40, |x, y| {
            let texture = if (x / 3 + y / 3) % 2 == 0 { 0.3 } else { 0.6 };
            [texture * (0.4 / distance(y).powi(2)).powf(followed); 3]
        });
        let reflections = Plane::from_fn(40, 40, |x, y| Reflection {
            value: light[(x, y)].map(|v| v * distance(y).powi(2)),
            variance: 1e-6,
            cosine: 0.4,
        });
        let of = Plane::filled(40, 40, Some(0));
        (light, reflections, Regions { of, count: 1 })
    }

    #[test]
    fn a_flash_is_told_from_a_room() {
        for (truth, flash) in [(1.0, true), (0.0, false)] {
            let (light, reflections, regions) = floor(truth);
            let found = followed(&light, &reflections, &regions);
            assert!((found.unwrap() - truth).abs() < 0.1, "{found:?}");
            assert_eq!(may_be_flash(found), flash);
        }
    }

    #[test]
    fn a_wall_that_faces_the_lens_cannot_tell() {
        let (light, mut reflections, regions) = floor(0.0);
        for reflection in reflections.samples_mut() {
            reflection.value = [0.5; 3];
        }
        let flat = light.map(|_| [0.5; 3]);
        assert_eq!(followed(&flat, &reflections, &regions), None);
        assert!(may_be_flash(None));
    }
}
