//! What the surroundings of pixels at a depth edge say about their depth.

use super::band::Band;
use crate::registration::guide::{Guide, likeness};
use fearless_simd::{Simd, f32x8, prelude::*};

/// How much more alike the other surface must look before a pixel changes sides.
const CLEARLY: f32 = 3.0;
/// Trust in a sample inside the band, where edges wander, against one outside.
const IN_BAND: f32 = 0.15;
/// How much of that a filled pixel asks for, which was a guess to begin with.
const FILLED: f32 = 0.3;
/// The band is at most this wide on each side, pixels.
pub(super) const WIDEST: usize = 8;
/// Taps from the middle of a window to its side, at most.
const TAPS_ASIDE: usize = 4;

/// Neighbouring pixels decided together.
pub(super) const LANES: usize = 8;
/// Most taps along one side of a window.
const TAPS: usize = 2 * TAPS_ASIDE + 1;
/// Most columns that the windows of [`LANES`] pixels cover.
const COLUMNS: usize = LANES + 4 * WIDEST;

/// The picture that windows are cut from.
pub(super) struct Picture<'a> {
    /// Inverse depth; NaN = unknown.
    pub near: &'a [f32],
    pub band: &'a Band,
    pub guide: &'a Guide,
    pub width: usize,
    pub height: usize,
    /// Least share of inverse depth between two surfaces.
    pub jump: f32,
    pub shape: Shape,
}

/// Taps of a window.
pub(super) struct Shape {
    radius: usize,
    stride: usize,
    /// Taps along one side.
    taps: usize,
    /// Trust in a tap by row and column, falling with its distance.
    trust: [[f32; TAPS]; TAPS],
}

impl Shape {
    /// For a band of `reach` ≤ [`WIDEST`] pixels on each side of an edge.
    pub fn new(reach: usize) -> Self {
        let widest = 2 * reach.min(WIDEST);
        let stride = widest.div_ceil(TAPS_ASIDE);
        let radius = widest / stride * stride;
        let mut shape = Self {
            radius,
            stride,
            taps: 2 * radius / stride + 1,
            trust: [[0.0; TAPS]; TAPS],
        };
        let per_spread = 1.0 / (reach * reach) as f32;
        for row in 0..shape.taps {
            for column in 0..shape.taps {
                let [dx, dy] = [column, row].map(|tap| shape.offset(tap));
                shape.trust[row][column] = 1.0 / (1.0 + (dx * dx + dy * dy) * per_spread);
            }
        }
        shape
    }

    /// Pixels from the middle.
    #[inline(always)]
    fn offset(&self, tap: usize) -> f32 {
        (tap * self.stride) as f32 - self.radius as f32
    }
}

/// What is decided of [`LANES`] pixels side by side.
pub(super) struct Decision {
    /// Inverse depth; 0 = left as it was, there is one surface only.
    pub near: [f32; LANES],
    /// Standard deviation of `near`.
    pub scatter: [f32; LANES],
    /// Bit per pixel: it changed sides.
    pub moved: u64,
}

/// The surroundings of [`LANES`] pixels, row by row as far as they are tapped.
pub(super) struct Patch {
    /// Inverse depth; 0 = unknown.
    near: [[f32; COLUMNS]; TAPS],
    /// Share of trust; 0 = unknown.
    share: [[f32; COLUMNS]; TAPS],
    /// Steps of color, 0 ..= 255.
    colors: [[[f32; COLUMNS]; 3]; TAPS],
    /// Trust times likeness per tap, less than 0 on the far surface.
    weights: [[[f32; LANES]; TAPS]; TAPS],
}

impl Default for Patch {
    fn default() -> Self {
        Self {
            near: [[0.0; COLUMNS]; TAPS],
            share: [[0.0; COLUMNS]; TAPS],
            colors: [[[0.0; COLUMNS]; 3]; TAPS],
            weights: [[[0.0; LANES]; TAPS]; TAPS],
        }
    }
}

