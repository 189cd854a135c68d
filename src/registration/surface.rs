//! Draws depth samples as a connected surface on the distorted color grid.
//!
//! Neighbouring samples on one surface span triangles, so an upsampled surface has no pinholes
//! and hides what lies behind it; triangles over a depth edge are not drawn, so no surface
//! bleeds over its rim. The nearest surface wins (z-buffer on inverse depth, which is linear in
//! the picture for a plane). Samples that span no triangle, on thin things, paint a square of
//! their own size.

use super::{
    RegisteredDepth,
    cleaning::{Cleaned, STEEPEST},
    maps::{ColorGrid, DepthGrid, Rays},
};
use drivers::DepthFrame;
use rayon::prelude::*;

/// Rows of the color grid that one task owns.
const BAND_ROWS: usize = 24;
/// Samples per row segment with one bounding interval.
const SEGMENT: usize = 32;
/// A triangle larger than this many magnified samples spans an edge, whatever its depths say.
const LARGEST_TRIANGLE_SAMPLES: f32 = 24.0;

/// A sample on the color grid: pixel x, pixel y, inverse depth (0 = none), sigma in metres
/// (negative = assumed across a hole: it hides, but does not answer).
type Vertex = [f32; 4];
const NO_VERTEX: Vertex = [f32::NAN, f32::NAN, 0.0, 0.0];

/// Samples of one frame as the color camera sees them.
#[derive(Debug, Clone, Default)]
pub(super) struct Surface {
    vertices: Vec<Vertex>,
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
            vertices: &self.vertices,
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
            .map(|band| band.draw(&mesh))
            .reduce(|| false, |a, b| a | b)
    }

    /// Projects every sample.
    fn place(&mut self, cleaned: &Cleaned, color: &ColorGrid, depth: &DepthGrid, rays: &Rays) {
        let width = depth.width;
        let segments = width.div_ceil(SEGMENT);
        self.vertices.resize(width * depth.height, NO_VERTEX);
        self.bounds.resize(segments * depth.height, [0.0; 2]);
        let [ox, oy, oz] = rays.origin;
        self.vertices
            .par_chunks_mut(width)
            .zip(self.bounds.par_chunks_mut(segments))
            .enumerate()
            .for_each(|(y, (row, bounds))| {
                let span = y * width..(y + 1) * width;
                let [rx, ry, rz] = [0, 1, 2].map(|axis| &rays.axes[axis][span.clone()]);
                let (metres, sigma) = (&cleaned.metres[span.clone()], &cleaned.sigma[span.clone()]);
                let holes = &cleaned.holes.metres[span];
                for (x, vertex) in row.iter_mut().enumerate() {
                    let answered = !metres[x].is_nan();
                    let z = if answered { metres[x] } else { holes[x] };
                    let [px, py, inverse] =
                        color.project(z * rx[x] + ox, z * ry[x] + oy, z * rz[x] + oz);
                    // Comparison is false for every NaN on the way here.
                    let inverse = if inverse > 0.0 { inverse } else { 0.0 };
                    *vertex = [px, py, inverse, if answered { sigma[x] } else { -1e-3 }];
                }
                for (segment, bounds) in bounds.iter_mut().enumerate() {
                    let first = segment * SEGMENT;
                    *bounds = [f32::INFINITY, f32::NEG_INFINITY];
                    for vertex in &row[first..(first + SEGMENT + 1).min(width)] {
                        // `min` and `max` pass over NaN.
                        *bounds = [bounds[0].min(vertex[1]), bounds[1].max(vertex[1])];
                    }
                }
            });
    }
}

