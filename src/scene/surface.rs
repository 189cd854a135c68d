//! The surface that the depth shows: smoothed where it is noisy, as it is where it is not.

use super::{
    edges::edges,
    noise::{DenseNoise, Noise, dense_noise, noise},
    rims::settle,
    smooth::{InverseDepth, MOST_DOUBT, Smoothed, smooth},
    variation::piecewise,
};
use drivers::{Plane, Rig};
use rayon::prelude::*;

/// Sigma given to depth that comes without one, as a share of it.
const UNSTATED_SIGMA: f32 = 0.002;

/// Slopes between neighbours are good enough when their noise stays below this (radians, for a
/// surface that faces the camera).
const QUIET_SLOPES: f32 = 0.02;

/// Slopes between neighbours under white noise as strong, over large areas, as the depth's own (radians, as
/// above, on a grid of [`STATED_PIXELS`]): from here on windows that show a plane are larger than what the
/// scene is made of.
const LOUD_SLOPES: f32 = 5.0;
const STATED_PIXELS: f32 = 256.0 * 256.0;

/// The surface, and how far its slopes are to be trusted.
pub(super) struct Surface {
    /// 1/z.
    pub depth: InverseDepth,
    /// Change of 1/z per pixel to the right and down; `None` where differences of `depth` tell it.
    pub slope: Option<Plane<[f32; 2]>>,
    /// Standard deviation of a normal's angle, radians.
    pub normal_sigma: Plane<f32>,
}

/// 1/z smoothed by the noise that the depth itself shows. `light` is the photograph's; `focal` is that of
/// the grid, in pixels; `smoothing` multiplies the noise found.
pub(super) fn surface(
    metres: &Plane<f32>,
    sigma_metres: &Plane<f32>,
    light: &Plane<[f32; 3]>,
    rig: &Rig,
    focal: f32,
    smoothing: f32,
) -> Surface {
    let value = metres.map(|z| 1.0 / z);
    let (width, height) = metres.size();
    let mut sigma = Plane::filled(width, height, f32::NAN);
    sigma
        .samples_mut()
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, sigma)| {
            let (z, stated) = (metres.samples()[i], sigma_metres.samples()[i]);
            let metres = if stated > 0.0 {
                stated
            } else {
                UNSTATED_SIGMA * z
            };
            *sigma = metres / (z * z);
        });
    // Depth from a camera of its own has been interpolated, and often smoothed by the maker; depth
    // on the color grid has not, and there a wider spacing would take relief for noise.
    let coarseness = rig
        .depth
        .map_or(0.25, |depth| f64::from(focal) / depth.lens.fx)
        .clamp(0.25, 16.0);
    let steps: Vec<usize> = [1, 2, 4, 8, 16]
        .into_iter()
        .filter(|&step| step as f64 <= 8.0 * coarseness.min(4.0))
        .collect();
    let Noise { ratio, spacing } = noise(&value, &sigma, &steps).unwrap_or(Noise {
        ratio: 0.0,
        spacing: 1,
    });
    let ratio = smoothing * ratio;
    let slope_noise = median(
        sigma
            .samples()
            .iter()
            .zip(value.samples())
            .map(|(s, w)| ratio * focal * s / w),
    ) / spacing as f32;
    if slope_noise > QUIET_SLOPES {
        if let Some(DenseNoise { sigma, blur }) = dense_noise(&value, &sigma) {
            let noise = sigma.map(|sigma| smoothing * sigma);
            let pixels = noise.samples().iter().zip(value.samples());
            let slope_noise = focal * median(pixels.map(|(s, w)| s / w));
            // A window of the same share of the picture has so many more pixels.
            if slope_noise > LOUD_SLOPES * value.len() as f32 / STATED_PIXELS {
                return of_smoothed(piecewise(&value, &noise, blur, light), focal);
            }
        }
        // The smallest window spans some three samples of the depth camera.
        let side = (1.5 * coarseness).log2().round().max(1.0).exp2() as usize;
        let mut smoothed = smooth(&value, &sigma, side, smoothing);
        let usual = ratio * median(sigma.samples().iter().copied());
        // Where depth is a guess its sigma spans the step beside it.
        let spread = sigma.map(|s| (ratio * s).min(MOST_DOUBT * usual));
        let measured = InverseDepth {
            variance: spread.map(|s| s * s),
            value,
        };
        let cuts = edges(&measured, focal).firm(&measured);
        settle(&mut smoothed, &measured.value, &spread, &cuts, 2 * side);
        return of_smoothed(smoothed, focal);
    }
    // Never exactly certain: zero variance would make every comparison a division by zero.
    sigma
        .samples_mut()
        .par_iter_mut()
        .zip(value.samples())
        .for_each(|(s, w)| {
            *s = (*s * ratio).max(1e-6 * w);
        });
    let variance = sigma.map(|s| s * s);
    let depth = InverseDepth { value, variance };
    let apart = 2.0 * (spacing * spacing) as f32;
    let normal_sigma = angle(&depth, focal, |i| depth.variance.samples()[i] / apart);
    Surface {
        depth,
        slope: None,
        normal_sigma,
    }
}

/// A surface whose slopes came with it.
fn of_smoothed(smoothed: Smoothed, focal: f32) -> Surface {
    let Smoothed {
        depth,
        slope,
        slope_variance,
    } = smoothed;
    let normal_sigma = angle(&depth, focal, |i| slope_variance.samples()[i]);
    Surface {
        depth,
        slope: Some(slope),
        normal_sigma,
    }
}

/// Median of the numbers that are none NaN, from a sample of them; NaN without any.
fn median(numbers: impl ExactSizeIterator<Item = f32>) -> f32 {
    let stride = numbers.len().div_ceil(60_000).max(1);
    let mut kept: Vec<f32> = numbers.step_by(stride).filter(|n| !n.is_nan()).collect();
    if kept.is_empty() {
        return f32::NAN;
    }
    let middle = kept.len() / 2;
    *kept.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Standard deviation of z from that of 1/z, metres.
pub(super) fn sigma_of_depth(depth: &InverseDepth) -> Plane<f32> {
    let (width, height) = depth.value.size();
    let mut sigma = Plane::filled(width, height, f32::NAN);
    sigma
        .samples_mut()
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, sigma)| {
            let w = depth.value.samples()[i];
            *sigma = depth.variance.samples()[i].sqrt() / (w * w);
        });
    sigma
}

/// Standard deviation of a normal's angle, radians, from the variance of its slopes.
fn angle(
    depth: &InverseDepth,
    focal: f32,
    slope_variance: impl Fn(usize) -> f32 + Sync,
) -> Plane<f32> {
    let (width, height) = depth.value.size();
    let mut sigma = Plane::filled(width, height, f32::NAN);
    sigma
        .samples_mut()
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, sigma)| {
            let slope = slope_variance(i).sqrt();
            *sigma = (slope * focal / depth.value.samples()[i]).min(1.0);
        });
    sigma
}
