//! How noisy the depth really is, asked of the depth itself.

use drivers::Plane;
use rayon::prelude::*;

/// Pixels looked at at most: the median of so many is good to half a percent.
const SAMPLES: usize = 60_000;

/// What the depth itself says about its noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    /// Noise as a multiple of the sigma it was said to have.
    pub ratio: f32,
    /// Pixels from which on two samples err independently: more than one where a coarser grid was
    /// interpolated, or the depth camera smooths.
    pub spacing: usize,
}

/// A spacing is wide enough when it shows this share of the noise.
const INDEPENDENT_SHARE: f32 = 0.7;

/// Noise of `inverse` (1/z) against the `sigma` it is said to have, looked for at the spacings
/// `steps` (pixels, rising); `None` when no pixel has its neighbours.
///
/// The median of the mixed second difference, [1 −2 1] across and down, which is blind to planes
/// and quadratics, over its response to white noise (6 sigma; Immerkær 1996).
pub(super) fn noise(inverse: &Plane<f32>, sigma: &Plane<f32>, steps: &[usize]) -> Option<Noise> {
    let found: Vec<(usize, f32)> = steps
        .iter()
        .filter_map(|&step| Some((step, ratio_at(inverse, sigma, step)?)))
        .collect();
    let ratio = found.iter().map(|&(_, ratio)| ratio).reduce(f32::max)?;
    let spacing = found
        .iter()
        .find(|&&(_, r)| r >= INDEPENDENT_SHARE * ratio)?
        .0;
    Some(Noise { ratio, spacing })
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
    fn error(x: usize, y: usize) -> f32 {
        let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        h ^= h >> 15;
        (h as f32 / u32::MAX as f32 - 0.5) * 12f32.sqrt()
    }

    #[test]
    fn noise_on_a_slanted_curved_surface_is_measured_to_a_tenth() {
        let clean = |x: usize, y: usize| 0.7 + 1e-3 * x as f32 + 1e-5 * (y * y) as f32;
        let inverse = Plane::from_fn(96, 80, |x, y| clean(x, y) + 0.01 * error(x, y));
        let said = Plane::filled(96, 80, 0.02);
        let found = noise(&inverse, &said, &[1, 2]).unwrap();
        assert!(
            (found.ratio - 0.5).abs() < 0.05 && found.spacing == 1,
            "{found:?}"
        );
        let quiet = noise(&Plane::from_fn(96, 80, clean), &said, &[1, 2]).unwrap();
        assert!(quiet.ratio < 1e-3, "{quiet:?}");
    }

    #[test]
    fn noise_of_a_coarser_grid_is_seen_at_its_spacing() {
        // Samples every 4 pixels, linear between them.
        let inverse = Plane::from_fn(240, 160, |x, y| {
            let (i, j, s, t) = (x / 4, y / 4, (x % 4) as f32 / 4.0, (y % 4) as f32 / 4.0);
            let top = (1.0 - s) * error(i, j) + s * error(i + 1, j);
            let bottom = (1.0 - s) * error(i, j + 1) + s * error(i + 1, j + 1);
            1.0 + 0.01 * ((1.0 - t) * top + t * bottom)
        });
        let found = noise(&inverse, &Plane::filled(240, 160, 0.01), &[1, 2, 4]).unwrap();
        assert_eq!(found.spacing, 4);
        // Between its samples an interpolated grid errs less than at them.
        assert!((0.3..1.0).contains(&found.ratio), "{found:?}");
    }

    #[test]
    fn depth_without_neighbours_has_no_answer() {
        let one = Plane::filled(1, 1, 1.0);
        assert_eq!(noise(&one, &one, &[1]), None);
        let unknown = Plane::filled(9, 9, f32::NAN);
        assert_eq!(noise(&unknown, &unknown, &[1]), None);
    }
}