/// The samples and what decides which of them are connected.
struct Mesh<'a> {
    vertices: &'a [Vertex],
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
        low > 0.0 && high - low <= low * (self.steepest + (4.0 * sigma * high).min(0.02))
    }

    /// Index of [`TRIANGLES`] for a quad.
    #[inline(always)]
    fn kind(&self, v: [Vertex; 4]) -> u8 {
        if self.is_surface(v) {
            // The flatter diagonal folds the surface less.
            let falling = (v[0][2] - v[3][2]).abs();
            let rising = (v[1][2] - v[2][2]).abs();
            return if rising <= falling { 1 } else { 2 };
        }
        (3..7)
            .find(|&kind| self.is_surface(TRIANGLES[kind][0].map(|corner| v[corner])))
            .unwrap_or(0) as u8
    }

    /// Decides once what is drawn of each quad.
    fn sort(&self, kinds: &mut Vec<u8>) {
        kinds.resize(self.width * self.height, 0);
        kinds
            .par_chunks_mut(self.width)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, kind) in row.iter_mut().enumerate() {
                    let whole = x + 1 < self.width && y + 1 < self.height;
                    *kind = if whole { self.kind(self.quad(x, y)) } else { 0 };
                }
            });
    }

    fn quad(&self, x: usize, y: usize) -> [Vertex; 4] {
        self.corners(x, y).map(|i| self.vertices[i])
    }

    fn mark_lonely(&self, kinds: &[u8], lonely: &mut Vec<bool>) {
        let width = self.width;
        lonely.resize(width * self.height, false);
        lonely
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, lonely) in row.iter_mut().enumerate() {
                    let i = y * width + x;
                    let [_, _, inverse, sigma] = self.vertices[i];
                    // A whole quad below right: the usual case, settled at once.
                    *lonely = !matches!(kinds[i], 1 | 2)
                        && inverse > 0.0
                        && sigma > 0.0
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

/// Some rows of the result; `inverse` becomes metres at the end.
struct Band<'a> {
    kinds: &'a [u8],
    lonely: &'a [bool],
    first_row: usize,
    rows: usize,
    width: usize,
    inverse: &'a mut [f32],
    sigma: &'a mut [f32],
    measured: &'a mut [bool],
    /// Empty when the frame has none.
    amplitude: &'a mut [f32],
}

