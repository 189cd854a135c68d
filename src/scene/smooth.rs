//! Depth smoothed by its own sigma, and not across edges.

use drivers::Plane;
use rayon::prelude::*;

/// Differences beyond so many standard deviations are structure, not noise.
const REACH_SIGMAS: f32 = 3.0;

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
/// of its taps agrees alone. Weights are Tukey's. Unknown pixels stay unknown. The first level's
/// taps stand `spacing` pixels apart, where noise is independent; what is finer than that is
/// smoothed last, and gains no certainty.
pub(super) fn smooth(mut depth: InverseDepth, levels: u32, spacing: usize) -> InverseDepth {
    let (width, height) = depth.value.size();
    if width == 0 || height == 0 {
        return depth;
    }
    let mut next = depth.clone();
    let independent = (0..levels).map(|level| (spacing << level, true));
    let finer = (0..spacing.ilog2()).rev().map(|level| (1 << level, false));
    let finer = finer.take(if levels > 0 { usize::MAX } else { 0 });
    for (step, gains) in independent.chain(finer) {
        for (dx, dy) in [(step, 0), (0, step)] {
            let (from, to) = (&depth, &mut next);
            let values = to.value.samples_mut().par_chunks_mut(width);
            let variances = to.variance.samples_mut().par_chunks_mut(width);
            values
                .zip(variances)
                .enumerate()
                .for_each(|(y, (value, variance))| {
                    let rows = [-2isize, -1, 0, 1, 2].map(|i| {
                        let row = y as isize + i * dy as isize;
                        (0..height as isize).contains(&row).then_some(row as usize)
                    });
                    filter_row(from, rows, dx, y, value, variance);
                    if !gains {
                        variance.copy_from_slice(from.variance.row(y));
                    }
                });
            std::mem::swap(&mut depth, &mut next);
        }
    }
    depth
}

/// One row of one pass: taps at `rows[i]`, `(i − 2)·dx` pixels along.
fn filter_row(
    from: &InverseDepth,
    rows: [Option<usize>; 5],
    dx: usize,
    y: usize,
    value: &mut [f32],
    variance: &mut [f32],
) {
    let width = value.len();
    let centers = from.value.row(y);
    let center_variances = from.variance.row(y);
    let tap = |i: usize, x: usize| -> (f32, f32) {
        let (Some(row), Some(x)) = (rows[i], (x + i * dx).checked_sub(2 * dx)) else {
            return (f32::NAN, 0.0);
        };
        if x < width {
            (from.value.row(row)[x], from.variance.row(row)[x])
        } else {
            (f32::NAN, 0.0)
        }
    };
    for x in 0..width {
        let (center, own) = (centers[x], center_variances[x]);
        let mut sum = Sum {
            weight: 6.0,
            value: 6.0 * center,
            variance: 36.0 * own,
        };
        for (near, far, weight) in [(1, 3, 8.0), (0, 4, 2.0)] {
            let (a, var_a) = tap(near, x);
            let (b, var_b) = tap(far, x);
            sum.add_pair(center, own, (a, var_a), (b, var_b), weight);
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
}

impl Sum {
    fn add_pair(
        &mut self,
        center: f32,
        own: f32,
        (a, var_a): (f32, f32),
        (b, var_b): (f32, f32),
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
        if weight > 0.0 {
            self.weight += weight;
            self.value += weight * value;
            self.variance += weight * weight * variance;
        }
    }
}

/// 1 at no difference, 0 beyond [`REACH_SIGMAS`] standard deviations and for NaN.
fn tukey(difference: f32, variance: f32) -> f32 {
    let t2 = difference * difference / (REACH_SIGMAS * REACH_SIGMAS * variance);
    let weight = (1.0 - t2).max(0.0);
    weight * weight
}
