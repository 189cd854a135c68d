//! The figures of a subtraction's report.

use super::LinearImage;
use drivers::Plane;
use rayon::prelude::*;

/// Quality of the flash-only light over its known pixels.
pub(super) struct Quality {
    pub usable: usize,
    pub negative_fraction: f32,
    pub inconsistent_fraction: f32,
    pub snr_db: f32,
    pub weak_fraction: f32,
}

/// Signal-to-noise ratio under which a pixel is weak (or, when negative, inconsistent).
const WEAK_SIGMAS: f32 = 3.0;
/// Lowest signal-to-noise ratio told: −60 dB.
const SNR_AT_LEAST: f32 = 1e-3;
/// Pixels that medians are taken over, about.
const SAMPLES: usize = 60_000;

/// Distance between the rows, and columns, that samples are taken from.
pub(super) fn sample_stride(width: usize, height: usize) -> usize {
    ((width * height / SAMPLES) as f32).sqrt().ceil().max(1.0) as usize
}

/// Room to flash; +∞ where the flash added nothing.
pub(super) fn ratio(room: f32, flash: f32) -> f32 {
    if flash > 0.0 {
        room / flash
    } else {
        f32::INFINITY
    }
}

/// The median, `None` of nothing. Infinity is told as the largest finite number.
pub(super) fn median(mut values: Vec<f32>) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
    Some(median.min(f32::MAX))
}

/// Counts over the finished light.
pub(super) fn quality(light: &LinearImage, variance: &Plane<f32>) -> Quality {
    let width = light.0.width();
    let stride = sample_stride(width, light.0.height());
    let signal = |rgb: &[f32; 3], variance: f32| {
        // Mean of the channels over the deviation of that mean.
        let mean = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
        mean / (variance / 3.0).sqrt().max(f32::MIN_POSITIVE)
    };
    let [usable, negative, inconsistent, weak] = light
        .0
        .samples()
        .par_chunks(width.max(1))
        .zip(variance.samples().par_chunks(width.max(1)))
        .map(|(light, variance)| {
            let mut counts = [0usize; 4];
            for (rgb, &variance) in light.iter().zip(variance) {
                // `signal` against its limits, without its root and division.
                let mean = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
                if (mean + variance).is_nan() {
                    continue;
                }
                let negative = mean < 0.0;
                let within = mean * mean <= WEAK_SIGMAS * WEAK_SIGMAS / 3.0 * variance;
                counts[0] += 1;
                counts[1] += usize::from(negative);
                counts[2] += usize::from(negative && !within);
                counts[3] += usize::from(negative || within);
            }
            counts
        })
        .reduce(|| [0; 4], |a, b| std::array::from_fn(|i| a[i] + b[i]));
    let samples: Vec<f32> = (0..light.0.height())
        .step_by(stride)
        .flat_map(|y| {
            let rows = light.0.row(y).iter().zip(variance.row(y));
            rows.step_by(stride)
                .map(|(rgb, &variance)| signal(rgb, variance))
        })
        .filter(|signal| !signal.is_nan())
        .collect();
    let share = |count: usize| {
        if usable == 0 {
            0.0
        } else {
            count as f32 / usable as f32
        }
    };
    Quality {
        usable,
        negative_fraction: share(negative),
        inconsistent_fraction: share(inconsistent),
        snr_db: 20.0 * median(samples).unwrap_or(0.0).max(SNR_AT_LEAST).log10(),
        weak_fraction: share(weak),
    }
}