impl Band<'_> {
    /// True when anything landed.
    fn draw(&mut self, mesh: &Mesh) -> bool {
        self.inverse.fill(0.0);
        self.sigma.fill(f32::NAN);
        self.amplitude.fill(f32::NAN);
        let segments = mesh.width.div_ceil(SEGMENT);
        let top = self.first_row as f32 - mesh.half_sample;
        let bottom = (self.first_row + self.rows - 1) as f32 + mesh.half_sample;
        for y in 0..mesh.height {
            let next = (y + 1).min(mesh.height - 1);
            for segment in 0..segments {
                let here = mesh.bounds[y * segments + segment];
                let below = mesh.bounds[next * segments + segment];
                if here[0].min(below[0]) > bottom || here[1].max(below[1]) < top {
                    continue;
                }
                let first = segment * SEGMENT;
                for x in first..(first + SEGMENT).min(mesh.width) {
                    self.sample(mesh, x, y);
                }
            }
        }
        let mut landed = false;
        for (i, inverse) in self.inverse.iter_mut().enumerate() {
            let answered = !self.sigma[i].is_nan();
            landed |= answered;
            self.measured[i] = answered;
            *inverse = if answered { 1.0 / *inverse } else { f32::NAN };
            if !answered && let Some(amplitude) = self.amplitude.get_mut(i) {
                *amplitude = f32::NAN;
            }
        }
        landed
    }

    fn sample(&mut self, mesh: &Mesh, x: usize, y: usize) {
        if self.lonely[y * mesh.width + x] {
            self.square(mesh, y * mesh.width + x);
        }
        let kind = self.kinds[y * mesh.width + x];
        if kind == 0 {
            return;
        }
        let corners = mesh.corners(x, y);
        let v = corners.map(|i| mesh.vertices[i]);
        let low = v[0][1].min(v[1][1]).min(v[2][1].min(v[3][1]));
        let high = v[0][1].max(v[1][1]).max(v[2][1].max(v[3][1]));
        let (top, bottom) = (
            self.first_row as f32,
            (self.first_row + self.rows - 1) as f32,
        );
        if high < top || low > bottom {
            return;
        }
        for triangle in TRIANGLES[usize::from(kind)] {
            self.triangle(mesh, triangle.map(|c| v[c]), triangle.map(|c| corners[c]));
        }
    }

    /// Pixels whose centre lies in a triangle.
    #[inline(always)]
    fn triangle(&mut self, mesh: &Mesh, [a, b, c]: [Vertex; 3], samples: [usize; 3]) {
        let left = a[0].min(b[0]).min(c[0]);
        let right = a[0].max(b[0]).max(c[0]);
        let top = a[1].min(b[1]).min(c[1]);
        let bottom = a[1].max(b[1]).max(c[1]);
        let (x0, x1) = centres(left, right, 0, self.width);
        let (y0, y1) = centres(top, bottom, self.first_row, self.rows);
        if x0 >= x1 || y0 >= y1 {
            return;
        }
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        // Turned away from the color camera (or NaN): something nearer hides it.
        if area.is_nan() || area <= 1e-6 {
            return;
        }
        if right - left > mesh.largest || bottom - top > mesh.largest {
            return;
        }
        let answers = a[3].min(b[3]).min(c[3]) > 0.0;
        let per_area = 1.0 / area;
        for y in y0..y1 {
            let py = y as f32;
            for x in x0..x1 {
                let px = x as f32;
                let at_a = (c[0] - b[0]) * (py - b[1]) - (c[1] - b[1]) * (px - b[0]);
                let at_b = (a[0] - c[0]) * (py - c[1]) - (a[1] - c[1]) * (px - c[0]);
                let at_c = area - at_a - at_b;
                // A pixel on a shared side belongs to both triangles rather than to none.
                const ON_SIDE: f32 = -1e-4;
                if at_a < ON_SIDE || at_b < ON_SIDE || at_c < ON_SIDE {
                    continue;
                }
                let [at_a, at_b, at_c] = [at_a * per_area, at_b * per_area, at_c * per_area];
                let inverse = at_a * a[2] + at_b * b[2] + at_c * c[2];
                let i = (y - self.first_row) * self.width + x;
                if inverse > self.inverse[i] {
                    self.inverse[i] = inverse;
                    self.sigma[i] = if answers {
                        at_a * a[3] + at_b * b[3] + at_c * c[3]
                    } else {
                        f32::NAN
                    };
                    if let Some(amplitude) = mesh.amplitude {
                        let [aa, ab, ac] = samples.map(|i| amplitude[i]);
                        self.amplitude[i] = at_a * aa + at_b * ab + at_c * ac;
                    }
                }
            }
        }
    }

    /// Pixels whose centre lies within half a sample of this one.
    fn square(&mut self, mesh: &Mesh, sample: usize) {
        let [px, py, inverse, sigma] = mesh.vertices[sample];
        let (x0, x1) = centres(px - mesh.half_sample, px + mesh.half_sample, 0, self.width);
        let (y0, y1) = centres(
            py - mesh.half_sample,
            py + mesh.half_sample,
            self.first_row,
            self.rows,
        );
        for y in y0..y1 {
            for x in x0..x1 {
                let i = (y - self.first_row) * self.width + x;
                if inverse > self.inverse[i] {
                    self.inverse[i] = inverse;
                    self.sigma[i] = sigma;
                    if let Some(amplitude) = mesh.amplitude {
                        self.amplitude[i] = amplitude[sample];
                    }
                }
            }
        }
    }
}

/// Half-open range of whole numbers in [from, to], cut to `first..first + count`.
#[inline(always)]
fn centres(from: f32, to: f32, first: usize, count: usize) -> (usize, usize) {
    // Casts of floats saturate and take NaN to 0; the offset makes truncation a floor.
    let start = (from.max(0.0) as usize).max(first);
    let start = start + usize::from((start as f32) < from);
    let end = if to < 0.0 { 0 } else { to as usize + 1 };
    (start, end.min(first + count))
}
