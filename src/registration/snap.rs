//! Puts depth edges where the color picture has them.
//!
//! A depth camera is coarse: near a silhouette the splatted edge wanders by about one of its
//! samples. Every pixel of that band asks its surroundings which of the two surfaces, near or far,
//! looks more like itself, and takes its depth from a plane through that surface. Where both look
//! alike the depth stays. A two-surface form of the weighted mode filter (Min, Lu & Do, "Depth
//! Video Enhancement Based on Weighted Mode Filtering", 2012).

use super::{RegisteredDepth, guide::Guide};
use rayon::prelude::*;

/// Neighbours whose inverse depths differ by more than this share lie on two surfaces…
const JUMP: f32 = 0.02;
/// …or by what a surface of this tangent of tilt shows between two pixels, whichever is more.
const STEEPEST: f32 = 10.0;
/// How much more alike the other surface must look before a pixel changes sides.
const CLEARLY: f32 = 1.25;
/// Trust in a sample inside the band, where edges wander, against one outside.
const IN_BAND: f32 = 0.15;
/// How much of that a filled pixel asks for, which was a guess to begin with.
const FILLED: f32 = 0.3;
/// The band is at most this wide on each side, pixels.
const WIDEST: usize = 8;

/// Planes kept between frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Snap {
    /// Inverse depth before the change; NaN = unknown.
    near: Vec<f32>,
    band: Vec<bool>,
    swap: Vec<bool>,
}

/// Weighted sums over one of the two surfaces in a window.
#[derive(Debug, Clone, Copy, Default)]
struct Side {
    /// Trust, and trust times likeness.
    trust: f32,
    alike: f32,
    /// Moments of (x, y, inverse depth) for a plane, weighted by trust and likeness.
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    w: f32,
    xw: f32,
    yw: f32,
    ww: f32,
    least: f32,
    most: f32,
}

impl Side {
    fn add(&mut self, x: f32, y: f32, w: f32, trust: f32, likeness: f32) {
        if self.trust == 0.0 {
            (self.least, self.most) = (w, w);
        }
        self.least = self.least.min(w);
        self.most = self.most.max(w);
        self.trust += trust;
        let weight = trust * likeness;
        self.alike += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
        self.yy += weight * y * y;
        self.w += weight * w;
        self.xw += weight * x * w;
        self.yw += weight * y * w;
        self.ww += weight * w * w;
    }

    /// Mean likeness of the surface to the pixel in the middle.
    fn likeness(&self) -> f32 {
        self.alike / self.trust.max(1e-9)
    }

    /// Inverse depth of the surface's plane at the middle of the window, and its scatter.
    fn plane(&self) -> (f32, f32) {
        let per = 1.0 / self.alike;
        let (x, y, w) = (self.x * per, self.y * per, self.w * per);
        // Ridge: with samples on one side only the slope stays small.
        let xx = self.xx * per - x * x + 0.5;
        let yy = self.yy * per - y * y + 0.5;
        let xy = self.xy * per - x * y;
        let (xw, yw) = (self.xw * per - x * w, self.yw * per - y * w);
        let determinant = xx * yy - xy * xy;
        let slope_x = (xw * yy - yw * xy) / determinant;
        let slope_y = (yw * xx - xw * xy) / determinant;
        let at = (w - slope_x * x - slope_y * y).clamp(self.least, self.most);
        let explained = slope_x * xw + slope_y * yw;
        (at, (self.ww * per - w * w - explained).max(0.0).sqrt())
    }
}

impl Snap {
    /// Moves the depth edges of `registered`. `footprint` is how many color pixels one depth
    /// sample spans; `focal` the color lens's focal length in pixels. Without a guide nothing
    /// moves.
    pub fn edges(
        &mut self,
        registered: &mut RegisteredDepth,
        guide: &Guide,
        footprint: f32,
        focal: f32,
    ) {
        if guide.is_empty() {
            return;
        }
        let (width, height) = registered.metres.size();
        let reach = (footprint.ceil().max(1.0) as usize + 1).min(WIDEST);
        let jump = JUMP.max(STEEPEST / focal);
        self.near.clear();
        self.near
            .extend(registered.metres.samples().iter().map(|z| 1.0 / z));
        self.mark(width, height, reach, jump);
        let (near, band) = (&self.near, &self.band);
        registered
            .metres
            .samples_mut()
            .par_chunks_mut(width)
            .zip(registered.sigma_metres.samples_mut().par_chunks_mut(width))
            .zip(registered.measured.samples_mut().par_chunks_mut(width))
            .enumerate()
            .with_min_len(4)
            .for_each(|(y, ((metres, sigma), measured))| {
                for x in (0..width).filter(|x| band[y * width + x]) {
                    let window = Window {
                        near,
                        band,
                        guide,
                        width,
                        height,
                        reach,
                        jump,
                    };
                    let Some((w, scatter, moved)) = window.decide(x, y, measured[x]) else {
                        continue;
                    };
                    metres[x] = 1.0 / w;
                    // Inverse depth scatters by scatter: depth by scatter · z².
                    let scatter = scatter / (w * w);
                    sigma[x] = if sigma[x].is_nan() {
                        scatter
                    } else {
                        sigma[x].max(scatter)
                    };
                    measured[x] &= !moved;
                }
            });
    }

