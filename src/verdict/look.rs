//! The shot as the detectors look at it: light and depth on one small grid.

use crate::{develop::Development, shot::Shot};
use drivers::Plane;
use rayon::prelude::*;

/// Pixels of the grid, about, at most: the detectors' work is bounded by it.
const PIXELS: usize = 100_000;
/// Light under this share of the picture's median is dark: nothing is read off it.
const DARK: f32 = 0.02;
/// Depth that is so far, in natural logarithms, from what was understood of it is looked at as that.
const LOUD: f32 = 0.004;

/// Light and depth of a shot on one grid, every `stride`-th pixel of the working grid.
pub(super) struct Look<'a> {
    /// The frames.
    pub shot: &'a Shot,
    /// What became of them.
    pub development: &'a Development,
    /// Pixels of the working grid for one of this grid, a side.
    pub stride: usize,
    /// Natural logarithm of the flash's light, mean of the channels; NaN = dark, unknown or masked.
    pub light: Plane<f32>,
    /// Depth as it came where it came on the photograph's grid, else as registered, or, where it is so noisy that
    /// steps of noise would be taken for those of things, as it was understood; NaN = unknown.
    pub metres: Plane<f32>,
    /// Infrared amplitude; `None` where none came.
    pub amplitude: Option<Thinned<'a, f32>>,
    /// Median of the flash's light, mean of the channels.
    pub median_light: f32,
}

impl<'a> Look<'a> {
    pub fn of(shot: &'a Shot, development: &'a Development) -> Self {
        let full = development.working_light.as_ref();
        let full = &full.unwrap_or(&development.flash_only.light).0;
        let (width, height) = full.size();
        let stride = ((full.len() as f32 / PIXELS as f32).sqrt().ceil() as usize).max(1);
        let size = (width.div_ceil(stride), height.div_ceil(stride));
        let counted = shot.mask.as_ref().map(|mask| Thinned::of(mask, size));
        let counts = |x: usize, y: usize| counted.as_ref().is_none_or(|mask| *mask.at(x, y));
        let linear = by_rows(size, |x, y| {
            if counts(x, y) {
                block_mean(full, x * stride, y * stride, stride)
            } else {
                f32::NAN
            }
        });
        let median_light = median(&linear, 7).unwrap_or(0.0);
        let floor = DARK * median_light;
        let light = by_rows(size, |x, y| {
            let light = linear[(x, y)];
            if light > floor { light.ln() } else { f32::NAN }
        });
        // Depth of another camera is asked where it lies on the photograph.
        let registered = &development.registered;
        let (depth, amplitude) = match shot.rig.depth {
            None => (&shot.depth.metres, shot.depth.amplitude.as_ref()),
            Some(_) => (&registered.metres, registered.amplitude.as_ref()),
        };
        let depth = Thinned::of(depth, size);
        let mut metres = by_rows(size, |x, y| {
            let z = *depth.at(x, y);
            if z > 0.0 && z.is_finite() && counts(x, y) {
                z
            } else {
                f32::NAN
            }
        });
        let understood =
            |x: usize, y: usize| development.scene.depth_metres[(x * stride, y * stride)];
        let noise = by_rows(size, |x, y| (metres[(x, y)] / understood(x, y)).ln().abs());
        if median(&noise, 7).is_some_and(|noise| noise > LOUD) {
            metres = by_rows(size, |x, y| {
                let z = metres[(x, y)];
                if z.is_nan() { z } else { understood(x, y) }
            });
        }
        let amplitude = amplitude.map(|plane| Thinned::of(plane, size));
        Self {
            shot,
            development,
            stride,
            light,
            metres,
            amplitude,
            median_light,
        }
    }

    /// Natural logarithm of red over blue at a pixel of the working grid.
    pub fn tint(&self, at: (usize, usize)) -> f32 {
        let development = self.development;
        let full = development.working_light.as_ref();
        let [red, _, blue] = full.unwrap_or(&development.flash_only.light).0[at];
        (red / blue).ln()
    }

    /// Pixels of the working grid that belong to pixels of this grid of known depth that count.
    pub fn on_working_grid(&self, counts: impl Fn((usize, usize)) -> bool + Sync) -> Plane<bool> {
        let (columns, rows) = self.size();
        let (width, height) = self.development.scene.depth_metres.size();
        Plane::from_fn(width, height, |x, y| {
            let at = (
                (x / self.stride).min(columns - 1),
                (y / self.stride).min(rows - 1),
            );
            !self.metres[at].is_nan() && counts(at)
        })
    }

    /// `(width, height)` of the grid.
    pub fn size(&self) -> (usize, usize) {
        self.light.size()
    }

    /// Pixels of the photograph for one of this grid, a side.
    pub fn photograph_pixels(&self) -> f32 {
        let full = self.development.flash_only.light.0.width();
        full as f32 / self.light.width().max(1) as f32
    }

    /// Length of a side of the square that holds as many pixels as the grid.
    pub fn side(&self) -> f32 {
        (self.light.len() as f32).sqrt()
    }
}

/// Every so many samples of a plane, as a smaller grid of the same picture.
pub(super) struct Thinned<'a, T> {
    plane: &'a Plane<T>,
    columns: Vec<usize>,
    rows: Vec<usize>,
}

impl<'a, T> Thinned<'a, T> {
    fn of(plane: &'a Plane<T>, (width, height): (usize, usize)) -> Self {
        let middles = |small: usize, large: usize| {
            (0..small)
                .map(|at| ((2 * at + 1) * large / (2 * small)).min(large.saturating_sub(1)))
                .collect()
        };
        Self {
            plane,
            columns: middles(width, plane.width()),
            rows: middles(height, plane.height()),
        }
    }

    /// The sample nearest to the middle of a pixel of the smaller grid.
    pub fn at(&self, x: usize, y: usize) -> &T {
        &self.plane[(self.columns[x], self.rows[y])]
    }
}

/// A plane made row by row, in parallel.
pub(super) fn by_rows<T: Send + Clone + Default>(
    (width, height): (usize, usize),
    sample: impl Fn(usize, usize) -> T + Sync,
) -> Plane<T> {
    let mut plane = Plane::filled(width, height, T::default());
    plane
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .with_min_len(16)
        .for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                *out = sample(x, y);
            }
        });
    plane
}

/// Mean over the known pixels of a square and over its channels.
fn block_mean(light: &Plane<[f32; 3]>, left: usize, top: usize, side: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    for y in top..(top + side).min(light.height()) {
        let row = light.row(y);
        for rgb in &row[left..(left + side).min(row.len())] {
            let mean = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
            if mean.is_finite() {
                sum += mean;
                count += 1;
            }
        }
    }
    sum / count as f32
}

/// Median of every `step`-th finite sample; `None` of nothing.
pub(super) fn median(plane: &Plane<f32>, step: usize) -> Option<f32> {
    quantile(plane.samples().iter().step_by(step).copied().collect(), 0.5)
}

/// The value that a share of the finite values lies under; `None` of nothing.
pub(super) fn quantile(mut values: Vec<f32>, share: f32) -> Option<f32> {
    values.retain(|value| value.is_finite());
    let last = values.len().checked_sub(1)?;
    let place = (share * last as f32).round() as usize;
    Some(
        *values
            .select_nth_unstable_by(place.min(last), f32::total_cmp)
            .1,
    )
}
