//! How noisy the depth really is, asked of the depth itself.

use drivers::Plane;
use rayon::prelude::*;

/// Pixels looked at at most: the median of so many is good to half a percent.
const SAMPLES: usize = 60_000;

/// Noise of `inverse` (1/z) as a multiple of the `sigma` it is said to have, at the spacings
/// `steps` (pixels), the largest of them; `None` when no pixel has its neighbours.
///
/// The median of the mixed second difference, [1 −2 1] across and down, which is blind to planes
/// and quadratics, over its response to white noise (6 sigma; Immerkær 1996). A spacing above the
/// grid of the depth camera sees noise that interpolation has smeared.
pub(super) fn noise_ratio(
    inverse: &Plane<f32>,
    sigma: &Plane<f32>,
    steps: &[usize],
) -> Option<f32> {
    steps
        .iter()
        .filter_map(|&step| ratio_at(inverse, sigma, step))
        .reduce(f32::max)
}

fn ratio_at(inverse: &Plane<f32>, sigma: &Plane<f32>, step: usize) -> Option<f32> {
    let (width, height) = inverse.size();
    if step == 0 || width <= 2 * step || height <= 2 * step {
        return None;
    }
    let inner = (width - 2 * step) * (height - 2 * step);
    let stride = inner.div_ceil(SAMPLES).max(1);
    let mut ratios: Vec<f32> = (0..inner.div_ceil(stride))
        .into_par_iter()
        .filter_map(|i| {
            let i = i * stride;
            let x = step + i % (width - 2 * step);
            let y = step + i / (width - 2 * step);
            let across =
                |y: usize| inverse[(x - step, y)] - 2.0 * inverse[(x, y)] + inverse[(x + step, y)];
            let mixed = across(y - step) - 2.0 * across(y) + across(y + step);
            let ratio = mixed.abs() / (6.0 * sigma[(x, y)]);
            ratio.is_finite().then_some(ratio)
        })
        .collect();
    if ratios.is_empty() {
        return None;
    }
    let middle = ratios.len() / 2;
    let (_, median, _) = ratios.select_nth_unstable_by(middle, f32::total_cmp);
    // Median of |x| for a unit normal.
    Some(*median / 0.674_49)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cheap hash to ±√3, uniform with unit variance.
    fn noise(x: usize, y: usize) -> f32 {
        let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        h ^= h >> 15;
        (h as f32 / u32::MAX as f32 - 0.5) * 12f32.sqrt()
    }

    #[test]
    fn noise_on_a_slanted_curved_surface_is_measured_to_a_tenth() {
        let clean = |x: usize, y: usize| 0.7 + 1e-3 * x as f32 + 1e-5 * (y * y) as f32;
        let inverse = Plane::from_fn(96, 80, |x, y| clean(x, y) + 0.01 * noise(x, y));
        let said = Plane::filled(96, 80, 0.02);
        let ratio = noise_ratio(&inverse, &said, &[1, 2]).unwrap();
        assert!((ratio - 0.5).abs() < 0.05, "{ratio}");
        let quiet = noise_ratio(&Plane::from_fn(96, 80, clean), &said, &[1, 2]).unwrap();
        assert!(quiet < 1e-3, "{quiet}");
    }

    #[test]
    fn depth_without_neighbours_has_no_answer() {
        let one = Plane::filled(1, 1, 1.0);
        assert_eq!(noise_ratio(&one, &one, &[1]), None);
        let unknown = Plane::filled(9, 9, f32::NAN);
        assert_eq!(noise_ratio(&unknown, &unknown, &[1]), None);
    }
}
