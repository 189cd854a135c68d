//! A rectangle of samples in row order, and nothing else.

use rayon::prelude::*;
use std::ops::Range;
use thiserror::Error;

/// The data handed to [`Plane::new`] does not fill the rectangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{width}×{height} needs {expected} samples but {found} were given")]
pub struct SizeMismatch {
    /// Declared width in pixels.
    pub width: usize,
    /// Declared height in pixels.
    pub height: usize,
    /// `width · height`.
    pub expected: usize,
    /// Samples that were there.
    pub found: usize,
}

/// Samples on a pixel grid, row by row from the top left, without padding.
///
/// The centre of the top-left pixel is (0, 0); x runs right, y runs down.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plane<T> {
    width: usize,
    height: usize,
    samples: Vec<T>,
}

impl<T> Plane<T> {
    /// Takes `samples` as a `width`×`height` rectangle.
    ///
    /// # Errors
    /// [`SizeMismatch`] when the number of samples is not `width · height`.
    pub fn new(width: usize, height: usize, samples: Vec<T>) -> Result<Self, SizeMismatch> {
        let expected = width.saturating_mul(height);
        if samples.len() != expected {
            return Err(SizeMismatch {
                width,
                height,
                expected,
                found: samples.len(),
            });
        }
        Ok(Self {
            width,
            height,
            samples,
        })
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// `(width, height)`.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// True for a plane without pixels.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// All samples in row order.
    pub fn samples(&self) -> &[T] {
        &self.samples
    }

    /// All samples in row order, to be changed.
    pub fn samples_mut(&mut self) -> &mut [T] {
        &mut self.samples
    }

    /// The samples without their shape.
    pub fn into_samples(self) -> Vec<T> {
        self.samples
    }

    /// One row.
    ///
    /// # Panics
    /// When `y` is outside: a bug of the caller.
    pub fn row(&self, y: usize) -> &[T] {
        &self.samples[y * self.width..(y + 1) * self.width]
    }

    /// One row, to be changed.
    ///
    /// # Panics
    /// When `y` is outside: a bug of the caller.
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.samples[y * self.width..(y + 1) * self.width]
    }

    /// The sample at (x, y), or `None` outside.
    pub fn get(&self, x: usize, y: usize) -> Option<&T> {
        if x < self.width {
            self.samples.get(y * self.width + x)
        } else {
            None
        }
    }
}

impl<T: Sync> Plane<T> {
    /// A plane of the same shape with every sample passed through `change`, a large one on all threads.
    pub fn map<U: Send>(&self, change: impl Fn(&T) -> U + Sync) -> Plane<U> {
        let samples = in_parts(self.height, self.width, &|rows| {
            let samples = &self.samples[rows.start * self.width..rows.end * self.width];
            samples.iter().map(&change).collect()
        });
        Plane {
            width: self.width,
            height: self.height,
            samples,
        }
    }
}

impl<T: Send> Plane<T> {
    /// Asks `sample(x, y)` for every pixel, of a large plane on all threads.
    pub fn from_fn(width: usize, height: usize, sample: impl Fn(usize, usize) -> T + Sync) -> Self {
        let samples = in_parts(height, width, &|rows| {
            let mut part = Vec::with_capacity(rows.len() * width);
            for y in rows {
                part.extend((0..width).map(|x| sample(x, y)));
            }
            part
        });
        Self {
            width,
            height,
            samples,
        }
    }
}

/// Samples that are worth another thread.
const SHARE: usize = 16_384;

/// Rows that `part` makes, one after the other; many of them on all threads.
///
/// Compiled once for each kind of sample, and not for every use: a loop over threads is no little code.
fn in_parts<U: Send>(
    height: usize,
    width: usize,
    part: &(dyn Fn(Range<usize>) -> Vec<U> + Sync),
) -> Vec<U> {
    let rows = 1 + SHARE / width.max(1);
    if height <= rows {
        return part(0..height);
    }
    let mut parts: Vec<Vec<U>> = (0..height.div_ceil(rows)).map(|_| Vec::new()).collect();
    parts.par_iter_mut().enumerate().for_each(|(index, made)| {
        *made = part(index * rows..((index + 1) * rows).min(height));
    });
    let mut all = Vec::with_capacity(width * height);
    for mut made in parts {
        all.append(&mut made);
    }
    all
}

impl<T: Clone> Plane<T> {
    /// Every pixel the same.
    pub fn filled(width: usize, height: usize, sample: T) -> Self {
        Self {
            width,
            height,
            samples: vec![sample; width * height],
        }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Plane<T> {
    type Output = T;
    fn index(&self, (x, y): (usize, usize)) -> &T {
        debug_assert!(x < self.width);
        &self.samples[y * self.width + x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Plane<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        debug_assert!(x < self.width);
        &mut self.samples[y * self.width + x]
    }
}
