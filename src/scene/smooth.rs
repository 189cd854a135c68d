//! Depth smoothed by its own sigma, and not across edges.

use drivers::Plane;
use rayon::prelude::*;

/// Differences beyond so many standard deviations are structure, not noise.
const REACH_SIGMAS: f32 = 3.0;

/// Sigmas are believed up to this many medians when neighbours are compared.
const MOST_DOUBT: f32 = 4.0;

/// Most levels; the last one's taps stand 2·2^(n−1) pixels out.
const MOST_LEVELS: u32 = 6;

/// 1/z with its variance; NaN = unknown. On the image of a plane 1/z is linear, so straight
/// surfaces are straight here whatever their slant.
#[derive(Debug, Clone)]
pub(super) struct InverseDepth {
    /// 1/z in 1/metres.
    pub value: Plane<f32>,
    /// Variance of `value`.
    pub variance: Plane<f32>,
}

/// Levels of smoothing after which a slope read between neighbours is good to a few percent:
/// `noise_in_pitches` is the noise of a pixel's depth divided by the distance between pixels on
/// the surface, and each level divides the noise of slopes by about four.
pub(super) fn levels_for(noise_in_pitches: f32) -> u32 {
    const WANTED: f32 = 0.02;
    if noise_in_pitches.is_nan() || noise_in_pitches <= WANTED {
        return 0;
    }
    ((noise_in_pitches / WANTED).ln() / 4f32.ln())
        .ceil()
        .min(MOST_LEVELS as f32) as u32
}

/// Smooths by an à-trous B3 spline, each level across and then down (Dammertz et al. 2010).
///
/// Taps are taken in pairs left and right of a pixel and judged by their *mean*, so that a slant
/// costs nothing; a pair that contradicts the pixel by over three sigma is given up for whichever
/// of its taps agrees alone. Weights are Tukey's, over the variance of the tap. A sigma far above
/// the picture's median (filled gaps, silhouettes) counts as [`MOST_DOUBT`] medians here, lest
/// pixels that doubt themselves agree with every surface around. Unknown pixels stay unknown. The first level's
/// taps stand `spacing` pixels apart, where noise is independent; what is finer than that is
/// smoothed last, and gains no certainty.
pub(super) fn smooth(mut depth: InverseDepth, levels: u32, spacing: usize) -> InverseDepth {
    let (width, height) = depth.value.size();
    if width == 0 || height == 0 || levels == 0 {
        return depth;
    }
    let stated = depth.variance.clone();
    let most = MOST_DOUBT * MOST_DOUBT * median(&depth.variance);
    // `clamp` keeps NaN.
    depth.variance = depth.variance.map(|variance| variance.clamp(0.0, most));
    let mut next = depth.clone();
    let independent = (0..levels).map(|level| (spacing << level, true));
    let finer = (0..spacing.ilog2()).rev().map(|level| (1 << level, false));
    for (step, gains) in independent.chain(finer) {
        for across in [true, false] {
            pass(&depth, &mut next, step, across, gains);
            std::mem::swap(&mut depth, &mut next);
        }
    }
    for (variance, stated) in depth
        .variance
        .samples_mut()
        .iter_mut()
        .zip(stated.samples())
    {
        *variance *= (stated / most).max(1.0);
    }
    depth
}

