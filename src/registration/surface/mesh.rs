//! Which samples are connected, and by which triangles.

use super::{ROWS_PER_TASK, Vertex};
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

/// The samples and what decides which of them are connected.
pub(super) struct Mesh<'a> {
    pub vertices: [&'a [f32]; 4],
    pub bounds: &'a [[f32; 2]],
    pub width: usize,
    pub height: usize,
    pub amplitude: Option<&'a [f32]>,
    /// Largest relative step of depth within a quad on one surface.
    pub steepest: f32,
    /// Longest side of a triangle's box, pixels.
    pub largest: f32,
    /// Half the distance of two samples, color pixels.
    pub half_sample: f32,
}

/// What can be drawn of a quad with corners 0 1 above and 2 3 below: nothing, all of it along one
/// diagonal or the other, or one corner cut off. All triangles turn the way a front face does.
pub(super) const TRIANGLES: [&[[usize; 3]]; 7] = [
    &[],
    &[[0, 1, 2], [1, 3, 2]],
    &[[0, 1, 3], [0, 3, 2]],
    &[[0, 1, 2]],
    &[[1, 3, 2]],
    &[[0, 1, 3]],
    &[[0, 3, 2]],
];

impl Mesh<'_> {
    pub fn corners(&self, x: usize, y: usize) -> [usize; 4] {
        let i = y * self.width + x;
        [i, i + 1, i + self.width, i + self.width + 1]
    }

    /// All these samples exist and lie on one surface.
    #[inline(always)]
    fn is_surface<const N: usize>(&self, vertices: [Vertex; N]) -> bool {
        let (mut low, mut high, mut sigma) = (f32::INFINITY, 0.0f32, 0.0f32);
        for vertex in vertices {
            low = low.min(vertex[2]);
            high = high.max(vertex[2]);
            sigma = sigma.max(vertex[3].abs());
        }
        low > 0.0 && high - low <= low * self.allowed(sigma, high)
    }

    /// Index of [`TRIANGLES`] for a quad that does not lie on one surface.
    fn kind(&self, v: [Vertex; 4]) -> u8 {
        (3..7)
            .find(|&kind| self.is_surface(TRIANGLES[kind][0].map(|corner| v[corner])))
            .unwrap_or(0) as u8
    }

    /// Decides once what is drawn of each quad.
    pub fn sort(&self, kinds: &mut Vec<u8>) {
        let width = self.width;
        kinds.resize(width * self.height, 0);
        kinds
            .par_chunks_mut(width)
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, row)| {
                if y + 1 == self.height {
                    row.fill(0);
                    return;
                }
                dispatch!(Level::new(), _simd => self.sort_whole(y, row));
                row[width - 1] = 0;
                for (x, kind) in row[..width - 1].iter_mut().enumerate() {
                    if *kind == 0 {
                        *kind = self.kind(self.corners(x, y).map(|i| self.vertex(i)));
                    }
                }
            });
    }

    /// Kinds of the quads that lie on one surface; 0 for the others. Without a branch, so that
    /// the compiler takes many quads at a time.
    #[inline(always)]
    fn sort_whole(&self, y: usize, row: &mut [u8]) {
        let count = row.len() - 1;
        let row = &mut row[..count];
        let [above, below] = [y * self.width, (y + 1) * self.width];
        let [q0, q1, q2, q3] = [above, above + 1, below, below + 1]
            .map(|first| &self.vertices[2][first..first + count]);
        let [s0, s1, s2, s3] = [above, above + 1, below, below + 1]
            .map(|first| &self.vertices[3][first..first + count]);
        for x in 0..count {
            let low = q0[x].min(q1[x]).min(q2[x].min(q3[x]));
            let high = q0[x].max(q1[x]).max(q2[x].max(q3[x]));
            let sigma = (s0[x].abs().max(s1[x].abs())).max(s2[x].abs().max(s3[x].abs()));
            let whole = (low > 0.0) & (high - low <= low * self.allowed(sigma, high));
            let kind = 2 - u8::from((q1[x] - q2[x]).abs() <= (q0[x] - q3[x]).abs());
            row[x] = kind * u8::from(whole);
        }
    }

    /// Largest relative step of depth within one surface.
    #[inline(always)]
    fn allowed(&self, sigma: f32, inverse: f32) -> f32 {
        self.steepest + (4.0 * sigma * inverse).min(0.02)
    }

    #[inline(always)]
    pub fn vertex(&self, i: usize) -> Vertex {
        let [x, y, inverse, sigma] = self.vertices;
        [x[i], y[i], inverse[i], sigma[i]]
    }

    pub fn mark_lonely(&self, kinds: &[u8], lonely: &mut Vec<bool>) {
        let width = self.width;
        lonely.resize(width * self.height, false);
        lonely
            .par_chunks_mut(width)
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, row)| {
                dispatch!(Level::new(), _simd => self.mark_unusual(kinds, y, row));
                for (x, lonely) in row.iter_mut().enumerate() {
                    *lonely = *lonely && !spans(kinds, width, x, y);
                }
            });
    }

    /// Samples of a row without a whole quad below right, which settles the usual case. Without a
    /// branch, so that the compiler takes many samples at a time.
    #[inline(always)]
    fn mark_unusual(&self, kinds: &[u8], y: usize, row: &mut [bool]) {
        let (first, count) = (y * self.width, row.len());
        let [_, _, inverse, sigma] = self.vertices.map(|plane| &plane[first..][..count]);
        let kinds = &kinds[first..][..count];
        for (x, unusual) in row.iter_mut().enumerate() {
            let whole = (kinds[x] == 1) | (kinds[x] == 2);
            *unusual = !whole & (inverse[x] > 0.0) & (sigma[x] > 0.0);
        }
    }
}

/// A triangle is drawn at this sample.
fn spans(kinds: &[u8], width: usize, x: usize, y: usize) -> bool {
    // The quads around the sample, and its position among the corners of each.
    [(0, 0, 0), (1, 0, 1), (0, 1, 2), (1, 1, 3)]
        .into_iter()
        .any(|(left, up, corner)| {
            x >= left && y >= up && {
                let kind = kinds[(y - up) * width + x - left];
                TRIANGLES[usize::from(kind)]
                    .iter()
                    .any(|triangle| triangle.contains(&corner))
            }
        })
}
