//! Draws depth samples as a connected surface on the distorted color grid.
//!
//! Neighbouring samples on one surface span triangles, so an upsampled surface has no pinholes
//! and hides what lies behind it; triangles over a depth edge are not drawn, so no surface
//! bleeds over its rim. The nearest surface wins (z-buffer on inverse depth, which is linear in
//! the picture for a plane). Samples that span no triangle, on thin things, paint a square of
//! their own size.

mod band;

use super::{
    RegisteredDepth,
    cleaning::{Cleaned, STEEPEST},
    maps::{ColorGrid, DepthGrid, Rays},
};
use band::Band;
use drivers::DepthFrame;
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

/// Rows of the color grid that one task owns.
const BAND_ROWS: usize = 24;
/// Rows of samples that are worth a task.
const ROWS_PER_TASK: usize = 16;
/// Samples per row segment with one bounding interval.
const SEGMENT: usize = 32;
/// A triangle larger than this many magnified samples spans an edge, whatever its depths say.
const LARGEST_TRIANGLE_SAMPLES: f32 = 24.0;

/// A sample on the color grid: pixel x, pixel y, inverse depth (0 = none), sigma in metres
/// (negative = assumed across a hole: it hides, but does not answer).
type Vertex = [f32; 4];

/// Samples of one frame as the color camera sees them.
#[derive(Debug, Clone, Default)]
pub(super) struct Surface {
    /// The four numbers of each [`Vertex`], a plane each.
    vertices: [Vec<f32>; 4],
    /// Per row and segment: lowest and highest pixel y of its vertices, the next segment's first included.
    bounds: Vec<[f32; 2]>,
    /// Per quad, named by its upper left sample: what is drawn of it, an index of [`TRIANGLES`].
    kinds: Vec<u8>,
    /// Samples that span no triangle.
    lonely: Vec<bool>,
}

/// A frame that lies on the color grid already is only taken over; false when nothing is known.
pub(super) fn copy(
    cleaned: &Cleaned,
    frame: &DepthFrame,
    registered: &mut RegisteredDepth,
) -> bool {
    let mut landed = false;
    let metres = registered.metres.samples_mut();
    let sigma = registered.sigma_metres.samples_mut();
    let measured = registered.measured.samples_mut();
    for (i, &z) in cleaned.metres.iter().enumerate() {
        let known = !z.is_nan();
        landed |= known;
        metres[i] = z;
        measured[i] = known;
        sigma[i] = if known { cleaned.sigma[i] } else { f32::NAN };
    }
    if let (Some(to), Some(from)) = (&mut registered.amplitude, &frame.amplitude) {
        for (i, to) in to.samples_mut().iter_mut().enumerate() {
            *to = if measured[i] {
                from.samples()[i]
            } else {
                f32::NAN
            };
        }
    }
    landed
}

impl Surface {
    /// Draws a frame; false when nothing of it is in the color camera's view.
    pub fn draw(
        &mut self,
        cleaned: &Cleaned,
        frame: &DepthFrame,
        color: &ColorGrid,
        depth: &DepthGrid,
        rays: &Rays,
        registered: &mut RegisteredDepth,
    ) -> bool {
        self.place(cleaned, color, depth, rays);
        let mesh = Mesh {
            vertices: self.vertices.each_ref().map(Vec::as_slice),
            bounds: &self.bounds,
            width: depth.width,
            height: depth.height,
            amplitude: frame.amplitude.as_ref().map(|plane| plane.samples()),
            steepest: std::f32::consts::SQRT_2 * STEEPEST * depth.spacing,
            largest: LARGEST_TRIANGLE_SAMPLES * rays.magnification.max(1.0),
            half_sample: 0.5 * rays.magnification,
        };
        mesh.sort(&mut self.kinds);
        mesh.mark_lonely(&self.kinds, &mut self.lonely);
        let chunk = color.width * BAND_ROWS;
        let metres = registered.metres.samples_mut().chunks_mut(chunk);
        let sigma = registered.sigma_metres.samples_mut().chunks_mut(chunk);
        let measured = registered.measured.samples_mut().chunks_mut(chunk);
        let mut amplitude = registered
            .amplitude
            .as_mut()
            .map(|plane| plane.samples_mut().chunks_mut(chunk));
        let mut bands: Vec<Band> = metres
            .zip(sigma)
            .zip(measured)
            .enumerate()
            .map(|(n, ((inverse, sigma), measured))| Band {
                kinds: &self.kinds,
                lonely: &self.lonely,
                first_row: n * BAND_ROWS,
                rows: inverse.len() / color.width,
                width: color.width,
                inverse,
                sigma,
                measured,
                amplitude: amplitude
                    .as_mut()
                    .and_then(Iterator::next)
                    .unwrap_or_default(),
            })
            .collect();
        bands
            .par_iter_mut()
            .map(|band| dispatch!(Level::new(), simd => band.draw(simd, &mesh)))
            .reduce(|| false, |a, b| a | b)
    }