impl Patch {
    /// Cuts out what surrounds pixels `x..x + LANES` of row `y`.
    #[inline(always)]
    fn cut(&mut self, picture: &Picture, x: usize, y: usize) {
        let Shape { radius, stride, .. } = picture.shape;
        let start = x as isize - radius as isize;
        let columns = start.max(0) as usize..(x + LANES + radius).min(picture.width);
        let inside = (columns.start as isize - start) as usize..;
        for tap in 0..picture.shape.taps {
            let (near, share) = (&mut self.near[tap], &mut self.share[tap]);
            let row = (y + tap * stride).checked_sub(radius);
            let Some(row) = row.filter(|row| *row < picture.height) else {
                (*near, *share) = ([0.0; COLUMNS], [0.0; COLUMNS]);
                continue;
            };
            if columns.len() < LANES + 2 * radius {
                *near = [f32::NAN; COLUMNS];
            }
            let from = row * picture.width;
            let from = from + columns.start..from + columns.end;
            near[inside.clone()][..columns.len()].copy_from_slice(&picture.near[from.clone()]);
            let in_band = picture.band.pixels(start, row);
            for (n, (near, share)) in near.iter_mut().zip(share).enumerate() {
                let known = !near.is_nan();
                let trusted = if in_band >> n & 1 == 1 { IN_BAND } else { 1.0 };
                *share = if known { trusted } else { 0.0 };
                *near = if known { *near } else { 0.0 };
            }
            let colors = self.colors[tap].each_mut();
            picture
                .guide
                .channels(from, colors.map(|color| &mut color[inside.clone()]));
        }
    }

    /// Decides pixels `x..x + LANES` of row `y`; `measured` has a bit for each.
    #[inline(always)]
    pub fn decide<S: Simd>(
        &mut self,
        simd: S,
        picture: &Picture,
        [x, y]: [usize; 2],
        measured: u64,
    ) -> Option<Decision> {
        self.cut(picture, x, y);
        let shape = &picture.shape;
        let splat = |value: f32| f32x8::splat(simd, value);
        let tap = |plane: &[f32; COLUMNS], column: usize| {
            f32x8::from_slice(simd, &plane[column * shape.stride..][..LANES])
        };
        let zero = splat(0.0);

        let (mut least, mut most) = (splat(f32::INFINITY), zero);
        for near in &self.near[..shape.taps] {
            for column in 0..shape.taps {
                let near = tap(near, column);
                let known = near.simd_gt(zero);
                least = least.min(known.select(near, splat(f32::INFINITY)));
                most = most.max(near);
            }
        }
        let two_surfaces = (most - least).simd_gt(splat(picture.jump) * most);
        if !two_surfaces.any_true() {
            return None;
        }
        let between = splat(0.5) * (least + most);

        let middle = shape.radius / shape.stride;
        let color = self.colors[middle].map(|plane| tap(&plane, middle));
        let [mut close, mut far] = [Likeness {
            trust: zero,
            alike: zero,
        }; 2];
        let (mut least_close, mut most_far) = (splat(f32::INFINITY), zero);
        for row in 0..shape.taps {
            for column in 0..shape.taps {
                let near = tap(&self.near[row], column);
                let trust = splat(shape.trust[row][column]) * tap(&self.share[row], column);
                let [r, g, b] = &self.colors[row];
                let there = [tap(r, column), tap(g, column), tap(b, column)];
                let weight = trust * likeness(simd, color, there);
                let is_close = near.simd_gt(between);
                close.add(is_close.select(trust, zero), is_close.select(weight, zero));
                far.add(is_close.select(zero, trust), is_close.select(zero, weight));
                least_close = least_close.min(is_close.select(near, splat(f32::INFINITY)));
                most_far = most_far.max(is_close.select(zero, near));
                is_close
                    .select(weight, -weight)
                    .store_slice(&mut self.weights[row][column]);
            }
        }

        let here = tap(&self.near[middle], middle);
        let was_close = here.simd_gt(between);
        let lean = std::array::from_fn::<_, LANES, _>(|n| match measured >> n & 1 {
            1 => CLEARLY,
            _ => 1.0 + FILLED * (CLEARLY - 1.0),
        });
        let lean = f32x8::load_array(simd, lean);
        let lean = here.simd_gt(zero).select(lean, splat(1.0));
        let (close_likeness, far_likeness) = (close.mean(simd), far.mean(simd));
        let stays_close = (close_likeness * lean).simd_ge(far_likeness);
        let comes_close = close_likeness.simd_gt(far_likeness * lean);
        let is_close = was_close.select(stays_close, comes_close);

        let side = is_close.select(splat(1.0), splat(-1.0));
        let mut plane = Moments::new(simd);
        for row in 0..shape.taps {
            let dy = splat(shape.offset(row));
            for column in 0..shape.taps {
                let weight = f32x8::from_slice(simd, &self.weights[row][column]);
                let weight = (weight * side).max(zero);
                let dx = splat(shape.offset(column));
                plane.add(dx, dy, tap(&self.near[row], column), weight);
            }
        }
        let alike = is_close.select(close.alike, far.alike);
        let (near, scatter) = plane.at_middle(simd, alike);
        let known = near.is_finite();
        let near = near
            .max(is_close.select(least_close, least))
            .min(is_close.select(most, most_far));
        let decided = two_surfaces & known & near.simd_gt(zero);
        Some(Decision {
            near: decided.select(near, zero).into(),
            scatter: scatter.into(),
            moved: (is_close ^ was_close).to_bitmask(),
        })
    }
}

