//! From the working grid back to the photograph's own size.
//!
//! Relit light is carried up as a ratio to the flash photograph, so that the photograph's own
//! detail survives; the ratio is smooth wherever the relit picture differs from the photograph
//! only by lamp and shadow (quotient images: Shashua & Riklin-Raviv 2001).

use super::prepared::Relit;
use crate::radiometry::LinearImage;
use drivers::Plane;
use glam::Vec3;
use rayon::prelude::*;

/// A sample that can be mixed with others.
pub trait Mix: Copy + Send + Sync {
    /// True when it takes part in mixing.
    fn is_known(&self) -> bool;
    /// `Σ weight · sample`; the weights sum to one.
    fn mix(samples: &[(f32, Self)]) -> Self;
    /// The sample that stands for "unknown".
    fn unknown() -> Self;
}

impl Mix for f32 {
    fn is_known(&self) -> bool {
        !self.is_nan()
    }
    fn mix(samples: &[(f32, Self)]) -> Self {
        samples.iter().map(|(weight, sample)| weight * sample).sum()
    }
    fn unknown() -> Self {
        Self::NAN
    }
}

impl Mix for [f32; 3] {
    fn is_known(&self) -> bool {
        !self[0].is_nan()
    }
    fn mix(samples: &[(f32, Self)]) -> Self {
        std::array::from_fn(|c| {
            samples
                .iter()
                .map(|(weight, sample)| weight * sample[c])
                .sum()
        })
    }
    fn unknown() -> Self {
        [f32::NAN; 3]
    }
}

impl Mix for Vec3 {
    fn is_known(&self) -> bool {
        !self.x.is_nan()
    }
    /// Directions: the mean is brought back to unit length.
    fn mix(samples: &[(f32, Self)]) -> Self {
        samples
            .iter()
            .map(|(weight, sample)| *weight * *sample)
            .sum::<Self>()
            .normalize_or_zero()
    }
    fn unknown() -> Self {
        Self::NAN
    }
}

/// Bilinear places of a larger grid on a smaller one along one axis: (first, second, fraction).
fn places(small: usize, large: usize) -> Vec<(usize, usize, f32)> {
    let scale = small as f32 / large as f32;
    (0..large)
        .map(|index| {
            let at = ((index as f32 + 0.5) * scale - 0.5).clamp(0.0, (small - 1) as f32);
            let first = at as usize;
            (first, (first + 1).min(small - 1), at - first as f32)
        })
        .collect()
}

fn at<T: Mix>(
    plane: &Plane<T>,
    (x0, x1, fx): (usize, usize, f32),
    (y0, y1, fy): (usize, usize, f32),
) -> T {
    let corners = [
        ((1.0 - fx) * (1.0 - fy), plane[(x0, y0)]),
        (fx * (1.0 - fy), plane[(x1, y0)]),
        ((1.0 - fx) * fy, plane[(x0, y1)]),
        (fx * fy, plane[(x1, y1)]),
    ];
    let mut known = [(0.0, T::unknown()); 4];
    let mut count = 0;
    let mut total = 0.0;
    for corner in corners.into_iter().filter(|(_, sample)| sample.is_known()) {
        known[count] = corner;
        total += corner.0;
        count += 1;
    }
    // The nearest corner decides whether there is an answer at all.
    if total < 0.5 {
        return T::unknown();
    }
    for corner in &mut known[..count] {
        corner.0 /= total;
    }
    T::mix(&known[..count])
}

