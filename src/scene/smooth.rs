//! Depth smoothed as far as its own noise asks, and not across edges.

use super::windows::{Window, blocks, halved, windows};
use drivers::Plane;
use rayon::prelude::*;

/// 1/z with its variance; NaN = unknown. On the image of a plane 1/z is linear, so straight
/// surfaces are straight here whatever their slant.
#[derive(Debug, Clone)]
pub(super) struct InverseDepth {
    /// 1/z in 1/metres.
    pub value: Plane<f32>,
    /// Variance of `value`.
    pub variance: Plane<f32>,
}

/// Depth whose slopes are known better than differences of neighbours would tell.
#[derive(Debug, Clone)]
pub(super) struct Smoothed {
    /// 1/z.
    pub depth: InverseDepth,
    /// Change of 1/z per pixel to the right and down.
    pub slope: Plane<[f32; 2]>,
    /// Variance of either slope.
    pub slope_variance: Plane<f32>,
}

/// Sizes of windows, each twice the one before.
const SIZES: usize = 6;

/// The quietest windows of a picture, of which at least this share is taken to show plain surface
/// and noise alone.
const PLAIN_SHARE: f32 = 0.1;

/// A window shows no more than noise up to this multiple of the quietest windows' misfit…
const NOISE_MARGIN: f32 = 1.7;

/// …and up to so many times more where its smallest windows are that much noisier as well: dark or
/// slanted surface.
const MOST_NOISY: f32 = 2.5;

/// Sigmas are believed within this factor of the median when pixels are compared.
pub(super) const MOST_DOUBT: f32 = 4.0;

/// Growth of noise from one size of window to the next, at most: beyond it (bent surfaces leave their
/// plane four times as far with every doubling) even the quietest windows show shape.
const STEEPEST_GROWTH: f32 = 3.0;

/// Windows of one size and what they say about its noise.
struct Size {
    /// Half a window, pixels.
    side: usize,
    windows: Plane<Window>,
    /// Misfit of plain surface, in stated sigmas.
    noise: f32,
    /// How much noisier a window is than the quietest, 1 to [`MOST_NOISY`].
    noisier: Plane<f32>,
    /// Variance of a window's own value at its centre, in stated sigmas.
    variance: f32,
    /// 1 where the windows of half the size agree with a window's plane, 0 where they contradict it.
    agrees: Plane<f32>,
}

/// Smooths by the planes of windows: every pixel takes the largest windows around it that show a
/// plane and noise, and nothing else.
///
/// Four windows of each size cover a pixel. Each counts by how near its centre is, by whether its
/// misfit can be noise, and by whether the pixel itself lies on its plane; beside an edge or a fold
/// that leaves the windows on the pixel's own side (Kuwahara 1976). What is left to the smallest
/// size goes by misfit alone. How much misfit is noise is asked of the picture at every size
/// anew, because depth cameras err alike over many pixels (level-dependent thresholds for correlated
/// noise: Johnstone & Silverman 1997). `side` is half the smallest window in pixels, `strength`
/// multiplies the noise found. Unknown pixels stay unknown.
pub(super) fn smooth(
    value: &Plane<f32>,
    sigma: &Plane<f32>,
    side: usize,
    strength: f32,
) -> Smoothed {
    let (width, height) = value.size();
    let usual = median(sigma);
    // `clamp` keeps NaN.
    let doubt = sigma.map(|s| s.clamp(usual / MOST_DOUBT, usual * MOST_DOUBT));
    let sizes = sizes(value, &doubt, side, strength);
    let mut smoothed = Smoothed {
        depth: InverseDepth {
            value: Plane::filled(width, height, f32::NAN),
            variance: Plane::filled(width, height, f32::NAN),
        },
        slope: Plane::filled(width, height, [f32::NAN; 2]),
        slope_variance: Plane::filled(width, height, f32::NAN),
    };
    let out = smoothed
        .depth
        .value
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .zip(
            smoothed
                .depth
                .variance
                .samples_mut()
                .par_chunks_mut(width.max(1)),
        )
        .zip(smoothed.slope.samples_mut().par_chunks_mut(width.max(1)))
        .zip(
            smoothed
                .slope_variance
                .samples_mut()
                .par_chunks_mut(width.max(1)),
        );
    out.enumerate().for_each_init(
        || vec![Blend::default(); width],
        |blends, (y, (((values, variances), slopes), slope_variances))| {
            blends.fill(Blend::default());
            for (i, size) in sizes.iter().enumerate().rev() {
                size.blend(y, value.row(y), doubt.row(y), i == 0, blends);
            }
            for (x, blend) in blends.iter().enumerate() {
                if value[(x, y)].is_nan() || blend.taken <= 0.0 {
                    continue;
                }
                let share = 1.0 / blend.taken;
                // Comparisons were made with sigmas kept within reason; what comes out is honest.
                let sigma = sigma[(x, y)].max(doubt[(x, y)]);
                let most = blend.most_moved * doubt[(x, y)];
                // Not `clamp`, which panics where absurd depth leaves no bounds.
                values[x] = (share * blend.value)
                    .max(value[(x, y)] - most)
                    .min(value[(x, y)] + most);
                variances[x] = share * blend.variance * sigma * sigma;
                slopes[x] = blend.slope.map(|slope| share * slope);
                slope_variances[x] = share * blend.slope_variance * sigma * sigma;
            }
        },
    );
    smoothed
}

