//! Color edges between neighbouring pixels.

use crate::radiometry::LinearImage;
use rayon::prelude::*;

/// Steps of color this small are noise and texture, in 255ths of the square root of light.
const NOISE: u16 = 4;

/// The guide in steps the eye would call even (square root of light, 8 bits); empty = no guide.
#[derive(Debug, Clone, Default)]
pub(super) struct Guide {
    width: usize,
    colors: Vec<[u8; 4]>,
}

impl Guide {
    /// Unknown light (saturated) counts as white.
    pub fn take(&mut self, guide: Option<&LinearImage>, width: usize, height: usize) {
        self.width = width;
        self.colors.clear();
        let Some(LinearImage(guide)) = guide else {
            return;
        };
        self.colors.resize(width * height, [0; 4]);
        let encode = |light: f32| {
            if light.is_nan() {
                255
            } else {
                (255.0 * light.sqrt()) as u8
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
