//! Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004) on a masked picture.

use drivers::Plane;
use rayon::prelude::*;

/// Half width of the 11×11 window.
const RADIUS: usize = 5;
/// Standard deviation of the Gaussian window, pixels.
const SIGMA: f64 = 1.5;
/// Stabilisers (K₁·L)² and (K₂·L)² for values in [0, 1].
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;
/// Running means under the window: weight, a, b, a², b², ab.
const MOMENTS: usize = 6;

/// Mean structural similarity of two pictures with values in [0, 1], over channels and pixels.
///
/// Window weights fall on the pixels where `counts` is true and are normalised by their own sum,
/// so what lies outside the mask has no say; on a full mask that is the original definition. As
/// in the original the outermost five pixels of the picture, where the window would reach over
/// the edge, are not averaged. `None` when nothing is left to average.
pub(super) fn similarity(
    found: &Plane<[f32; 3]>,
    truth: &Plane<[f32; 3]>,
    counts: &Plane<bool>,
) -> Option<f64> {
    let (width, height) = counts.size();
    if width <= 2 * RADIUS || height <= 2 * RADIUS {
        return None;
    }
    let sums: Vec<f64> = (0..3)
        .into_par_iter()
        .map(|channel| channel_sum(found, truth, counts, channel))
        .collect();
    let averaged = (RADIUS..height - RADIUS)
        .flat_map(|y| &counts.row(y)[RADIUS..width - RADIUS])
        .filter(|on| **on)
        .count();
    (averaged > 0).then(|| sums.iter().sum::<f64>() / (3 * averaged) as f64)
}

/// Sum of one channel's similarity over the pixels that are averaged.
fn channel_sum(
    found: &Plane<[f32; 3]>,
    truth: &Plane<[f32; 3]>,
    counts: &Plane<bool>,
    channel: usize,
) -> f64 {
    let (width, height) = counts.size();
    let window = window();
    let inside = RADIUS..width - RADIUS;
    // Rows first: `smooth[y]` holds each moment blurred along x.
    let smooth: Vec<[Vec<f32>; MOMENTS]> = (0..height)
        .map(|y| {
            let mut moments: [Vec<f32>; MOMENTS] = std::array::from_fn(|_| vec![0.0; width]);
            for (x, on) in counts.row(y).iter().enumerate() {
                if *on {
                    let (a, b) = (found[(x, y)][channel], truth[(x, y)][channel]);
                    for (moment, value) in moments.iter_mut().zip([1.0, a, b, a * a, b * b, a * b])
                    {
                        moment[x] = value;
                    }
                }
            }
            moments.map(|moment| {
                let mut blurred = vec![0.0; width];
                for (tap, weight) in window.iter().enumerate() {
                    for (out, value) in blurred[inside.clone()].iter_mut().zip(&moment[tap..]) {
                        *out += weight * value;
                    }
                }
                blurred
            })
        })
        .collect();
    let mut sum = 0.0;
    let mut means: [Vec<f32>; MOMENTS] = std::array::from_fn(|_| vec![0.0; width]);
    for y in RADIUS..height - RADIUS {
        for (index, mean) in means.iter_mut().enumerate() {
            mean.fill(0.0);
            for (tap, weight) in window.iter().enumerate() {
                for (out, value) in mean.iter_mut().zip(&smooth[y + tap - RADIUS][index]) {
                    *out += weight * value;
                }
            }
        }
        for x in inside.clone().filter(|x| counts[(*x, y)]) {
            let [weight, a, b, aa, bb, ab] = std::array::from_fn(|index| means[index][x]);
            let (a, b, aa, bb, ab) = (
                a / weight,
                b / weight,
                aa / weight,
                bb / weight,
                ab / weight,
            );
            let (variance_a, variance_b, covariance) = (aa - a * a, bb - b * b, ab - a * b);
            let likeness = (2.0 * a * b + C1) * (2.0 * covariance + C2)
                / ((a * a + b * b + C1) * (variance_a + variance_b + C2));
            sum += f64::from(likeness);
        }
    }
    sum
}

/// The Gaussian along one axis; sums to 1.
fn window() -> [f32; 2 * RADIUS + 1] {
    let weights: [f64; 2 * RADIUS + 1] = std::array::from_fn(|tap| {
        let offset = tap as f64 - RADIUS as f64;
        (-offset * offset / (2.0 * SIGMA * SIGMA)).exp()
    });
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| (weight / sum) as f32)
}
