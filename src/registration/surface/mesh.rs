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
    /// Largest relative step of depth within a quad on one surface…
    pub steep: f32,
    /// …and within one whose surface goes on as steeply beside it.
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
        low > 0.0 && high - low <= low * self.allowed(self.steep, sigma, high)
    }

    /// A quad steeper than surfaces usually are goes on beside itself, on one side or the other:
    /// a floor seen from just above, not the edge of something before a wall.
    fn goes_on(&self, x: usize, y: usize) -> bool {
        let corners = self.corners(x, y);
        let q = corners.map(|i| self.vertices[2][i]);
        let low = q.into_iter().fold(f32::INFINITY, f32::min);
        let high = q.into_iter().fold(0.0, f32::max);
        let sigma = corners.map(|i| self.vertices[3][i].abs());
        let sigma = sigma.into_iter().fold(0.0, f32::max);
        if !(low > 0.0 && high - low <= low * self.allowed(self.steepest, sigma, high)) {
            return false;
        }
        let across = (q[1] + q[3]) - (q[0] + q[2]);
        let down = (q[2] + q[3]) - (q[0] + q[1]);
        let ([x_step, y_step], step) = if across.abs() > down.abs() {
            ([1, 0], across)
        } else {
            ([0, 1], down)
        };
        [-1isize, 1].into_iter().any(|side| {
            let x = x.checked_add_signed(side * x_step);
            let y = y.checked_add_signed(side * y_step);
            let (Some(x), Some(y)) = (x, y) else {
                return false;
            };
            if x + 1 >= self.width || y + 1 >= self.height {
                return false;
            }
            let [a, b, c, d] = self.corners(x, y).map(|i| self.vertices[2][i]);
            let beside = if x_step == 1 {
                (b + d) - (a + c)
            } else {
                (c + d) - (a + b)
            };
            // False for NaN.
            (beside - step).abs() < 0.5 * step.abs()
        })
    }

    /// Index of [`TRIANGLES`] for a quad that is too steep or does not lie on one surface.
    fn kind(&self, x: usize, y: usize) -> u8 {
        let v = self.corners(x, y).map(|i| self.vertex(i));
        if self.goes_on(x, y) {
            return diagonal(v[0][2], v[1][2], v[2][2], v[3][2]);
        }
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
                        *kind = self.kind(x, y);
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
            let whole = (low > 0.0) & (high - low <= low * self.allowed(self.steep, sigma, high));
            row[x] = diagonal(q0[x], q1[x], q2[x], q3[x]) * u8::from(whole);
        }
    }

    /// Largest relative step of depth within one surface.
    #[inline(always)]
    fn allowed(&self, step: f32, sigma: f32, inverse: f32) -> f32 {
        step + (4.0 * sigma * inverse).min(0.02)
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

/// Index of [`TRIANGLES`] for a whole quad of these inverse depths: cut where it bends least.
#[inline(always)]
fn diagonal(q0: f32, q1: f32, q2: f32, q3: f32) -> u8 {
    2 - u8::from((q1 - q2).abs() <= (q0 - q3).abs())
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
