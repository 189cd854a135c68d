//! The depth map as slabs, packed for sweeping along rows and along columns.

use drivers::{Intrinsics, Plane};
use rayon::prelude::*;

/// One pixel's slab: 1 / z in 1/m as the bits of a float (0 = unknown: no slab, no answer), then
/// thickness (upper half) and sigma (lower half), both in metres of z, as two bfloat16.
type Slab = [u32; 2];

fn slab(metres: f32, thickness_metres: f32, sigma_metres: f32) -> Slab {
    if !(metres.is_finite() && metres > 0.0) {
        return [0; 2];
    }
    let thickness = if thickness_metres > 0.0 {
        thickness_metres.min(1e6)
    } else {
        0.0
    };
    let sigma = if sigma_metres > 0.0 {
        sigma_metres.min(1e3)
    } else {
        0.0
    };
    [
        (1.0 / metres).to_bits(),
        thickness.to_bits() & 0xffff_0000 | sigma.to_bits() >> 16,
    ]
}

/// Slabs line by line; one more stands behind the last, so that each can be read with the next.
#[derive(Debug, Clone)]
pub(super) struct Slabs {
    /// Slabs of a line.
    pub length: usize,
    samples: Vec<Slab>,
}

impl Slabs {
    fn new(length: usize, lines: usize, slab: impl Fn(usize, usize) -> Slab + Sync) -> Self {
        let mut samples = vec![[0; 2]; length * lines + 1];
        samples[..length * lines]
            .par_chunks_mut(length.max(1))
            .enumerate()
            .for_each(|(line, samples)| {
                for (at, sample) in samples.iter_mut().enumerate() {
                    *sample = slab(at, line);
                }
            });
        Self { length, samples }
    }

    fn thickened(&self, factor: f32) -> Self {
        let thicker = |[inverse, packed]: Slab| {
            let thickness = f32::from_bits(packed & 0xffff_0000) * factor;
            [
                inverse,
                thickness.min(1e6).to_bits() & 0xffff_0000 | packed & 0xffff,
            ]
        };
        Self {
            length: self.length,
            samples: self.samples.iter().copied().map(thicker).collect(),
        }
    }

    /// The words of a line's slabs and of one slab more.
    #[inline(always)]
    pub fn line(&self, line: usize) -> &[u32] {
        let start = line * self.length;
        self.samples[start..=start + self.length].as_flattened()
    }
}

/// Slabs of a whole picture, in row order and in column order.
#[derive(Debug, Clone)]
pub struct Occluders {
    pub(super) camera: Intrinsics,
    pub(super) by_row: Slabs,
    pub(super) by_column: Slabs,
    /// Depth under which almost nothing lies (second percentile), metres: a path to the lamp
    /// that leaves the frame nearer than this can hardly meet anything.
    pub(super) near_metres: f32,
}

impl Occluders {
    /// The same slabs, `factor` times as thick.
    pub fn thickened(&self, factor: f32) -> Self {
        Self {
            by_row: self.by_row.thickened(factor),
            by_column: self.by_column.thickened(factor),
            ..*self
        }
    }

    /// Packs the slabs. `camera` must be a pinhole (its distortion is ignored); all planes lie on
    /// its grid. Depth NaN = no slab.
    ///
    /// # Panics
    /// When the planes differ in size: a bug of the caller.
    pub fn new(
        camera: Intrinsics,
        metres: &Plane<f32>,
        thickness_metres: &Plane<f32>,
        sigma_metres: &Plane<f32>,
    ) -> Self {
        assert_eq!(metres.size(), thickness_metres.size());
        assert_eq!(metres.size(), sigma_metres.size());
        let (width, height) = metres.size();
        let slab = |x: usize, y: usize| {
            slab(
                metres[(x, y)],
                thickness_metres[(x, y)],
                sigma_metres[(x, y)],
            )
        };
        let mut known: Vec<f32> = metres
            .samples()
            .iter()
            .step_by((metres.len() / 65_536).max(1))
            .copied()
            .filter(|z| z.is_finite())
            .collect();
        let near_metres = if known.is_empty() {
            f32::INFINITY
        } else {
            let rank = known.len() / 50;
            *known.select_nth_unstable_by(rank, f32::total_cmp).1
        };
        Self {
            camera,
            by_row: Slabs::new(width, height, slab),
            by_column: Slabs::new(height, width, |y, x| slab(x, y)),
            near_metres,
        }
    }

    /// `(width, height)` in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.camera.width, self.camera.height)
    }

    /// Depth at a pixel in metres; +∞ where it is unknown.
    pub(super) fn metres(&self, x: usize, y: usize) -> f32 {
        1.0 / f32::from_bits(self.by_row.line(y)[2 * x])
    }

    /// The same slabs on a grid `factor` times as coarse, each taken from the middle pixel of its
    /// square (never a mean, which would invent surfaces between two others).
    #[must_use]
    pub(in crate::relight) fn reduced(&self, factor: usize) -> Self {
        let (width, height) = self.size();
        let (small_width, small_height) = (width.div_ceil(factor), height.div_ceil(factor));
        let middle = (factor - 1) / 2;
        let slab = |x: usize, y: usize| {
            let (x, y) = (factor * x + middle, factor * y + middle);
            let (x, y) = (x.min(width - 1), y.min(height - 1));
            [0, 1].map(|word| self.by_row.line(y)[2 * x + word])
        };
        let mut camera = self.camera;
        (camera.width, camera.height) = (small_width, small_height);
        let scale = 1.0 / factor as f64;
        camera.fx *= scale;
        camera.fy *= scale;
        camera.cx = (camera.cx - middle as f64) * scale;
        camera.cy = (camera.cy - middle as f64) * scale;
        Self {
            camera,
            by_row: Slabs::new(small_width, small_height, slab),
            by_column: Slabs::new(small_height, small_width, |y, x| slab(x, y)),
            near_metres: self.near_metres,
        }
    }
}
