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

/// Noise has shown itself whole where twice the spacing shows less than so many times as much: relief
/// grows by four and more.
const SATURATED: f32 = 1.75;

/// Spread of logarithms, squared, below which nothing is learnt of what noise follows.
const RIDGE: f64 = 0.01;

/// Spacings at which errors may turn independent, pixels.
const SPACINGS: [usize; 5] = [1, 2, 4, 8, 16];

/// Errors that are alike over several pixels, as a camera leaves that smooths.
#[derive(Debug, Clone)]
pub(super) struct DenseNoise {
    /// Standard deviation that white noise would have at one pixel if its mean over a large area were as
    /// uncertain as that of the errors found.
    pub sigma: Plane<f32>,
    /// Standard deviation of the blur that makes such errors out of white noise, pixels; 0 = they are white.
    pub blur: f32,
}

/// Noise of `inverse` (1/z) that has shown itself whole at some spacing; `None` when it goes over into
/// relief without a gap. `sigma` is what it is said to be: how far it follows that, and how far the distance,
/// is asked of the depth too.
pub(super) fn dense_noise(inverse: &Plane<f32>, sigma: &Plane<f32>) -> Option<DenseNoise> {
    let mut halfway = None;
    let mut here = ratio_at(inverse, sigma, SPACINGS[0])?;
    for pair in SPACINGS.windows(2) {
        let twice = ratio_at(inverse, sigma, pair[1])?;
        if here > 0.0 && twice < SATURATED * here {
            let blur = halfway.map_or(0.0, |share| blur(share, 0.5 * pair[0] as f32));
            // White noise blurred by s pixels keeps 1 / (4 π s²) of its variance.
            let dense = (2.0 * std::f32::consts::PI.sqrt() * blur).max(1.0);
            let found = follow(inverse, sigma, pair[0])?;
            return Some(DenseNoise {
                sigma: found.map(|s| dense * s),
                blur,
            });
        }
        halfway = Some(here / twice);
        here = twice;
    }
    None
}

/// Noise at every pixel by the law log noise = a + b log `sigma` + c log `inverse` that fits the second
/// differences at spacing `step` best: a stated sigma may be of another camera, or of light that has changed.
fn follow(inverse: &Plane<f32>, sigma: &Plane<f32>, step: usize) -> Option<Plane<f32>> {
    let known: Vec<[f64; 3]> = mixed_differences(inverse, step)
        .filter_map(|(x, y, mixed)| {
            let place = (x, y);
            let row = [
                f64::from(sigma[place]).ln(),
                f64::from(inverse[place]).ln(),
                f64::from(mixed / 6.0).ln(),
            ];
            row.iter().all(|v| v.is_finite()).then_some(row)
        })
        .collect();
    let count = known.len() as f64;
    let mean: [f64; 3] =
        std::array::from_fn(|i| known.iter().map(|row| row[i]).sum::<f64>() / count);
    let product = |i: usize, j: usize| {
        known
            .iter()
            .map(|row| (row[i] - mean[i]) * (row[j] - mean[j]))
            .sum::<f64>()
            / count
    };
    let (ss, ww, sw) = (product(0, 0) + RIDGE, product(1, 1) + RIDGE, product(0, 1));
    // Without evidence it is as stated.
    let (sm, wm) = (product(0, 2) + RIDGE, product(1, 2));
    let determinant = ss * ww - sw * sw;
    let of_sigma = ((sm * ww - wm * sw) / determinant).clamp(0.0, 1.0) as f32;
    let of_inverse = ((wm - f64::from(of_sigma) * sw) / ww).clamp(-3.0, 3.0) as f32;
    let (width, height) = inverse.size();
    let mut law = Plane::filled(width, height, f32::NAN);
    law.samples_mut()
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, law)| {
            *law = sigma.samples()[i].powf(of_sigma) * inverse.samples()[i].powf(of_inverse);
        });
    let ratio = ratio_at(inverse, &law, step)?;
    Some(law.map(|s| ratio * s))
}