/// How alike one of the two surfaces looks.
#[derive(Clone, Copy)]
struct Likeness<S: Simd> {
    trust: f32x8<S>,
    /// Trust times likeness.
    alike: f32x8<S>,
}

impl<S: Simd> Likeness<S> {
    #[inline(always)]
    fn add(&mut self, trust: f32x8<S>, weight: f32x8<S>) {
        self.trust += trust;
        self.alike += weight;
    }

    #[inline(always)]
    fn mean(&self, simd: S) -> f32x8<S> {
        self.alike / self.trust.max(f32x8::splat(simd, 1e-9))
    }
}

/// Weighted sums of offsets (x, y) and inverse depth w, for a plane through a surface.
struct Moments<S: Simd> {
    x: f32x8<S>,
    y: f32x8<S>,
    xx: f32x8<S>,
    xy: f32x8<S>,
    yy: f32x8<S>,
    w: f32x8<S>,
    xw: f32x8<S>,
    yw: f32x8<S>,
    ww: f32x8<S>,
}

impl<S: Simd> Moments<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        let [x, y, xx, xy, yy, w, xw, yw, ww] = [zero; 9];
        Self {
            x,
            y,
            xx,
            xy,
            yy,
            w,
            xw,
            yw,
            ww,
        }
    }

    #[inline(always)]
    fn add(&mut self, x: f32x8<S>, y: f32x8<S>, w: f32x8<S>, weight: f32x8<S>) {
        let (by_x, by_y, by_w) = (weight * x, weight * y, weight * w);
        self.x += by_x;
        self.y += by_y;
        self.xx += by_x * x;
        self.xy += by_x * y;
        self.yy += by_y * y;
        self.w += by_w;
        self.xw += by_x * w;
        self.yw += by_y * w;
        self.ww += by_w * w;
    }

    /// Inverse depth of the plane at the middle of the window, and its scatter, for sums of
    /// weights `alike`.
    #[inline(always)]
    fn at_middle(&self, simd: S, alike: f32x8<S>) -> (f32x8<S>, f32x8<S>) {
        let per = f32x8::splat(simd, 1.0) / alike;
        let (x, y, w) = (self.x * per, self.y * per, self.w * per);
        // Ridge: with samples on one side only the slope stays small.
        let ridge = f32x8::splat(simd, 0.5);
        let xx = self.xx * per - x * x + ridge;
        let yy = self.yy * per - y * y + ridge;
        let xy = self.xy * per - x * y;
        let (xw, yw) = (self.xw * per - x * w, self.yw * per - y * w);
        let determinant = xx * yy - xy * xy;
        let slope_x = (xw * yy - yw * xy) / determinant;
        let slope_y = (yw * xx - xw * xy) / determinant;
        let at = w - slope_x * x - slope_y * y;
        let explained = slope_x * xw + slope_y * yw;
        let zero = f32x8::splat(simd, 0.0);
        (at, (self.ww * per - w * w - explained).max(zero).sqrt())
    }
}