/// Median of the known, positive variances of a sparse set of pixels; +∞ without any.
fn median(variance: &Plane<f32>) -> f32 {
    let step = (variance.len() / 20_000).max(1);
    let mut known: Vec<f32> = variance
        .samples()
        .iter()
        .step_by(step)
        .copied()
        .filter(|&v| v > 0.0)
        .collect();
    if known.is_empty() {
        return f32::INFINITY;
    }
    let middle = known.len() / 2;
    *known.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// One level along one axis.
fn pass(from: &InverseDepth, to: &mut InverseDepth, step: usize, across: bool, gains: bool) {
    let (width, height) = from.value.size();
    let unknown = vec![f32::NAN; width];
    let values = to.value.samples_mut().par_chunks_mut(width);
    let variances = to.variance.samples_mut().par_chunks_mut(width);
    values.zip(variances).enumerate().for_each_init(
        || [Vec::new(), Vec::new()],
        |padded, (y, (value, variance))| {
            if across {
                let rows = [from.value.row(y), from.variance.row(y)];
                for (padded, row) in padded.iter_mut().zip(rows) {
                    padded.clear();
                    padded.resize(2 * step, f32::NAN);
                    padded.extend_from_slice(row);
                    padded.resize(width + 4 * step, f32::NAN);
                }
                let taps = [0, 1, 2, 3, 4].map(|i| {
                    let span = i * step..i * step + width;
                    [&padded[0][span.clone()], &padded[1][span]]
                });
                blend(taps, value, variance);
            } else {
                let taps =
                    [-2isize, -1, 0, 1, 2].map(|i| match y.checked_add_signed(i * step as isize) {
                        Some(row) if row < height => [from.value.row(row), from.variance.row(row)],
                        _ => [&unknown[..], &unknown[..]],
                    });
                blend(taps, value, variance);
            }
            if !gains {
                variance.copy_from_slice(from.variance.row(y));
            }
        },
    );
}

/// Blends five rows of (value, variance), the middle one being the pixel's own.
fn blend(taps: [[&[f32]; 2]; 5], value: &mut [f32], variance: &mut [f32]) {
    // Slices of one length let the compiler work on many pixels at once.
    let count = value.len().min(variance.len());
    let taps = taps.map(|tap| tap.map(|row| &row[..count]));
    for x in 0..count {
        let [center, own] = taps[2].map(|row| row[x]);
        let mut sum = Sum {
            weight: 6.0,
            value: 6.0 * center,
            variance: 36.0 * own,
            own,
        };
        for (near, far, weight) in [(1, 3, 8.0), (0, 4, 2.0)] {
            let a = taps[near].map(|row| row[x]);
            let b = taps[far].map(|row| row[x]);
            sum.add_pair(center, own, a, b, weight);
        }
        value[x] = sum.value / sum.weight;
        variance[x] = sum.variance / (sum.weight * sum.weight);
    }
}

/// A weighted mean in the making.
struct Sum {
    weight: f32,
    value: f32,
    variance: f32,
    /// Variance of the pixel in the middle, against which the taps' are weighed.
    own: f32,
}

impl Sum {
    fn add_pair(
        &mut self,
        center: f32,
        own: f32,
        [a, var_a]: [f32; 2],
        [b, var_b]: [f32; 2],
        weight: f32,
    ) {
        let mean = 0.5 * (a + b);
        let mean_variance = 0.25 * (var_a + var_b);
        let together = weight * tukey(mean - center, own + mean_variance);
        self.add(mean, mean_variance, together);
        // What the pair left over goes to its halves.
        let rest = 0.5 * (weight - together);
        self.add(a, var_a, rest * tukey(a - center, own + var_a));
        self.add(b, var_b, rest * tukey(b - center, own + var_b));
    }

    fn add(&mut self, value: f32, variance: f32, weight: f32) {
        // A tap without noise has nothing to be weighed against.
        let weight = if variance > 0.0 {
            weight * self.own / variance
        } else {
            weight
        };
        // NaN has weight 0, and 0 · NaN must not reach the sums.
        let counts = weight > 0.0;
        self.weight += if counts { weight } else { 0.0 };
        self.value += if counts { weight * value } else { 0.0 };
        self.variance += if counts {
            weight * weight * variance
        } else {
            0.0
        };
    }
}

/// 1 at no difference, 0 beyond [`REACH_SIGMAS`] standard deviations and for NaN.
fn tukey(difference: f32, variance: f32) -> f32 {
    let t2 = difference * difference / (REACH_SIGMAS * REACH_SIGMAS * variance);
    let weight = (1.0 - t2).max(0.0);
    weight * weight
}