fn sizes(value: &Plane<f32>, sigma: &Plane<f32>, mut side: usize, strength: f32) -> Vec<Size> {
    let (width, height) = value.size();
    let mut moments = blocks(value, sigma, side);
    let mut sizes: Vec<Size> = Vec::with_capacity(SIZES);
    while sizes.is_empty() || sizes.len() < SIZES && 4 * side <= width.min(height) {
        let windows = windows(&moments, side);
        // Noise that two sizes of window share cannot be smaller in the larger one.
        let samples = SAMPLES * 4f32.powi(sizes.len() as i32);
        let quiet = (strength * quiet(&windows) / quiet_share(samples)).max(1e-4);
        let noise = sizes.last().map_or(quiet, |last| {
            quiet.clamp(last.noise, last.noise * STEEPEST_GROWTH)
        });
        let noisier = match sizes.last() {
            // Steps are bounded here, lest an edge makes all around it pass for noisy.
            None => windows.map(|window| (window.misfit / noise).clamp(0.5, MOST_NOISY).ln()),
            Some(last) => averaged(&last.noisier, windows.size()),
        };
        let agrees = windows.map(|_| 1.0);
        sizes.push(Size {
            side,
            windows,
            noise,
            noisier,
            variance: 0.0,
            agrees,
        });
        moments = halved(&moments);
        side *= 2;
    }
    for i in 0..sizes.len() {
        // What larger windows see beyond the misfit of this size is this size's own error.
        let beyond = sizes.get(i + 1).map_or(0.0, |next| {
            next.noise * next.noise - sizes[i].noise * sizes[i].noise
        });
        let independent = SAMPLES * 4f32.powi(i as i32);
        sizes[i].variance = beyond.max(sizes[i].noise * sizes[i].noise / independent);
        sizes[i].noisier = sizes[i].noisier.map(|log| log.exp().clamp(1.0, MOST_NOISY));
        if i > 0 {
            let agrees = sizes[i].agreement(&sizes[i - 1]);
            sizes[i].agrees = agrees;
        }
    }
    sizes
}

/// Misfit of the quietest windows that are all known; 0 without any.
fn quiet(windows: &Plane<Window>) -> f32 {
    let mut misfits: Vec<f32> = windows
        .samples()
        .iter()
        .filter(|window| window.fill > 0.9 && !window.misfit.is_nan())
        .map(|window| window.misfit)
        .collect();
    if misfits.is_empty() {
        return 0.0;
    }
    let rank = (PLAIN_SHARE * (misfits.len() - 1) as f32) as usize;
    *misfits.select_nth_unstable_by(rank, f32::total_cmp).1
}