/// Standard deviation of the blur, pixels, when the second differences of noise at `distance` pixels show
/// this `share` of what independent errors would.
fn blur(share: f32, distance: f32) -> f32 {
    // Correlation r at the distance is r⁴ at twice the distance; [1 −2 1] then leaves 6 − 8 r + 2 r⁴ of a
    // variance of 6, along either axis.
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        let left = (6.0 - 8.0 * middle + 2.0 * middle.powi(4)) / 6.0;
        if left > share {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * distance / (-high.max(1e-6).ln()).max(1e-6).sqrt()
}

/// Mixed second differences at a spacing, with their places; pixels without neighbours give NaN.
fn mixed_differences(
    inverse: &Plane<f32>,
    step: usize,
) -> impl Iterator<Item = (usize, usize, f32)> {
    let (width, height) = inverse.size();
    let across = width.saturating_sub(2 * step);
    let inner = across * height.saturating_sub(2 * step);
    let stride = inner.div_ceil(SAMPLES).max(1);
    (0..inner).step_by(stride).map(move |i| {
        let (x, y) = (step + i % across, step + i / across);
        let row =
            |y: usize| inverse[(x - step, y)] - 2.0 * inverse[(x, y)] + inverse[(x + step, y)];
        (x, y, (row(y - step) - 2.0 * row(y) + row(y + step)).abs())
    })
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
pub(super) mod tests {
    use super::*;
    use drivers::chance::Chance;

    /// White noise of unit variance under a Gaussian blur of one pixel.
    pub fn blurred_noise(width: usize, height: usize) -> Plane<f32> {
        let chance = Chance::new(5);
        let white = Plane::from_fn(width, height, |x, y| chance.normal((y * width + x) as u64));
        let kernel = [
            0.00443, 0.05401, 0.24204, 0.39905, 0.24204, 0.05401, 0.00443,
        ];
        let along = |plane: &Plane<f32>, dx: usize, dy: usize| {
            Plane::from_fn(width, height, |x, y| {
                let taps = kernel.iter().enumerate().map(|(i, weight)| {
                    let at = |at: usize, step: usize, size: usize| {
                        (at + i * step).saturating_sub(3 * step).min(size - 1)
                    };
                    weight * plane[(at(x, dx, width), at(y, dy, height))]
                });
                taps.sum()
            })
        };
        along(&along(&white, 1, 0), 0, 1)
    }

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
    fn smoothed_noise_is_measured_with_its_blur_and_how_it_goes_with_distance() {
        // Noise the same in metres, hence as 1/z², on depth that is said to err as 1/z.
        let clean = Plane::from_fn(256, 192, |_, y| 0.4 + 0.003 * y as f32);
        let noise = blurred_noise(256, 192);
        let inverse = Plane::from_fn(256, 192, |x, y| {
            let w = clean[(x, y)];
            w + 0.02 * w * w * noise[(x, y)]
        });
        let found = dense_noise(&inverse, &clean.map(|w| 0.001 * w)).unwrap();
        assert!((found.blur - 1.0).abs() < 0.1, "{}", found.blur);
        // Some 4000 independent errors tell a power of w, over a factor of 2.4, to 0.1.
        for y in [5, 95, 186] {
            let white = 0.02 * clean[(128, y)].powi(2);
            let ratio = found.sigma[(128, y)] / white;
            assert!((ratio - 1.0).abs() < 0.15, "row {y}: {ratio}");
        }
    }

    #[test]
    fn relief_is_not_taken_for_smoothed_noise() {
        let relief = Plane::from_fn(128, 128, |x, y| {
            1.0 + 0.01 * (x as f32 / 12.0).sin() * (y as f32 / 14.0).cos()
        });
        assert!(dense_noise(&relief, &relief.map(|_| 0.001)).is_none());
    }

    #[test]
    fn depth_without_neighbours_has_no_answer() {
        let one = Plane::filled(1, 1, 1.0);
        assert_eq!(noise(&one, &one, &[1]), None);
        assert!(dense_noise(&one, &one).is_none());
        let unknown = Plane::filled(9, 9, f32::NAN);
        assert_eq!(noise(&unknown, &unknown, &[1]), None);
        assert!(dense_noise(&unknown, &unknown).is_none());
    }
}
