//! Depth samples that can be trusted, each with its standard deviation.

use super::holes::Holes;
use drivers::DepthFrame;
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

/// Steepest surface believed to be one surface, as the tangent of its angle to the image plane
/// (86°). Steeper steps between neighbours are edges.
pub(super) const STEEPEST: f32 = 14.3;
/// Tangent (80.5°) up to which a single step is believed; a steeper one only where the surface
/// goes on like it.
pub(super) const STEEP: f32 = 6.0;
/// Standard deviation below which no Time-of-Flight camera is believed, metres.
const SIGMA_FLOOR_METRES: f32 = 0.0005;
/// Largest standard deviation, as a fraction of the distance.
const SIGMA_CEILING: f32 = 0.1;
/// Rows that are worth a task.
const ROWS_PER_TASK: usize = 16;
/// Largest share of the distance that noise may excuse in a step between neighbours.
const NOISE_EXCUSE: f32 = 0.02;

/// A frame without its flying pixels.
#[derive(Debug, Clone, Default)]
pub(super) struct Cleaned {
    /// Metres along the depth camera's z; NaN = no answer or not believed.
    pub metres: Vec<f32>,
    /// Metres; meaningless where `metres` is NaN.
    pub sigma: Vec<f32>,
    /// Surface assumed across holes, see `holes`; NaN elsewhere.
    pub holes: Holes,
}

/// How the standard deviation follows from what the frame says.
#[derive(Debug, Clone, Copy)]
enum NoiseModel {
    /// σ = k / amplitude: photon noise of the correlation samples at constant background
    /// (Lange & Seitz 2001, eq. 15).
    Amplitude(f32),
    /// σ = k · metres²: the same, with the amplitude falling with distance².
    Distance(f32),
}

impl Cleaned {
    /// True when at least one sample is left.
    pub fn any(&self) -> bool {
        self.metres.iter().any(|z| z.is_finite())
    }

    /// Takes a frame whose neighbouring samples lie `spacing · metres` apart.
    ///
    /// A sample is removed when it floats between a nearer and a farther neighbour on a line
    /// that looks along the view (mixed light of both, Sabov & Krüger 2008), or when fewer than
    /// two of its eight neighbours lie on its surface. A steep plane continues evenly on both
    /// sides, in inverse depth, and stays.
    pub fn clean(&mut self, frame: &DepthFrame, spacing: f32) {
        let (width, height) = frame.metres.size();
        self.metres.resize(width * height, f32::NAN);
        self.sigma.resize(width * height, f32::NAN);
        let steepest = STEEPEST * spacing;
        let model = NoiseModel::of(frame, steepest);
        self.sigma
            .par_chunks_mut(width)
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, sigmas)| {
                dispatch!(Level::new(), _simd => model.sigmas(frame, y, sigmas));
            });
        let raw = Raw {
            metres: frame.metres.samples(),
            sigma: &self.sigma,
            width,
            height,
            steepest,
        };
        self.metres
            .par_chunks_mut(width)
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, row)| {
                if y > 0 && y + 1 < height && width > 2 {
                    dispatch!(Level::new(), _simd => raw.take_smooth(y, row));
                } else {
                    row.fill(f32::NAN);
                }
                for (x, z) in row.iter_mut().enumerate() {
                    if z.is_nan() && raw.is_believed(x, y) {
                        *z = raw.metres[y * width + x];
                    }
                }
            });
        self.holes.span(&self.metres, width, height);
    }
}

impl NoiseModel {
    /// Measures the scale of the noise in the frame itself: the second difference of three
    /// samples on one surface has variance 6 σ²; the median over the frame ignores its edges.
    fn of(frame: &DepthFrame, steepest: f32) -> Self {
        const STRIDE: usize = 3;
        let amplitude = frame.amplitude.as_ref();
        let mut scales = Vec::new();
        for y in (0..frame.metres.height()).step_by(STRIDE) {
            let row = frame.metres.row(y);
            for x in (1..row.len().saturating_sub(1)).step_by(STRIDE) {
                let [a, b, c] = [row[x - 1], row[x], row[x + 1]];
                let reach = steepest * b;
                // False for NaN.
                let one_surface = (a - b).abs() < reach && (c - b).abs() < reach;
                if !one_surface {
                    continue;
                }
                let sigma = (a - 2.0 * b + c).abs() / (0.6745 * 6f32.sqrt());
                let scale = match amplitude {
                    Some(amplitude) => sigma * amplitude[(x, y)],
                    None => sigma / (b * b),
                };
                if scale.is_finite() && scale >= 0.0 {
                    scales.push(scale);
                }
            }
        }
        let middle = scales.len() / 2;
        let scale = if scales.is_empty() {
            0.0
        } else {
            *scales.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        if amplitude.is_some() {
            Self::Amplitude(scale)
        } else {
            Self::Distance(scale)
        }
    }

    /// For one row: the device's own statement where it makes one, else the model's.
    #[inline(always)]
    fn sigmas(self, frame: &DepthFrame, y: usize, sigmas: &mut [f32]) {
        let metres = &frame.metres.row(y)[..sigmas.len()];
        match (self, &frame.amplitude) {
            (Self::Amplitude(scale), Some(amplitude)) => {
                for ((sigma, &z), &a) in sigmas.iter_mut().zip(metres).zip(amplitude.row(y)) {
                    *sigma = within_limits(scale / a.max(0.0), z);
                }
            }
            (Self::Amplitude(scale) | Self::Distance(scale), _) => {
                for (sigma, &z) in sigmas.iter_mut().zip(metres) {
                    *sigma = within_limits(scale * z * z, z);
                }
            }
        }
        if let Some(stated) = &frame.sigma {
            for (sigma, &stated) in sigmas.iter_mut().zip(stated.row(y)) {
                if stated > 0.0 && stated.is_finite() {
                    *sigma = stated;
                }
            }
        }
    }
}

#[inline(always)]
fn within_limits(modelled: f32, z: f32) -> f32 {
    // `min` also puts a NaN (0/0 of a black sample) within the limits.
    let sigma = modelled.min(SIGMA_CEILING * z);
    (sigma * sigma + SIGMA_FLOOR_METRES * SIGMA_FLOOR_METRES).sqrt()
}

struct Raw<'a> {
    metres: &'a [f32],
    sigma: &'a [f32],
    width: usize,
    height: usize,
    steepest: f32,
}

