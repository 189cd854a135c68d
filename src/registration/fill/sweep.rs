//! The nearest measured pixel in a direction, and the color edges on the way to it.

use crate::registration::guide::Guide;
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

/// Columns that one task owns, a bit each.
pub(super) const STRIP: usize = 64;

/// What a pixel sees in one direction: distance in pixels (high half) and edges crossed (low half).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look(u32);

/// Nothing measured in this direction.
pub(super) const FAR: Look = Look(u32::MAX);

/// At a measured pixel.
pub(super) const HERE: Look = Look(0);

impl Look {
    /// The look of the next pixel away from the measurement, across `edge`.
    #[inline(always)]
    pub fn step(self, measured: bool, edge: u32) -> Self {
        const MOST: u32 = u16::MAX as u32;
        let distance = ((self.0 >> 16) + 1).min(MOST);
        let edges = ((self.0 & MOST) + edge).min(MOST);
        Self(if measured { 0 } else { distance << 16 | edges })
    }

    /// Pixels to the measurement; `u16::MAX` = none.
    #[inline(always)]
    pub fn distance(self) -> u16 {
        (self.0 >> 16) as u16
    }

    /// Sum of the color edges on the way.
    #[inline(always)]
    pub fn edges(self) -> u16 {
        self.0 as u16
    }
}

/// Looks up and down, stored strip by strip so that tasks own what they write.
#[derive(Debug, Clone, Default)]
pub(super) struct Columns {
    height: usize,
    /// Per strip and row, a bit per unknown pixel. Looks are kept up only where there are any.
    unknown: Vec<u64>,
    up: Vec<Look>,
    down: Vec<Look>,
}

impl Columns {
    pub fn sweep(&mut self, metres: &[f32], guide: &Guide, width: usize, height: usize) {
        self.height = height;
        let strips = width.div_ceil(STRIP);
        self.unknown.resize(strips * height, 0);
        self.up.resize(strips * STRIP * height, FAR);
        self.down.resize(strips * STRIP * height, FAR);
        (
            self.unknown.par_chunks_mut(height),
            self.up.par_chunks_mut(STRIP * height),
            self.down.par_chunks_mut(STRIP * height),
        )
            .into_par_iter()
            .enumerate()
            .for_each(|(n, (unknown, up, down))| {
                let first = n * STRIP;
                let strip = Strip {
                    metres,
                    guide,
                    first,
                    count: STRIP.min(width - first),
                    width,
                };
                dispatch!(Level::new(), _simd => strip.sweep(unknown, up, down));
            });
    }

    /// Unknown pixels of a strip's row, the first in the lowest bit.
    pub fn unknown(&self, strip: usize, y: usize) -> u64 {
        self.unknown[strip * self.height + y]
    }

    /// `[up, down]` of an unknown pixel.
    #[inline(always)]
    pub fn looks(&self, x: usize, y: usize) -> [Look; 2] {
        let at = ((x / STRIP) * self.height + y) * STRIP + x % STRIP;
        [self.up[at], self.down[at]]
    }
}

struct Strip<'a> {
    metres: &'a [f32],
    guide: &'a Guide,
    first: usize,
    count: usize,
    width: usize,
}

impl Strip<'_> {
    #[inline(always)]
    fn sweep(&self, unknown: &mut [u64], up: &mut [Look], down: &mut [Look]) {
        let height = unknown.len();
        let mut state = [FAR; STRIP];
        let rows = unknown.iter_mut().zip(up.chunks_exact_mut(STRIP));
        for (y, (unknown, up)) in rows.enumerate() {
            let row = self.row(y);
            if row.iter().fold(false, |any, z| any | z.is_nan()) {
                let bits = row.iter().zip(0..).map(|(z, n)| u64::from(z.is_nan()) << n);
                *unknown = bits.fold(0, |all, bit| all | bit);
                self.step(y, (y > 0).then_some(y), &mut state);
                up.copy_from_slice(&state);
            } else {
                *unknown = 0;
                state = [HERE; STRIP];
            }
        }
        state = [FAR; STRIP];
        let rows = unknown.iter().zip(down.chunks_exact_mut(STRIP)).enumerate();
        for (y, (&unknown, down)) in rows.rev() {
            if unknown != 0 {
                self.step(y, (y + 1 < height).then_some(y + 1), &mut state);
                down.copy_from_slice(&state);
            } else {
                state = [HERE; STRIP];
            }
        }
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &[f32] {
        &self.metres[y * self.width + self.first..][..self.count]
    }

    /// Onto row `y` across the edges above row `below`. Without a branch, so that the compiler
    /// takes many columns at a time.
    #[inline(always)]
    fn step(&self, y: usize, below: Option<usize>, state: &mut [Look; STRIP]) {
        let mut edges = [0; STRIP];
        if let Some(below) = below {
            self.guide.down(self.first, below, &mut edges[..self.count]);
        }
        for ((look, z), edge) in state.iter_mut().zip(self.row(y)).zip(edges) {
            *look = look.step(!z.is_nan(), edge);
        }
    }
}