    /// Projects every sample.
    fn place(&mut self, cleaned: &Cleaned, color: &ColorGrid, depth: &DepthGrid, rays: &Rays) {
        let width = depth.width;
        let segments = width.div_ceil(SEGMENT);
        for plane in &mut self.vertices {
            plane.resize(width * depth.height, 0.0);
        }
        self.bounds.resize(segments * depth.height, [0.0; 2]);
        let [xs, ys, inverses, sigmas] = &mut self.vertices;
        (
            xs.par_chunks_mut(width),
            ys.par_chunks_mut(width),
            inverses.par_chunks_mut(width),
            sigmas.par_chunks_mut(width),
            self.bounds.par_chunks_mut(segments),
        )
            .into_par_iter()
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, (xs, ys, inverses, sigmas, bounds))| {
                let span = y * width..(y + 1) * width;
                let samples = Samples {
                    rays: [0, 1, 2].map(|axis| &rays.axes[axis][span.clone()]),
                    origin: rays.origin,
                    metres: &cleaned.metres[span.clone()],
                    sigma: &cleaned.sigma[span.clone()],
                    holes: &cleaned.holes.metres[span],
                };
                dispatch!(Level::new(), _simd => {
                    samples.project(color, [&mut *xs, &mut *ys, &mut *inverses, &mut *sigmas]);
                    bound(ys, bounds);
                });
            });
    }
}

/// One row of samples.
struct Samples<'a> {
    rays: [&'a [f32]; 3],
    origin: [f32; 3],
    metres: &'a [f32],
    sigma: &'a [f32],
    holes: &'a [f32],
}

impl Samples<'_> {
    /// Without a branch, so that the compiler takes many samples at a time.
    #[inline(always)]
    fn project(&self, color: &ColorGrid, [xs, ys, inverses, sigmas]: [&mut [f32]; 4]) {
        let width = xs.len();
        let (ys, inverses) = (&mut ys[..width], &mut inverses[..width]);
        let sigmas = &mut sigmas[..width];
        let [rx, ry, rz] = self.rays.map(|axis| &axis[..width]);
        let [ox, oy, oz] = self.origin;
        let (metres, sigma) = (&self.metres[..width], &self.sigma[..width]);
        let holes = &self.holes[..width];
        for x in 0..width {
            let answered = !metres[x].is_nan();
            let z = if answered { metres[x] } else { holes[x] };
            let [px, py, inverse] = color.project(z * rx[x] + ox, z * ry[x] + oy, z * rz[x] + oz);
            xs[x] = px;
            ys[x] = py;
            // Comparison is false for every NaN on the way here.
            inverses[x] = if inverse > 0.0 { inverse } else { 0.0 };
            sigmas[x] = if answered { sigma[x] } else { -1e-3 };
        }
    }
}

/// Lowest and highest pixel y of each segment of a row.
#[inline(always)]
fn bound(ys: &[f32], bounds: &mut [[f32; 2]]) {
    for (segment, bounds) in bounds.iter_mut().enumerate() {
        let first = segment * SEGMENT;
        *bounds = [f32::INFINITY, f32::NEG_INFINITY];
        for &y in &ys[first..(first + SEGMENT + 1).min(ys.len())] {
            // `min` and `max` pass over NaN.
            *bounds = [bounds[0].min(y), bounds[1].max(y)];
        }
    }
}

/// The samples and what decides which of them are connected.
struct Mesh<'a> {
    vertices: [&'a [f32]; 4],
    bounds: &'a [[f32; 2]],
    width: usize,
    height: usize,
    amplitude: Option<&'a [f32]>,
    /// Largest relative step of depth within a quad on one surface.
    steepest: f32,
    /// Longest side of a triangle's box, pixels.
    largest: f32,
    /// Half the distance of two samples, color pixels.
    half_sample: f32,
}

/// What can be drawn of a quad with corners 0 1 above and 2 3 below: nothing, all of it along one
/// diagonal or the other, or one corner cut off. All triangles turn the way a front face does.
const TRIANGLES: [&[[usize; 3]]; 7] = [
    &[],
    &[[0, 1, 2], [1, 3, 2]],
    &[[0, 1, 3], [0, 3, 2]],
    &[[0, 1, 2]],
    &[[1, 3, 2]],
    &[[0, 1, 3]],
    &[[0, 3, 2]],
];

impl Mesh<'_> {
    fn corners(&self, x: usize, y: usize) -> [usize; 4] {
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
    fn sort(&self, kinds: &mut Vec<u8>) {
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
    fn vertex(&self, i: usize) -> Vertex {
        let [x, y, inverse, sigma] = self.vertices;
        [x[i], y[i], inverse[i], sigma[i]]
    }

    fn mark_lonely(&self, kinds: &[u8], lonely: &mut Vec<bool>) {
        let width = self.width;
        lonely.resize(width * self.height, false);
        lonely
            .par_chunks_mut(width)
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, row)| {
                for (x, lonely) in row.iter_mut().enumerate() {
                    let i = y * width + x;
                    // A whole quad below right: the usual case, settled at once.
                    *lonely = !matches!(kinds[i], 1 | 2)
                        && self.vertices[2][i] > 0.0
                        && self.vertices[3][i] > 0.0
                        && !spans(kinds, width, x, y);
                }
            });
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