    /// Marks what lies within `reach` of a jump.
    fn mark(&mut self, width: usize, height: usize, reach: usize, jump: f32) {
        let near = &self.near;
        let apart = |a: f32, b: f32| (a - b).abs() > jump * a.max(b);
        self.swap.clear();
        self.swap.resize(width * height, false);
        self.swap
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, out)| {
                for (x, out) in out.iter_mut().enumerate() {
                    let i = y * width + x;
                    *out = (x > 0 && apart(near[i], near[i - 1]))
                        || (y > 0 && apart(near[i], near[i - width]));
                }
            });
        // Widened along rows, then along columns.
        let jumps = &self.swap;
        self.band.clear();
        self.band.resize(width * height, false);
        self.band
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, out)| {
                let row = &jumps[y * width..(y + 1) * width];
                for x in (0..width).filter(|&x| row[x]) {
                    out[x.saturating_sub(reach)..(x + reach).min(width)].fill(true);
                }
            });
        let rows = &self.band;
        self.swap
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, out)| {
                out.fill(false);
                for from in y.saturating_sub(reach - 1)..(y + reach + 1).min(height) {
                    let row = &rows[from * width..(from + 1) * width];
                    for (out, &marked) in out.iter_mut().zip(row) {
                        *out |= marked;
                    }
                }
            });
        std::mem::swap(&mut self.band, &mut self.swap);
    }
}

struct Window<'a> {
    near: &'a [f32],
    band: &'a [bool],
    guide: &'a Guide,
    width: usize,
    height: usize,
    reach: usize,
    jump: f32,
}

impl Window<'_> {
    /// Inverse depth at (x, y), its scatter, and whether the pixel changed sides; `None` where
    /// there is one surface only.
    fn decide(&self, x: usize, y: usize, measured: bool) -> Option<(f32, f32, bool)> {
        let middle = y * self.width + x;
        let radius = 2 * self.reach;
        let stride = if radius > 6 { 2 } else { 1 };
        let rows = (y.saturating_sub(radius)..(y + radius + 1).min(self.height)).step_by(stride);
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(self.width);
        let (mut least, mut most) = (f32::INFINITY, 0.0f32);
        for row in rows.clone() {
            for column in columns.clone().step_by(stride) {
                let w = self.near[row * self.width + column];
                least = least.min(w);
                most = most.max(w);
            }
        }
        if most - least <= self.jump * most {
            return None;
        }
        let between = 0.5 * (least + most);
        let per_spread = 1.0 / (self.reach * self.reach) as f32;
        let (mut far, mut close) = (Side::default(), Side::default());
        for row in rows {
            for column in columns.clone().step_by(stride) {
                let at = row * self.width + column;
                let w = self.near[at];
                if w.is_nan() {
                    continue;
                }
                let (dx, dy) = (column as f32 - x as f32, row as f32 - y as f32);
                let mut trust = 1.0 / (1.0 + (dx * dx + dy * dy) * per_spread);
                if self.band[at] {
                    trust *= IN_BAND;
                }
                let side = if w > between { &mut close } else { &mut far };
                side.add(dx, dy, w, trust, self.guide.likeness(middle, at));
            }
        }
        if far.trust == 0.0 || close.trust == 0.0 {
            return None;
        }
        let here = self.near[middle];
        let was_close = here > between;
        let lean = if here.is_nan() {
            1.0
        } else if measured {
            CLEARLY
        } else {
            1.0 + FILLED * (CLEARLY - 1.0)
        };
        let (close_likeness, far_likeness) = (close.likeness(), far.likeness());
        let is_close = if was_close {
            close_likeness * lean >= far_likeness
        } else {
            close_likeness > far_likeness * lean
        };
        let (w, scatter) = if is_close { close.plane() } else { far.plane() };
        (w > 0.0 && w.is_finite()).then_some((w, scatter, is_close != was_close))
    }
}
