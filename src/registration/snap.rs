//! Puts depth edges where the color picture has them.
//!
//! A depth camera is coarse: near a silhouette the splatted edge wanders by about one of its
//! samples. Every pixel of that band asks its surroundings which of the two surfaces, near or far,
//! looks more like itself, and takes its depth from a plane through that surface. Where both look
//! alike the depth stays. A two-surface form of the weighted mode filter (Min, Lu & Do, "Depth
//! Video Enhancement Based on Weighted Mode Filtering", 2012).

mod band;
mod window;

use super::{RegisteredDepth, guide::Guide};
use band::Band;
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use window::{LANES, Patch, Picture, Shape, WIDEST};

/// Neighbours whose inverse depths differ by more than this share lie on two surfaces…
const JUMP: f32 = 0.02;
/// …or by what a surface of this tangent of tilt shows between two pixels, whichever is more.
const STEEPEST: f32 = 10.0;
/// Rows that are worth a task: of plain arithmetic, and of windows.
const ROWS_PER_TASK: usize = 16;
const WINDOW_ROWS_PER_TASK: usize = 4;

/// Planes kept between frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Snap {
    /// Inverse depth before the change; NaN = unknown.
    near: Vec<f32>,
    band: Band,
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
        self.near.resize(width * height, f32::NAN);
        self.near
            .par_chunks_mut(width)
            .zip(registered.metres.samples().par_chunks(width))
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(near, metres)| {
                for (near, z) in near.iter_mut().zip(metres) {
                    *near = 1.0 / z;
                }
            });
        self.band.mark(&self.near, width, reach, jump);
        let picture = Picture {
            near: &self.near,
            band: &self.band,
            guide,
            width,
            height,
            jump,
            shape: Shape::new(reach),
        };
        registered
            .metres
            .samples_mut()
            .par_chunks_mut(width)
            .zip(registered.sigma_metres.samples_mut().par_chunks_mut(width))
            .zip(registered.measured.samples_mut().par_chunks_mut(width))
            .enumerate()
            .with_min_len(WINDOW_ROWS_PER_TASK)
            .for_each_init(Patch::default, |patch, (y, ((metres, sigma), measured))| {
                let row = Row {
                    y,
                    metres,
                    sigma,
                    measured,
                };
                dispatch!(Level::new(), simd => row.snap(simd, &picture, patch));
            });
    }
}

/// One row of the result.
struct Row<'a> {
    y: usize,
    metres: &'a mut [f32],
    sigma: &'a mut [f32],
    measured: &'a mut [bool],
}

impl Row<'_> {
    #[inline(always)]
    fn snap<S: Simd>(self, simd: S, picture: &Picture, patch: &mut Patch) {
        let mut next = 0;
        while let Some(first) = picture.band.next(next, self.y) {
            next = first + LANES;
            let pixels = first..next.min(picture.width);
            let measured = self.measured[pixels.clone()]
                .iter()
                .rev()
                .fold(0, |bits, &measured| bits << 1 | u64::from(measured));
            let Some(decided) = patch.decide(simd, picture, [first, self.y], measured) else {
                continue;
            };
            let in_band = picture.band.pixels(first as isize, self.y);
            for (n, x) in pixels.enumerate() {
                let near = decided.near[n];
                if in_band >> n & 1 == 0 || near == 0.0 {
                    continue;
                }
                self.metres[x] = 1.0 / near;
                // Inverse depth scatters by scatter: depth by scatter · z².
                let scatter = decided.scatter[n] / (near * near);
                // `max` passes over NaN.
                self.sigma[x] = self.sigma[x].max(scatter);
                self.measured[x] &= decided.moved >> n & 1 == 0;
            }
        }
    }
}