impl Raw<'_> {
    /// Index of the neighbour (dx, dy) away that has an answer.
    fn neighbour(&self, x: usize, y: usize, dx: isize, dy: isize) -> Option<usize> {
        let x = x.checked_add_signed(dx).filter(|x| *x < self.width)?;
        let y = y.checked_add_signed(dy).filter(|y| *y < self.height)?;
        let i = y * self.width + x;
        is_distance(self.metres[i]).then_some(i)
    }

    /// Takes the samples of a row, not the first or last, that all four neighbours continue; NaN
    /// for the others. Without a branch, so that the compiler takes many samples at a time.
    #[inline(always)]
    fn take_smooth(&self, y: usize, row: &mut [f32]) {
        let last = self.width - 1;
        (row[0], row[last]) = (f32::NAN, f32::NAN);
        let row = &mut row[1..last];
        let count = row.len();
        let here = y * self.width + 1;
        let [c, l, r, u, d] = [
            here,
            here - 1,
            here + 1,
            here - self.width,
            here + self.width,
        ]
        .map(|from| (&self.metres[from..][..count], &self.sigma[from..][..count]));
        for (x, z) in row.iter_mut().enumerate() {
            let smooth = (c.0[x] > 0.0)
                & self.joined(c.0[x], l.0[x], c.1[x] + l.1[x], 1.0)
                & self.joined(c.0[x], r.0[x], c.1[x] + r.1[x], 1.0)
                & self.joined(c.0[x], u.0[x], c.1[x] + u.1[x], 1.0)
                & self.joined(c.0[x], d.0[x], c.1[x] + d.1[x], 1.0);
            *z = if smooth { c.0[x] } else { f32::NAN };
        }
    }

    fn is_believed(&self, x: usize, y: usize) -> bool {
        let i = y * self.width + x;
        if !is_distance(self.metres[i]) {
            return false;
        }
        const AXES: [(isize, isize); 4] = [(1, 0), (0, 1), (1, 1), (1, -1)];
        let mut on_surface = 0;
        for (dx, dy) in AXES {
            let steps = if dx != 0 && dy != 0 {
                std::f32::consts::SQRT_2
            } else {
                1.0
            };
            let before = self.neighbour(x, y, -dx, -dy);
            let after = self.neighbour(x, y, dx, dy);
            for side in [before, after].into_iter().flatten() {
                on_surface += usize::from(self.linked(i, side, steps));
            }
            let (Some(before), Some(after)) = (before, after) else {
                continue;
            };
            let floats = (self.metres[i] - self.metres[before])
                * (self.metres[after] - self.metres[i])
                > 0.0
                && !self.linked(i, before, steps)
                && !self.linked(i, after, steps);
            if floats
                && !(self.continues(i, before, self.neighbour(x, y, -2 * dx, -2 * dy))
                    && self.continues(i, after, self.neighbour(x, y, 2 * dx, 2 * dy)))
            {
                return false;
            }
        }
        on_surface >= 2
    }

    /// One surface no steeper than believed, noise allowed for.
    fn linked(&self, i: usize, j: usize, steps: f32) -> bool {
        let sigmas = self.sigma[i] + self.sigma[j];
        self.joined(self.metres[i], self.metres[j], sigmas, steps)
    }

    #[inline(always)]
    fn joined(&self, a: f32, b: f32, sigmas: f32, steps: f32) -> bool {
        let nearest = a.min(b);
        let noise = (2.0 * sigmas).min(NOISE_EXCUSE * nearest);
        // False for NaN.
        (a - b).abs() <= steps * self.steepest * nearest + noise
    }

    /// The step `here → next` goes on from `next` to `beyond`, as on a plane (linear in 1/z).
    fn continues(&self, here: usize, next: usize, beyond: Option<usize>) -> bool {
        let Some(beyond) = beyond else { return false };
        let [here, next, beyond] = [here, next, beyond].map(|i| 1.0 / self.metres[i]);
        let (first, second) = (next - here, beyond - next);
        (second - first).abs() < 0.5 * first.abs()
    }
}

fn is_distance(z: f32) -> bool {
    z > 0.0 && z.is_finite()
}
