//! The pixels near a depth edge, one bit each.

use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

/// Pixels per word.
const WORD: usize = u64::BITS as usize;
/// Rows that are worth a task.
const ROWS_PER_TASK: usize = 16;

#[derive(Debug, Clone, Default)]
pub(super) struct Band {
    words_per_row: usize,
    /// Where a pixel and its left or upper neighbour lie on two surfaces.
    jumps: Vec<u64>,
    /// The same, widened along rows.
    wide: Vec<u64>,
    /// Widened along columns too.
    bits: Vec<u64>,
}

impl Band {
    /// Marks what lies within `reach` < 64 pixels of a jump: neighbours of inverse depth `near`
    /// that differ by more than the share `jump` of the nearer.
    pub fn mark(&mut self, near: &[f32], width: usize, reach: usize, jump: f32) {
        let height = near.len() / width;
        let words = width.div_ceil(WORD);
        self.words_per_row = words;
        for plane in [&mut self.jumps, &mut self.wide, &mut self.bits] {
            plane.resize(words * height, 0);
        }
        (
            self.jumps.par_chunks_mut(words),
            self.wide.par_chunks_mut(words),
        )
            .into_par_iter()
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, (jumps, wide))| {
                let row = &near[y * width..][..width];
                let above = (y > 0).then(|| &near[(y - 1) * width..][..width]);
                dispatch!(Level::new(), _simd => find(row, above, jump, jumps));
                widen(jumps, reach, wide);
                // No bit beyond the picture.
                wide[words - 1] &= u64::MAX >> (words * WORD - width);
            });
        let wide = &self.wide;
        self.bits
            .par_chunks_mut(words)
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, bits)| {
                bits.fill(0);
                for from in y.saturating_sub(reach - 1)..(y + reach + 1).min(height) {
                    for (bits, wide) in bits.iter_mut().zip(&wide[from * words..]) {
                        *bits |= wide;
                    }
                }
            });
    }

    /// Pixels `start..start + 64` of row `y`, the first in the lowest bit; none outside the picture.
    #[inline(always)]
    pub fn pixels(&self, start: isize, y: usize) -> u64 {
        let row = &self.bits[y * self.words_per_row..][..self.words_per_row];
        let word = |n: isize| {
            let word = usize::try_from(n).ok().and_then(|n| row.get(n));
            word.copied().unwrap_or(0)
        };
        let (n, shift) = (
            start.div_euclid(WORD as isize),
            start.rem_euclid(WORD as isize) as u32,
        );
        // In two steps: a shift by all 64 bits is none.
        word(n) >> shift | word(n + 1) << 1 << (WORD as u32 - 1 - shift)
    }

    /// First marked pixel of row `y` from `x` on.
    pub fn next(&self, x: usize, y: usize) -> Option<usize> {
        let row = &self.bits[y * self.words_per_row..][..self.words_per_row];
        let first = row.get(x / WORD)? & u64::MAX << (x % WORD);
        let rest = row[x / WORD + 1..].iter().copied();
        std::iter::once(first)
            .chain(rest)
            .zip(x / WORD..)
            .find(|(bits, _)| *bits != 0)
            .map(|(bits, n)| n * WORD + bits.trailing_zeros() as usize)
    }
}

/// Jumps of one row, a word of neighbours at a time.
#[inline(always)]
fn find(row: &[f32], above: Option<&[f32]>, jump: f32, jumps: &mut [u64]) {
    // False for NaN.
    let apart = |a: f32, b: f32| (a - b).abs() > jump * if a > b { a } else { b };
    for (n, jumps) in jumps.iter_mut().enumerate() {
        let first = n * WORD;
        let end = (first + WORD).min(row.len());
        let mut found = [false; WORD];
        // The first pixel of a row has no left neighbour.
        let start = first.max(1);
        let pairs = row[start..end].iter().zip(&row[start - 1..]);
        for (found, (&a, &b)) in found[start - first..].iter_mut().zip(pairs) {
            *found = apart(a, b);
        }
        if let Some(above) = above {
            let pairs = row[first..end].iter().zip(&above[first..end]);
            for (found, (&a, &b)) in found.iter_mut().zip(pairs) {
                *found |= apart(a, b);
            }
        }
        *jumps = 0;
        // Most words hold no edge, which is asked of all their pixels together.
        if found.iter().fold(false, |any, found| any | found) {
            for (bit, found) in found.into_iter().enumerate() {
                *jumps |= u64::from(found) << bit;
            }
        }
    }
}

/// From `reach` pixels before each jump to `reach − 1` after it, as the jump lies before its pixel.
fn widen(jumps: &[u64], reach: usize, wide: &mut [u64]) {
    wide.fill(0);
    if jumps.iter().all(|word| *word == 0) {
        return;
    }
    for n in 0..jumps.len() {
        let before = n.checked_sub(1).map_or(0, |n| jumps[n]);
        let after = jumps.get(n + 1).copied().unwrap_or(0);
        for shift in 0..reach {
            wide[n] |= jumps[n] << shift | before >> 1 >> (WORD - 1 - shift);
        }
        for shift in 1..=reach {
            wide[n] |= jumps[n] >> shift | after << (WORD - shift);
        }
    }
}
