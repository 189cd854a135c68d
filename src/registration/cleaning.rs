//! Depth samples that can be trusted, each with its standard deviation.

use super::holes::Holes;
use drivers::DepthFrame;
use rayon::prelude::*;

/// Steepest surface believed to be one surface, as the tangent of its angle to the image plane
/// (86°). Steeper steps between neighbours are edges.
pub(super) const STEEPEST: f32 = 14.3;
/// Standard deviation below which no Time-of-Flight camera is believed, metres.
const SIGMA_FLOOR_METRES: f32 = 0.0005;
/// Largest standard deviation, as a fraction of the distance.
const SIGMA_CEILING: f32 = 0.1;
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
            .for_each(|(y, sigmas)| {
                for (x, sigma) in sigmas.iter_mut().enumerate() {
                    *sigma = model.sigma(frame, y * width + x);
                }
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
            .for_each(|(y, row)| {
                for (x, z) in row.iter_mut().enumerate() {
                    *z = if raw.is_believed(x, y) {
                        raw.metres[y * width + x]
                    } else {
                        f32::NAN
                    };
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

    /// The device's own statement where it makes one, else the model's.
    fn sigma(self, frame: &DepthFrame, i: usize) -> f32 {
        let z = frame.metres.samples()[i];
        let stated = frame
            .sigma
            .as_ref()
            .map_or(f32::NAN, |sigma| sigma.samples()[i]);
        if stated > 0.0 && stated.is_finite() {
            return stated;
        }
        let modelled = match (self, &frame.amplitude) {
            (Self::Amplitude(scale), Some(amplitude)) => scale / amplitude.samples()[i].max(0.0),
            (Self::Amplitude(scale) | Self::Distance(scale), _) => scale * z * z,
        };
        // `max` and `min` also put a NaN (0/0 of a black sample) within the limits.
        let ceiling = SIGMA_CEILING * z;
        let sigma = modelled.min(ceiling);
        (sigma * sigma + SIGMA_FLOOR_METRES * SIGMA_FLOOR_METRES).sqrt()
    }
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

    fn is_believed(&self, x: usize, y: usize) -> bool {
        let i = y * self.width + x;
        if !is_distance(self.metres[i]) {
            return false;
        }
        let inside = x > 0 && y > 0 && x + 1 < self.width && y + 1 < self.height;
        let cross = [
            i.wrapping_sub(1),
            i + 1,
            i.wrapping_sub(self.width),
            i + self.width,
        ];
        if inside && cross.iter().all(|&j| self.linked(i, j, 1.0)) {
            return true;
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
        let (a, b) = (self.metres[i], self.metres[j]);
        let nearest = a.min(b);
        let noise = (2.0 * (self.sigma[i] + self.sigma[j])).min(NOISE_EXCUSE * nearest);
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
