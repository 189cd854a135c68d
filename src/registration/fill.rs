//! Closes gaps in registered depth along the edges of the color picture.
//!
//! Every unknown pixel looks left, right, up and down for the nearest measured pixel and counts
//! the color edges on the way: two sweeps over columns, two over rows, linear in the picture and
//! independent of how far a gap reaches. Where the answers lie on one surface they are blended in
//! inverse depth by nearness; where they lie on two, the side with fewer edges in between wins
//! and the farther side wins ties, because what a gap beside a near thing uncovers is background.

mod gap;
mod sweep;

use super::RegisteredDepth;
use super::guide::Guide;
use gap::Judge;
use rayon::prelude::*;
use sweep::{Columns, FAR, Look};

/// Planes that closing gaps keeps between frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Gaps {
    metres: Vec<f32>,
    sigma: Vec<f32>,
    columns: Columns,
}

impl Gaps {
    /// Fills what can be filled of `registered`; pixels farther from any measurement than the
    /// reach, or beyond the rim of all measurements, stay NaN.
    pub fn close(&mut self, registered: &mut RegisteredDepth, focal_pixels: f32, guide: &Guide) {
        let (width, height) = registered.metres.size();
        self.metres.clear();
        self.metres.extend_from_slice(registered.metres.samples());
        self.sigma.clear();
        self.sigma
            .extend_from_slice(registered.sigma_metres.samples());
        self.columns.sweep(&self.metres, guide, width, height);
        let judge = Judge::new(width.max(height), focal_pixels, !guide.is_empty());
        let (from, from_sigma) = (&self.metres, &self.sigma);
        let columns = &self.columns;
        registered
            .metres
            .samples_mut()
            .par_chunks_mut(width)
            .zip(registered.sigma_metres.samples_mut().par_chunks_mut(width))
            .enumerate()
            .with_min_len(8)
            .for_each_init(Vec::new, |right: &mut Vec<Look>, (y, (metres, sigma))| {
                let row = &from[y * width..(y + 1) * width];
                if row.iter().all(|z| !z.is_nan()) {
                    return;
                }
                right.resize(width, FAR);
                let mut look = FAR;
                for x in (0..width).rev() {
                    look = look.step(
                        !row[x].is_nan(),
                        if x + 1 < width {
                            guide.across(x + 1, y)
                        } else {
                            0
                        },
                    );
                    right[x] = look;
                }
                let mut left = FAR;
                for (x, z) in row.iter().enumerate() {
                    left = left.step(!z.is_nan(), if x > 0 { guide.across(x, y) } else { 0 });
                    if !z.is_nan() {
                        continue;
                    }
                    let [up, down] = columns.looks(x, y);
                    let looks = [left, right[x], up, down];
                    if !judge.may_answer(looks) {
                        continue;
                    }
                    let here = y * width + x;
                    let source = |n: usize| {
                        let distance = usize::from(looks[n].distance());
                        match n {
                            0 => here - distance,
                            1 => here + distance,
                            2 => here - distance * width,
                            _ => here + distance * width,
                        }
                    };
                    if let Some([filled, s]) =
                        judge.answer(looks, |n| [from[source(n)], from_sigma[source(n)]])
                    {
                        (metres[x], sigma[x]) = (filled, s);
                    }
                }
            });
    }
}
