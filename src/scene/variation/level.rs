//! The picture at one resolution, laid out so that every neighbour lies at a fixed distance.

use drivers::Plane;

/// What is solved for and what it must fit, at one resolution.
///
/// Every plane has an unknown column more than the picture on the right and an unknown row more above
/// and below: the pixel to the right is the next in memory, at the border too.
#[derive(Debug, Clone)]
pub(super) struct Level {
    pub width: usize,
    pub height: usize,
    /// What was measured, in units of the noise of one pixel; 0 where unknown.
    pub measured: Vec<f32>,
    /// Weight of `measured`; 0 where unknown.
    pub trust: Vec<f32>,
    /// How much this pixel and its right neighbour belong together, 0 to 1.
    pub right: Vec<f32>,
    /// The same for the pixel below.
    pub below: Vec<f32>,
}

impl Level {
    /// Distance in memory from a pixel to the one below.
    pub fn stride(&self) -> usize {
        self.width + 1
    }

    /// Place of pixel (x, y) in memory.
    pub fn place(&self, x: usize, y: usize) -> usize {
        (y + 1) * self.stride() + x
    }

    /// Numbers in a plane.
    pub fn len(&self) -> usize {
        (self.width + 1) * (self.height + 2)
    }

    /// `measured` and `trust` per pixel, and `bond` between a pixel and its neighbour (x + dx, y + dy).
    /// NaN = unknown.
    pub fn new(
        measured: &Plane<f32>,
        trust: &Plane<f32>,
        bond: impl Fn((usize, usize), (usize, usize)) -> f32,
    ) -> Self {
        let (width, height) = measured.size();
        let mut level = Self::empty(width, height);
        let known = |x: usize, y: usize| !measured[(x, y)].is_nan() && trust[(x, y)] > 0.0;
        for y in 0..height {
            for x in 0..width {
                if !known(x, y) {
                    continue;
                }
                let at = level.place(x, y);
                level.measured[at] = measured[(x, y)];
                level.trust[at] = trust[(x, y)];
                if x + 1 < width && known(x + 1, y) {
                    level.right[at] = bond((x, y), (x + 1, y));
                }
                if y + 1 < height && known(x, y + 1) {
                    level.below[at] = bond((x, y), (x, y + 1));
                }
            }
        }
        level
    }

    fn empty(width: usize, height: usize) -> Self {
        let nothing = vec![0.0; (width + 1) * (height + 2)];
        Self {
            width,
            height,
            measured: nothing.clone(),
            trust: nothing.clone(),
            right: nothing.clone(),
            below: nothing,
        }
    }

    /// The same picture at half the resolution.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut coarse = Self::empty(width, height);
        for y in 0..height {
            for x in 0..width {
                let at = coarse.place(x, y);
                let (mut sum, mut trust) = (0.0, 0.0);
                let (mut right, mut below) = (0.0, 0.0);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = (2 * x + dx, 2 * y + dy);
                    if x < self.width && y < self.height {
                        let fine = self.place(x, y);
                        sum += self.trust[fine] * self.measured[fine];
                        trust += self.trust[fine];
                        // The way to the next coarse pixel: half a pixel's width of this, then over.
                        right += self.right[fine];
                        below += self.below[fine];
                    }
                }
                if trust > 0.0 {
                    coarse.measured[at] = sum / trust;
                    coarse.trust[at] = 0.25 * trust;
                    coarse.right[at] = 0.25 * right;
                    coarse.below[at] = 0.25 * below;
                }
            }
        }
        for y in 0..height {
            for x in 0..width {
                let at = coarse.place(x, y);
                if x + 1 == width || coarse.trust[at + 1] == 0.0 {
                    coarse.right[at] = 0.0;
                }
                if y + 1 == height || coarse.trust[at + coarse.stride()] == 0.0 {
                    coarse.below[at] = 0.0;
                }
            }
        }
        coarse
    }
}