/// What the quietest windows show of white noise when a plane is fitted to so many samples: the root
/// of the [`PLAIN_SHARE`] quantile of χ² over its samples (Wilson & Hilferty 1931).
fn quiet_share(samples: f32) -> f32 {
    /// Standard deviations below the mean at which that share lies.
    const QUANTILE: f32 = 1.2816;
    let freedom = samples - 3.0;
    let spread = 2.0 / (9.0 * freedom);
    (freedom / samples * (1.0 - spread - QUANTILE * spread.sqrt()).powi(3)).sqrt()
}

/// Means over the 3×3 smaller windows around the centre of each larger one; NaN without any.
fn averaged(fine: &Plane<f32>, (across, down): (usize, usize)) -> Plane<f32> {
    Plane::from_fn(across, down, |i, j| {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in (2 * j).saturating_sub(1)..=2 * j + 1 {
            for x in (2 * i).saturating_sub(1)..=2 * i + 1 {
                if let Some(value) = fine.get(x, y).filter(|value| !value.is_nan()) {
                    sum += value;
                    count += 1.0;
                }
            }
        }
        sum / count
    })
}

/// Median of the known, positive sigmas of a sparse set of pixels; 1 without any.
pub(super) fn median(sigma: &Plane<f32>) -> f32 {
    let step = (sigma.len() / 20_000).max(1);
    let mut known: Vec<f32> = sigma
        .samples()
        .iter()
        .step_by(step)
        .copied()
        .filter(|&s| s > 0.0 && s.is_finite())
        .collect();
    if known.is_empty() {
        return 1.0;
    }
    let middle = known.len() / 2;
    *known.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// What windows have said about a pixel so far, each sum over the share `taken`.
#[derive(Debug, Clone, Copy, Default)]
struct Blend {
    taken: f32,
    value: f32,
    slope: [f32; 2],
    variance: f32,
    slope_variance: f32,
    /// How far a pixel may be moved from what was measured there, in stated sigmas.
    most_moved: f32,
}

/// Windows agree within so many standard deviations of the smaller one.
const AGREES: f32 = 2.0;

/// Independent samples in the smallest window, at least: it spans three of the depth camera's pixels.
const SAMPLES: f32 = 9.0;

/// Averaging is believed to help as far as so many independent samples would: no lens is known
/// better.
const MOST_SAMPLES: f32 = 64.0;

/// A pixel lies on a window's plane within this many times the noise.
const MOST_OFF: f32 = 4.5;

/// What lies on no plane, a rim or something too thin for any window, is moved by so many times the
/// noise at most.
const MOST_MOVED: f32 = 1.0;

/// A pixel of which so much is taken needs no smaller window.
const ENOUGH: f32 = 0.99;

/// From so many times the noise on, a window's misfit is a step between surfaces, and its slope that
/// of no surface: what is seen only in such windows is taken to face the camera.
const STEP: f32 = 5.0;

/// Weight of windows at which they take all of a pixel.
const FULL: f32 = 0.3;

impl Size {
    /// How far windows of half the size, whose values are known to a fraction of a pixel's noise,
    /// bear this size's planes out: it is here that a bend shows first (Lepski 1990).
    fn agreement(&self, fine: &Self) -> Plane<f32> {
        let (across, down) = self.windows.size();
        Plane::from_fn(across, down, |i, j| {
            let window = self.windows[(i, j)];
            let (mut squares, mut count) = (0.0, 0.0);
            for y in (2 * j).saturating_sub(1)..=2 * j + 1 {
                for x in (2 * i).saturating_sub(1)..=2 * i + 1 {
                    let Some(part) = fine.windows.get(x, y).filter(|part| part.fill > 0.5) else {
                        continue;
                    };
                    let off = part.value - window.at(part.center[0], part.center[1]);
                    let noisier = fine.noisier[(x, y)];
                    let variance = fine.variance * noisier * noisier * part.sigma * part.sigma;
                    squares += off * off / variance;
                    count += 1.0;
                }
            }
            if count > 0.0 {
                falling((squares / count).sqrt(), AGREES, 2.0 * AGREES)
            } else {
                1.0
            }
        })
    }

    /// Adds this size's windows to the pixels of row `y`, for what larger ones have left;
    /// `all` leaves nothing.
    fn blend(&self, y: usize, value: &[f32], sigma: &[f32], all: bool, blends: &mut [Blend]) {
        let side = self.side;
        let (j, down) = (y / side, ((y % side) as f32 + 0.5) / side as f32);
        for (i, span) in blends.chunks_mut(side).enumerate() {
            if span.iter().all(|blend| blend.taken > ENOUGH) {
                continue;
            }
            let around = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].map(|at| {
                let window = self.windows[at];
                let noise = NOISE_MARGIN * self.noise * self.noisier[at];
                let weight = if !window.misfit.is_finite() {
                    0.0
                } else if all {
                    window.fill / (window.misfit / noise).max(0.5).powi(4)
                } else {
                    self.agrees[at]
                        * falling(window.misfit / noise, 0.9, 1.6)
                        * (2.0 * window.fill - 0.25).clamp(0.0, 1.0)
                };
                (window, noise, weight)
            });
            let around = around.map(|(window, noise, weight)| {
                // Nothing of an empty window may reach the sums: 0 · NaN is NaN.
                if weight > 0.0 {
                    (window, noise, weight)
                } else {
                    let nothing = Window {
                        center: [0.0; 2],
                        value: 0.0,
                        slope: [0.0; 2],
                        misfit: 0.0,
                        sigma: 1.0,
                        fill: 0.0,
                    };
                    (nothing, 1.0, 0.0)
                }
            });
            let most_moved = if all {
                MOST_MOVED * self.noise
            } else {
                let noisiest = around.iter().map(|&(_, noise, _)| noise);
                MOST_OFF * noisiest.fold(0.0, f32::max)
            };
            if around.iter().all(|&(_, _, weight)| weight <= 0.0) {
                continue;
            }
            for (k, blend) in span.iter_mut().enumerate() {
                let x = i * side + k;
                let across = (k as f32 + 0.5) / side as f32;
                let near = [
                    (1.0 - across) * (1.0 - down),
                    across * (1.0 - down),
                    (1.0 - across) * down,
                    across * down,
                ];
                let (mut weights, mut sum, mut slope) = (0.0, 0.0, [0.0; 2]);
                for (&(window, noise, weight), near) in around.iter().zip(near) {
                    let on_plane = window.at(x as f32, y as f32);
                    let off = (value[x] - on_plane).abs() / (sigma[x] * noise);
                    let own = if all {
                        1.0 / off.max(1.0).powi(4).min(1e12)
                    } else {
                        falling(off, 2.5, MOST_OFF)
                    };
                    let weight = near * weight * own;
                    weights += weight;
                    sum += weight * on_plane;
                    let weight = weight * falling(window.misfit / noise, STEP, 2.0 * STEP);
                    slope[0] += weight * window.slope[0];
                    slope[1] += weight * window.slope[1];
                }
                if weights > 0.0 {
                    let share = if all { 1.0 } else { (weights / FULL).min(1.0) };
                    let share = (1.0 - blend.taken) * share;
                    let per_weight = share / weights;
                    blend.taken += share;
                    blend.value += per_weight * sum;
                    blend.most_moved = blend.most_moved.max(most_moved);
                    blend.slope[0] += per_weight * slope[0];
                    blend.slope[1] += per_weight * slope[1];
                    let variance = self.variance.max(self.noise * self.noise / MOST_SAMPLES);
                    blend.variance += share * variance;
                    blend.slope_variance += share * variance / (side * side) as f32;
                }
            }
        }
    }
}

/// 1 up to `low`, 0 from `high` on, smooth between; 0 for NaN.
fn falling(t: f32, low: f32, high: f32) -> f32 {
    let u = ((high - t) / (high - low)).clamp(0.0, 1.0);
    if u > 0.0 {
        u * u * (3.0 - 2.0 * u)
    } else {
        0.0
    }
}
