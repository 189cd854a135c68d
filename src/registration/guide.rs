//! Color edges between neighbouring pixels.

use crate::radiometry::LinearImage;
use drivers::Plane;
use fearless_simd::{Level, Simd, dispatch, f32x8, prelude::*};
use rayon::prelude::*;
use std::ops::Range;

/// Steps of color this small are noise and texture, in 255ths of the square root of light.
const NOISE: u32 = 4;

/// Pixels encoded together.
const BLOCK: usize = 32;

/// Rows that are worth a task.
const ROWS_PER_TASK: usize = 16;

/// Colors of one material scatter by about this much, in 255ths of the square root of light.
const ALIKE: f32 = 8.0;

/// The guide in steps the eye would call even (square root of light, 8 bits); empty = no guide.
#[derive(Debug, Clone, Default)]
pub(in crate::registration) struct Guide {
    width: usize,
    /// Red in the lowest byte, green and blue above.
    colors: Vec<u32>,
}

impl Guide {
    /// Unknown light (saturated) counts as white; white is what one pixel in fifty exceeds, for
    /// light at unit exposure has no level of its own.
    pub fn take(&mut self, guide: Option<&LinearImage>, width: usize, height: usize) {
        self.width = width;
        let Some(LinearImage(guide)) = guide else {
            self.colors.clear();
            return;
        };
        self.colors.resize(width * height, 0);
        let per_white = 1.0 / white(guide);
        self.colors
            .par_chunks_mut(width)
            .zip(guide.samples().par_chunks(width))
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(to, from)| dispatch!(Level::new(), _simd => encode(from, per_white, to)));
    }

    /// True without a picture.
    pub fn is_empty(&self) -> bool {
        self.colors.is_empty()
    }

    /// Colors of pixels by index, a plane per channel, in steps 0 ..= 255.
    #[inline(always)]
    pub fn channels(&self, pixels: Range<usize>, [red, green, blue]: [&mut [f32]; 3]) {
        let channels = red.iter_mut().zip(green).zip(blue);
        for (&color, ((red, green), blue)) in self.colors[pixels].iter().zip(channels) {
            *red = (color & 255) as f32;
            *green = (color >> 8 & 255) as f32;
            *blue = (color >> 16) as f32;
        }
    }

    /// Edges between (x − 1, y) and (x, y) for each x from `first` ≥ 1 on; 0 without a picture.
    #[inline(always)]
    pub fn across(&self, first: usize, y: usize, edges: &mut [u32]) {
        self.edges(y * self.width + first, 1, edges);
    }

    /// Edges between (x, y − 1) and (x, y) for each x from `first` on, y ≥ 1; 0 without a picture.
    #[inline(always)]
    pub fn down(&self, first: usize, y: usize, edges: &mut [u32]) {
        self.edges(y * self.width + first, self.width, edges);
    }

    #[inline(always)]
    fn edges(&self, from: usize, back: usize, edges: &mut [u32]) {
        if self.is_empty() {
            edges.fill(0);
            return;
        }
        let [a, b] = [from - back, from].map(|from| &self.colors[from..][..edges.len()]);
        for ((edge, a), b) in edges.iter_mut().zip(a).zip(b) {
            let step = |c: u32| (a >> c & 255).abs_diff(b >> c & 255);
            *edge = step(0).max(step(8)).max(step(16)).max(NOISE) - NOISE;
        }
    }
}

/// Likeness of colors in steps 0 ..= 255, in (0, 1]: 1 for equal ones.
#[inline(always)]
pub(in crate::registration) fn likeness<S: Simd>(
    simd: S,
    a: [f32x8<S>; 3],
    b: [f32x8<S>; 3],
) -> f32x8<S> {
    let one = f32x8::splat(simd, 1.0);
    let apart = |c: usize| {
        let apart = (a[c] - b[c]) * f32x8::splat(simd, 1.0 / ALIKE);
        apart * apart
    };
    // A Cauchy kernel: unlike colors stay comparable with each other.
    one / (one + apart(0) + apart(1) + apart(2))
}

/// One row of colors. Without a branch, so that the compiler takes many channels at a time.
#[inline(always)]
fn encode(from: &[[f32; 3]], per_white: f32, to: &mut [u32]) {
    let (blocks, rest) = from.as_chunks();
    let (to_blocks, to_rest) = to.as_chunks_mut();
    for (to, from) in to_blocks.iter_mut().zip(blocks) {
        *to = encode_block(from, per_white);
    }
    let mut last = [[0.0; 3]; BLOCK];
    last[..rest.len()].copy_from_slice(rest);
    to_rest.copy_from_slice(&encode_block(&last, per_white)[..rest.len()]);
}

#[inline(always)]
fn encode_block(from: &[[f32; 3]; BLOCK], per_white: f32) -> [u32; BLOCK] {
    const WHOLE: f32 = 8_388_608.0;
    let mut steps = [[0; 3]; BLOCK];
    for (step, light) in steps.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        let root = 255.0 * (light * per_white).sqrt();
        let root = if light.is_nan() { 255.0 } else { root };
        // Less than no light has no root and becomes 0. From `WHOLE` on the low bits of a float
        // are its whole number; a cast would be taken one by one.
        let root = if root > 0.0 { root.min(255.0) } else { 0.0 };
        *step = (root.trunc() + WHOLE).to_bits() & 255;
    }
    steps.map(|[r, g, b]| r | g << 8 | b << 16)
}

/// Light that two percent of the brightest channel values exceed; 1 for a black picture.
fn white(guide: &Plane<[f32; 3]>) -> f32 {
    let mut levels: Vec<f32> = guide
        .samples()
        .iter()
        .step_by((guide.len() / 20_000).max(1))
        .map(|pixel| pixel.iter().copied().fold(0.0, f32::max))
        .collect();
    if levels.is_empty() {
        return 1.0;
    }
    let rank = levels.len() * 98 / 100;
    let white = *levels.select_nth_unstable_by(rank, f32::total_cmp).1;
    if white > 0.0 { white } else { 1.0 }
}
