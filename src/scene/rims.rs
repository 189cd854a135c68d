//! Beside a step, where every window shows two surfaces: the plane of a pixel's own side.

use super::{
    edges::Edges,
    smooth::Smoothed,
    windows::{Moments, Window, fit},
};
use drivers::Plane;
use rayon::prelude::*;

/// Pixels whose 1/z differs by more than this share per pixel of distance lie on another surface
/// (82° of slant at a focal length of 500 pixels)…
const STEEPEST: f32 = 0.014;
/// …or by this share, if that is less: the widest step that slant may make within a window.
const MOST_STEP: f32 = 0.04;
/// …noise allowed for, in its standard deviations.
const NOISE_SIGMAS: f32 = 3.0;
/// Flattens slopes across what is only a few pixels wide, pixels².
const RIDGE: f64 = 0.1;
/// A pixel is moved by so many standard deviations at most: what lies on no plane stays.
const MOST_MOVED: f32 = 3.0;
/// Pixels looked at along one side of the window, at most.
const TAPS: usize = 9;

/// Replaces what windows say of pixels within `reach` of a cut by the planes of their own sides.
/// `value` is 1/z as measured and `sigma` its standard deviation.
pub(super) fn settle(
    smoothed: &mut Smoothed,
    value: &Plane<f32>,
    sigma: &Plane<f32>,
    cuts: &Edges,
    reach: usize,
) {
    let (width, height) = value.size();
    let beside = beside(cuts, reach);
    let rows = smoothed
        .depth
        .value
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .zip(smoothed.slope.samples_mut().par_chunks_mut(width.max(1)))
        .zip(
            smoothed
                .slope_variance
                .samples_mut()
                .par_chunks_mut(width.max(1)),
        );
    rows.take(height)
        .enumerate()
        .for_each(|(y, ((values, slopes), variances))| {
            for x in (0..width).filter(|&x| beside[(x, y)]) {
                let measured = value[(x, y)];
                if measured.is_nan() {
                    continue;
                }
                let (plane, pixels) = rim(value, sigma, (x, y), reach);
                let sigma = sigma[(x, y)];
                values[x] = plane
                    .at(x as f32, y as f32)
                    // Not `clamp`, which panics where absurd depth leaves no bounds.
                    .max(measured - MOST_MOVED * sigma)
                    .min(measured + MOST_MOVED * sigma);
                slopes[x] = plane.slope;
                // A third of the reach squared is the spread of evenly placed pixels.
                let spread = (reach * reach) as f32 / 3.0;
                variances[x] = sigma * sigma / (pixels.max(1.0) * spread);
            }
        });
}

/// Pixels within `reach` of a cut, its own two included.
fn beside(cuts: &Edges, reach: usize) -> Plane<bool> {
    let (width, height) = cuts.right.size();
    let mut across = Plane::filled(width, height, false);
    let rows = across.samples_mut().par_chunks_mut(width.max(1));
    rows.enumerate().for_each(|(y, row)| {
        for x in 0..width {
            let right = x + 1 < width && cuts.right[(x, y)];
            let below = y + 1 < height && cuts.below[(x, y)];
            if right || below {
                row[(x + 1).saturating_sub(reach)..(x + 1 + reach).min(width)].fill(true);
            }
        }
    });
    let mut beside = Plane::filled(width, height, false);
    let rows = beside.samples_mut().par_chunks_mut(width.max(1));
    rows.enumerate().for_each(|(y, row)| {
        for from in y.saturating_sub(reach)..(y + reach).min(height) {
            for (beside, &across) in row.iter_mut().zip(across.row(from)) {
                *beside |= across;
            }
        }
    });
    beside
}

/// Plane through what lies on one surface with pixel (x, y), within `reach` pixels of it, and how many
/// pixels it was told by. The pixel's own depth must be known.
fn rim(
    value: &Plane<f32>,
    sigma: &Plane<f32>,
    (x, y): (usize, usize),
    reach: usize,
) -> (Window, f32) {
    let (width, height) = value.size();
    let here = value[(x, y)];
    let stride = (2 * reach + 1).div_ceil(TAPS);
    let mut moments = Moments::default();
    let around = |at: usize, size: usize| {
        let first = at - reach.min(at) / stride * stride;
        (first..(at + reach + 1).min(size)).step_by(stride)
    };
    for row in around(y, height) {
        for column in around(x, width) {
            let (there, sigma) = (value[(column, row)], sigma[(column, row)]);
            let distance = (column.abs_diff(x).max(row.abs_diff(y))) as f32;
            let step = (STEEPEST * distance).min(MOST_STEP) * here;
            // False for NaN.
            if (there - here).abs() <= step + NOISE_SIGMAS * sigma {
                // Bent surfaces leave their plane with the square of the distance.
                let far = f64::from(2.0 * distance / reach as f32);
                let weight = 1.0 / (f64::from(sigma * sigma) * (1.0 + far * far));
                moments.add_pixel(column as f64, row as f64, f64::from(there), weight);
            }
        }
    }
    let taps = (2 * reach / stride + 1).pow(2) as f64;
    let plane = fit(&moments, RIDGE, taps);
    (plane, plane.fill * taps as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_side_of_a_step_keeps_its_own_plane() {
        let near = |x: usize, y: usize| 1.0 + 0.002 * x as f32 - 0.001 * y as f32;
        let value = Plane::from_fn(32, 24, |x, y| {
            if x < 16 {
                near(x, y)
            } else {
                0.6 + 0.001 * y as f32
            }
        });
        let sigma = value.map(|_| 1e-3);
        let (left, pixels) = rim(&value, &sigma, (15, 12), 4);
        assert!(pixels > 40.0);
        assert!((left.at(15.0, 12.0) - near(15, 12)).abs() < 3e-4);
        assert!((left.slope[0] - 0.002).abs() < 5e-4 && (left.slope[1] + 0.001).abs() < 5e-4);
        let (right, _) = rim(&value, &sigma, (16, 12), 4);
        assert!(right.slope[0].abs() < 1e-6 && (right.slope[1] - 0.001).abs() < 5e-4);
    }
}
