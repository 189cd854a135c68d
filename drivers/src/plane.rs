//! A rectangle of samples in row order, and nothing else.

use rayon::prelude::*;
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

/// Samples that are worth another thread.
const SHARE: usize = 16_384;

impl<T: Sync> Plane<T> {
    /// A plane of the same shape with every sample passed through `change`, a large one on all threads.
    pub fn map<U: Send>(&self, change: impl Fn(&T) -> U + Send + Sync) -> Plane<U> {
        let samples = if self.len() <= SHARE {
            self.samples.iter().map(change).collect()
        } else {
            let samples = self.samples.par_iter().with_min_len(SHARE / 2);
            samples.map(change).collect()
        };
        Plane {
            width: self.width,
            height: self.height,
            samples,
        }
    }
}

impl<T: Send> Plane<T> {
    /// Asks `sample(x, y)` for every pixel, of a large plane on all threads.
    pub fn from_fn(
        width: usize,
        height: usize,
        sample: impl Fn(usize, usize) -> T + Send + Sync,
    ) -> Self {
        let mut samples = Vec::with_capacity(width * height);
        let sample = &sample;
        let row = |y| (0..width).map(move |x| sample(x, y));
        if width * height <= SHARE {
            samples.extend((0..height).flat_map(row));
        } else {
            let rows = (0..height).into_par_iter();
            let rows = rows.with_min_len(1 + SHARE / 2 / width);
            samples.par_extend(rows.flat_map_iter(row));
        }
        Self {
            width,
            height,
            samples,
        }
    }
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
