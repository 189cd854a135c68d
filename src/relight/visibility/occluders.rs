//! The depth map as slabs, packed for sweeping along rows and along columns.

use drivers::{Intrinsics, Plane};

/// One pixel's slab: inverse depth, and thickness with sigma as two bfloat16.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Slab {
    /// 1 / z in 1/m; 0 = unknown (no slab, no answer).
    pub inverse_depth: f32,
    /// Upper half: thickness in metres of z; lower half: sigma of z in metres.
    pub thickness_sigma: u32,
}

impl Slab {
    fn new(metres: f32, thickness_metres: f32, sigma_metres: f32) -> Self {
        if !(metres.is_finite() && metres > 0.0) {
            return Self::default();
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
        Self {
            inverse_depth: 1.0 / metres,
            thickness_sigma: thickness.to_bits() & 0xffff_0000 | sigma.to_bits() >> 16,
        }
    }
}

/// Slabs of a whole picture, in row order and in column order.
#[derive(Debug, Clone)]
pub struct Occluders {
    pub(super) camera: Intrinsics,
    pub(super) by_row: Plane<Slab>,
    /// Transposed: `by_column[(y, x)]` is the pixel (x, y).
    pub(super) by_column: Plane<Slab>,
    /// Depth under which almost nothing lies (second percentile), metres: a path to the lamp
    /// that leaves the frame nearer than this can hardly meet anything.
    pub(super) near_metres: f32,
}

impl Occluders {
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
            Slab::new(
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
            by_row: Plane::from_fn(width, height, slab),
            by_column: Plane::from_fn(height, width, |y, x| slab(x, y)),
            near_metres,
        }
    }

    /// `(width, height)` in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.by_row.size()
    }

    /// Depth at a pixel in metres; +∞ where it is unknown.
    pub(super) fn metres(&self, x: usize, y: usize) -> f32 {
        1.0 / self.by_row[(x, y)].inverse_depth
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
            self.by_row[(x.min(width - 1), y.min(height - 1))]
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
            by_row: Plane::from_fn(small_width, small_height, slab),
            by_column: Plane::from_fn(small_height, small_width, |y, x| slab(x, y)),
            near_metres: self.near_metres,
        }
    }
}
