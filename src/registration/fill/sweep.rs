//! The nearest measured pixel in a direction, and the color edges on the way to it.

use crate::registration::guide::Guide;
use rayon::prelude::*;

/// Columns that one task owns.
const STRIP: usize = 64;

/// What a pixel sees in one direction: distance in pixels (high half) and edges crossed (low half).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look(u32);

/// Nothing measured in this direction.
pub(super) const FAR: Look = Look(u32::MAX);

impl Look {
    /// The look of the next pixel away from the measurement, across `edge`.
    #[inline(always)]
    pub fn step(self, measured: bool, edge: u16) -> Self {
        let distance = self.distance().saturating_add(1);
        let edges = self.edges().saturating_add(edge);
        if measured {
            Self(0)
        } else {
            Self(u32::from(distance) << 16 | u32::from(edges))
        }
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

/// Looks up and down of every pixel, stored strip by strip so that tasks own what they write.
#[derive(Debug, Clone, Default)]
pub(super) struct Columns {
    height: usize,
    looks: Vec<[Look; 2]>,
}

impl Columns {
    pub fn sweep(&mut self, metres: &[f32], guide: &Guide, width: usize, height: usize) {
        self.height = height;
        self.looks
            .resize(width.div_ceil(STRIP) * STRIP * height, [FAR; 2]);
        self.looks
            .par_chunks_mut(STRIP * height)
            .enumerate()
            .for_each(|(strip, looks)| {
                let first = strip * STRIP;
                let count = STRIP.min(width - first);
                let mut state = [FAR; STRIP];
                for y in 0..height {
                    let row = &metres[y * width + first..][..count];
                    let to = &mut looks[y * STRIP..][..count];
                    for (x, (state, to)) in state.iter_mut().zip(to).enumerate() {
                        let edge = if y > 0 { guide.down(first + x, y) } else { 0 };
                        *state = state.step(!row[x].is_nan(), edge);
                        to[0] = *state;
                    }
                }
                let mut state = [FAR; STRIP];
                for y in (0..height).rev() {
                    let row = &metres[y * width + first..][..count];
                    let to = &mut looks[y * STRIP..][..count];
                    for (x, (state, to)) in state.iter_mut().zip(to).enumerate() {
                        let edge = if y + 1 < height {
                            guide.down(first + x, y + 1)
                        } else {
                            0
                        };
                        *state = state.step(!row[x].is_nan(), edge);
                        to[1] = *state;
                    }
                }
            });
    }

    /// `[up, down]`.
    #[inline(always)]
    pub fn looks(&self, x: usize, y: usize) -> [Look; 2] {
        self.looks[((x / STRIP) * self.height + y) * STRIP + x % STRIP]
    }
}
