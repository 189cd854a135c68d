//! Color edges between neighbouring pixels.

use crate::radiometry::LinearImage;
use drivers::Plane;
use rayon::prelude::*;

/// Steps of color this small are noise and texture, in 255ths of the square root of light.
const NOISE: u16 = 4;

/// Colors of one material scatter by about this much, in 255ths of the square root of light.
const ALIKE: f32 = 12.0;

/// The guide in steps the eye would call even (square root of light, 8 bits); empty = no guide.
#[derive(Debug, Clone, Default)]
pub(in crate::registration) struct Guide {
    width: usize,
    colors: Vec<[u8; 4]>,
}

impl Guide {
    /// Unknown light (saturated) counts as white; white is what one pixel in fifty exceeds, for
    /// light at unit exposure has no level of its own.
    pub fn take(&mut self, guide: Option<&LinearImage>, width: usize, height: usize) {
        self.width = width;
        self.colors.clear();
        let Some(LinearImage(guide)) = guide else {
            return;
        };
        self.colors.resize(width * height, [0; 4]);
        let per_white = 1.0 / white(guide);
        let encode = |light: f32| {
            if light.is_nan() {
                255
            } else {
                (255.0 * (light * per_white).sqrt()) as u8
            }
        };
        self.colors
            .par_chunks_mut(width)
            .zip(guide.samples().par_chunks(width))
            .for_each(|(to, from)| {
                for (to, &[r, g, b]) in to.iter_mut().zip(from) {
                    *to = [encode(r), encode(g), encode(b), 0];
                }
            });
    }

    /// True without a picture.
    pub fn is_empty(&self) -> bool {
        self.colors.is_empty()
    }

    /// Likeness of two pixels by index, in (0, 1]: 1 for equal colors.
    #[inline(always)]
    pub fn likeness(&self, a: usize, b: usize) -> f32 {
        let (a, b) = (self.colors[a], self.colors[b]);
        let apart = |c: usize| {
            let apart = f32::from(a[c].abs_diff(b[c])) * (1.0 / ALIKE);
            apart * apart
        };
        // A Cauchy kernel: unlike colors stay comparable with each other.
        1.0 / (1.0 + apart(0) + apart(1) + apart(2))
    }

    /// Edge between (x − 1, y) and (x, y); x ≥ 1.
    #[inline(always)]
    pub fn across(&self, x: usize, y: usize) -> u16 {
        self.edge(y * self.width + x, 1)
    }

    /// Edge between (x, y − 1) and (x, y); y ≥ 1.
    #[inline(always)]
    pub fn down(&self, x: usize, y: usize) -> u16 {
        self.edge(y * self.width + x, self.width)
    }

    #[inline(always)]
    fn edge(&self, i: usize, back: usize) -> u16 {
        if self.colors.is_empty() {
            return 0;
        }
        let (a, b) = (self.colors[i - back], self.colors[i]);
        let steps = [0, 1, 2].map(|c| a[c].abs_diff(b[c]));
        u16::from(steps[0].max(steps[1]).max(steps[2])).saturating_sub(NOISE)
    }
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
