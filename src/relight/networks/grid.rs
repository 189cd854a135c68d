//! The networks' grids: so many pixels, nearly, and sides that their halvings divide.

use crate::relight::enlarge::{Mix, enlarge};
use drivers::Plane;
use rayon::prelude::*;

/// Longest side, for pictures that are all width or all height.
const LONGEST: f64 = 2048.0;

/// What a network asks of the pictures it is given.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// Pixels to come near to.
    pub pixels: f64,
    /// Both sides are multiples of this.
    pub multiple: f64,
}

impl Grid {
    /// (width, height) of the grid for a picture of this shape.
    pub(super) fn size_for(self, (width, height): (usize, usize)) -> (usize, usize) {
        let Self { pixels, multiple } = self;
        let aspect = width.max(1) as f64 / height.max(1) as f64;
        let side = |length: f64| {
            ((length / multiple).round() * multiple).clamp(multiple, LONGEST) as usize
        };
        (
            side((pixels * aspect).sqrt()),
            side((pixels / aspect).sqrt()),
        )
    }

    /// The same, but no finer than the picture.
    pub(super) fn within(self, (width, height): (usize, usize)) -> (usize, usize) {
        let pixels = self.pixels.min((width * height) as f64);
        Self { pixels, ..self }.size_for((width, height))
    }
}

/// Means over what each pixel of the grid covers; unknown samples do not take part, and a pixel that
/// is more than half unknown is unknown. Where the grid is finer, bilinear. The same size: the same.
pub fn resampled<T: Mix>(plane: &Plane<T>, (width, height): (usize, usize)) -> Plane<T> {
    if plane.size() == (width, height) {
        return plane.clone();
    }
    if plane.width() <= width || plane.height() <= height {
        return enlarge(plane, width, height);
    }
    if plane.width().is_multiple_of(width) && plane.height().is_multiple_of(height) {
        return means(plane, (width, height));
    }
    let (columns, rows) = (spans(plane.width(), width), spans(plane.height(), height));
    let area = (plane.width() * plane.height()) as f32 / (width * height) as f32;
    let mut samples = vec![T::UNKNOWN; width * height];
    let lines = samples.par_chunks_mut(width).zip(&rows);
    lines.for_each(|(out, spanned)| {
        for (out, across) in out.iter_mut().zip(&columns) {
            let (mut sum, mut total) = (T::NOTHING, 0.0);
            for &(y, tall) in spanned {
                let row = plane.row(y);
                for &(x, wide) in across {
                    let sample = row[x];
                    if sample.is_known() {
                        sum = sum.plus(tall * wide, sample);
                        total += tall * wide;
                    }
                }
            }
            if total >= 0.5 * area {
                *out = sum.over(total);
            }
        }
    });
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// [`resampled`] where every pixel covers whole samples.
fn means<T: Mix>(plane: &Plane<T>, (width, height): (usize, usize)) -> Plane<T> {
    let (wide, tall) = (plane.width() / width, plane.height() / height);
    let least = 0.5 * (wide * tall) as f32;
    let mut samples = vec![T::UNKNOWN; width * height];
    let lines = samples.par_chunks_mut(width).enumerate();
    lines.for_each(|(y, out)| {
        let rows = (y * tall..(y + 1) * tall).map(|y| plane.row(y));
        let rows: Vec<&[T]> = rows.collect();
        for (x, out) in out.iter_mut().enumerate() {
            let (mut sum, mut total) = (T::NOTHING, 0.0);
            for row in &rows {
                for sample in &row[x * wide..(x + 1) * wide] {
                    if sample.is_known() {
                        sum = sum.plus(1.0, *sample);
                        total += 1.0;
                    }
                }
            }
            if total >= least {
                *out = sum.over(total);
            }
        }
    });
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// For each of `small` pixels the samples of `large` it covers, each with the part covered.
fn spans(large: usize, small: usize) -> Vec<Vec<(usize, f32)>> {
    let scale = large as f64 / small as f64;
    (0..small)
        .map(|index| {
            let (from, to) = (index as f64 * scale, (index + 1) as f64 * scale);
            (from as usize..large.min(to.ceil() as usize))
                .map(|at| {
                    let covered = to.min((at + 1) as f64) - from.max(at as f64);
                    (at, covered as f32)
                })
                .filter(|(_, covered)| *covered > 1e-6)
                .collect()
        })
        .collect()
}

/// The sample under the middle of each pixel: for depth, whose mean over an edge is no surface.
pub(super) fn nearest<T: Copy + Send + Sync>(
    plane: &Plane<T>,
    (width, height): (usize, usize),
) -> Plane<T> {
    let at = |index: usize, small: usize, large: usize| {
        ((2 * index + 1) * large / (2 * small)).min(large - 1)
    };
    Plane::from_fn(width, height, |x, y| {
        plane[(at(x, width, plane.width()), at(y, height, plane.height()))]
    })
}

#[cfg(test)]
mod tests {
    use super::{super::feed::GRID, *};

    #[test]
    fn grids_have_the_pixels_of_128_squared_and_sides_that_halve_five_times() {
        struct Case((usize, usize), (usize, usize));
        for Case(picture, grid) in [
            Case((128, 128), (128, 128)),
            Case((256, 256), (128, 128)),
            // √(16384 · 16/9) = 170.7 and √(16384 · 9/16) = 96, to the nearest 32.
            Case((1280, 720), (160, 96)),
            Case((4000, 3000), (160, 96)),
            Case((3000, 4000), (96, 160)),
            Case((9000, 1), (2048, 32)),
        ] {
            assert_eq!(GRID.size_for(picture), grid, "{picture:?}");
        }
    }

    #[test]
    fn a_mean_weighs_what_it_covers_and_leaves_out_what_is_unknown() {
        let plane = Plane::from_fn(3, 2, |x, _| [1.0f32, 4.0, 7.0][x]);
        // Pixels of 1.5 samples: (1 + 4/2) / 1.5 and (4/2 + 7) / 1.5; the rows are alike.
        let small = resampled(&plane, (2, 1));
        assert!((small[(0, 0)] - 2.0).abs() < 1e-6 && (small[(1, 0)] - 6.0).abs() < 1e-6);
        let mut holed = plane;
        holed[(2, 0)] = f32::NAN;
        let small = resampled(&holed, (1, 1));
        assert!((small[(0, 0)] - (1.0 + 4.0 + 1.0 + 4.0 + 7.0) / 5.0).abs() < 1e-5);
        holed = holed.map(|_| f32::NAN);
        holed[(0, 0)] = 1.0;
        assert!(resampled(&holed, (1, 1))[(0, 0)].is_nan());
    }

    #[test]
    fn a_picture_of_the_grids_size_stays_as_it_is() {
        let plane = Plane::from_fn(128, 128, |x, y| (x * 7 + y) as f32);
        assert_eq!(resampled(&plane, GRID.size_for(plane.size())), plane);
        assert_eq!(nearest(&plane, (128, 128)), plane);
    }
}