/// A plane on a larger grid of the same picture; unknown stays unknown.
///
/// # Panics
/// When `plane` is empty: a bug of the caller.
pub fn enlarge<T: Mix>(plane: &Plane<T>, width: usize, height: usize) -> Plane<T> {
    let (columns, rows) = (places(plane.width(), width), places(plane.height(), height));
    let mut samples = vec![T::unknown(); width * height];
    samples
        .par_chunks_mut(width.max(1))
        .zip(rows.par_iter())
        .for_each(|(out, &row)| {
            for (out, &column) in out.iter_mut().zip(&columns) {
                *out = at(plane, column, row);
            }
        });
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// The part of the flash light's median below which a ratio to it means nothing.
const FLOOR_SHARE: f32 = 0.05;

/// A relit picture at the size of the photograph.
///
/// `small` is the flash-only light on the grid of `relit`, `full` the photograph's own.
/// Where the flash light is unknown the relit picture is enlarged plainly.
pub fn enlarge_relit(relit: &Relit, small: &LinearImage, full: &LinearImage) -> Relit {
    let (width, height) = full.0.size();
    let floor = FLOOR_SHARE * median_level(small);
    let quotient = {
        let samples = relit
            .light
            .0
            .samples()
            .par_iter()
            .zip(small.0.samples())
            .map(|(relit, flash)| std::array::from_fn(|c| relit[c] / (flash[c].max(0.0) + floor)))
            .collect();
        Plane::new(small.0.width(), small.0.height(), samples).expect("one sample per pixel")
    };
    let columns = places(small.0.width(), width);
    let rows = places(small.0.height(), height);
    let mut light = vec![[f32::NAN; 3]; width * height];
    light
        .par_chunks_mut(width.max(1))
        .zip(full.0.samples().par_chunks(width.max(1)))
        .zip(rows.par_iter())
        .for_each(|((out, flash), &row)| {
            for ((out, flash), &column) in out.iter_mut().zip(flash).zip(&columns) {
                let ratio = at(&quotient, column, row);
                *out = if ratio.is_known() && flash.is_known() {
                    std::array::from_fn(|c| ratio[c] * (flash[c].max(0.0) + floor))
                } else {
                    at(&relit.light.0, column, row)
                };
            }
        });
    Relit {
        light: LinearImage(Plane::new(width, height, light).expect("one sample per pixel")),
        shadow: enlarge(&relit.shadow, width, height),
        unseen_path_fraction: relit.unseen_path_fraction,
    }
}

/// Median of the green channel over a sparse set of pixels; a tiny positive number for a black
/// picture.
fn median_level(light: &LinearImage) -> f32 {
    let step = (light.0.len() / 10_000).max(1);
    let mut levels: Vec<f32> = light
        .0
        .samples()
        .iter()
        .step_by(step)
        .map(|pixel| pixel[1])
        .filter(|level| level.is_finite())
        .collect();
    if levels.is_empty() {
        return 1.0;
    }
    let middle = levels.len() / 2;
    levels
        .select_nth_unstable_by(middle, f32::total_cmp)
        .1
        .max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_and_a_hole_stays_a_hole() {
        let mut ramp = Plane::from_fn(8, 4, |x, _| x as f32);
        ramp[(6, 2)] = f32::NAN;
        let large = enlarge(&ramp, 32, 16);
        assert!((large[(13, 3)] - ((13.5 / 4.0) - 0.5)).abs() < 1e-5);
        assert!(large[(26, 10)].is_nan());
        assert!(large[(16, 10)].is_finite());
    }

    #[test]
    fn detail_of_the_photograph_survives_being_relit() {
        // Fine texture that the working grid averages away, under a lamp half as bright.
        let full = LinearImage(Plane::from_fn(16, 16, |x, y| {
            [if (x + y) % 2 == 0 { 0.2 } else { 0.6 }; 3]
        }));
        let small = LinearImage(Plane::filled(4, 4, [0.4; 3]));
        let relit = Relit {
            light: LinearImage(Plane::filled(4, 4, [0.2; 3])),
            shadow: Plane::filled(4, 4, 1.0),
            unseen_path_fraction: 0.0,
        };
        let large = enlarge_relit(&relit, &small, &full);
        for (relit, flash) in large.light.0.samples().iter().zip(full.0.samples()) {
            assert!((relit[0] - 0.5 * flash[0]).abs() < 0.02);
        }
    }
}
