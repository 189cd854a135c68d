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
use fearless_simd::{Level, dispatch};
use gap::Judge;
use rayon::prelude::*;
use sweep::{Columns, FAR, HERE, Look, STRIP};

/// Rows that are worth a task.
const ROWS_PER_TASK: usize = 8;

/// What closing gaps keeps between frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Gaps {
    columns: Columns,
    /// Per row, kept apart until every row has looked at the measurements.
    answers: Vec<Vec<Filled>>,
}

#[derive(Debug, Clone, Copy)]
struct Filled {
    x: usize,
    metres: f32,
    sigma: f32,
}

impl Gaps {
    /// Fills what can be filled of `registered`; pixels farther from any measurement than the
    /// reach, or beyond the rim of all measurements, stay NaN.
    pub fn close(&mut self, registered: &mut RegisteredDepth, focal_pixels: f32, guide: &Guide) {
        let (width, height) = registered.metres.size();
        let metres = registered.metres.samples();
        self.columns.sweep(metres, guide, width, height);
        let rows = Rows {
            metres,
            sigma: registered.sigma_metres.samples(),
            columns: &self.columns,
            guide,
            judge: Judge::new(width.max(height), focal_pixels, !guide.is_empty()),
            width,
        };
        self.answers.resize_with(height, Vec::new);
        self.answers
            .par_iter_mut()
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each_init(Sight::default, |sight, (y, answers)| {
                answers.clear();
                rows.look(y, sight);
                rows.answer(y, sight, answers);
            });
        registered
            .metres
            .samples_mut()
            .par_chunks_mut(width)
            .zip(registered.sigma_metres.samples_mut().par_chunks_mut(width))
            .zip(&self.answers)
            .with_min_len(ROWS_PER_TASK)
            .for_each(|((metres, sigma), answers)| {
                for filled in answers {
                    (metres[filled.x], sigma[filled.x]) = (filled.metres, filled.sigma);
                }
            });
    }
}

/// What the unknown pixels of one row see to their left and right.
#[derive(Default)]
struct Sight {
    /// Columns of the unknown pixels.
    unknown: Vec<usize>,
    /// Per unknown pixel.
    left: Vec<Look>,
    right: Vec<Look>,
    /// Edge left of each pixel of the row, and 0 past its end; kept up around unknown pixels.
    edges: Vec<u32>,
}

struct Rows<'a> {
    metres: &'a [f32],
    sigma: &'a [f32],
    columns: &'a Columns,
    guide: &'a Guide,
    judge: Judge,
    width: usize,
}

impl Rows<'_> {
    fn look(&self, y: usize, sight: &mut Sight) {
        let width = self.width;
        sight.unknown.clear();
        sight.edges.resize(width + 1, 0);
        for strip in 0..width.div_ceil(STRIP) {
            let mut bits = self.columns.unknown(strip, y);
            if bits == 0 {
                continue;
            }
            let start = strip * STRIP;
            let edges = start.max(1)..(start + STRIP + 1).min(width);
            dispatch!(Level::new(), _simd => {
                self.guide.across(edges.start, y, &mut sight.edges[edges.clone()]);
            });
            while bits != 0 {
                sight.unknown.push(start + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
        }
        let (mut look, mut next) = (FAR, 0);
        sight.left.clear();
        for &x in &sight.unknown {
            // What lies between two unknown pixels is measured.
            look = if x > next { HERE } else { look };
            next = x + 1;
            look = look.step(false, sight.edges[x]);
            sight.left.push(look);
        }
        let (mut look, mut next) = (FAR, width);
        sight.right.resize(sight.unknown.len(), FAR);
        for (&x, right) in sight.unknown.iter().zip(&mut sight.right).rev() {
            look = if x + 1 < next { HERE } else { look };
            next = x;
            look = look.step(false, sight.edges[x + 1]);
            *right = look;
        }
    }

    fn answer(&self, y: usize, sight: &Sight, answers: &mut Vec<Filled>) {
        let width = self.width;
        let sides = sight.left.iter().zip(&sight.right);
        for (&x, (&left, &right)) in sight.unknown.iter().zip(sides) {
            let [up, down] = self.columns.looks(x, y);
            let looks = [left, right, up, down];
            if !self.judge.may_answer(looks) {
                continue;
            }
            let here = y * width + x;
            let source = |n: usize| {
                let distance = usize::from(looks[n].distance());
                let at = match n {
                    0 => here - distance,
                    1 => here + distance,
                    2 => here - distance * width,
                    _ => here + distance * width,
                };
                [self.metres[at], self.sigma[at]]
            };
            if let Some([metres, sigma]) = self.judge.answer(looks, source) {
                answers.push(Filled { x, metres, sigma });
            }
        }
    }
}
