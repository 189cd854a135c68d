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
use fearless_simd::{Level, Simd, dispatch, f32x4, prelude::*};
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

/// Pixels painted side by side.
const LANES: usize = 4;

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
    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, mesh: &Mesh) -> bool {
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
                    self.sample(simd, mesh, x, y);
                }
            }
        }
        let mut landed = false;
        let results = self.inverse.iter_mut().zip(&*self.sigma);
        for ((inverse, sigma), measured) in results.zip(&mut *self.measured) {
            let answered = !sigma.is_nan();
            landed |= answered;
            *measured = answered;
            *inverse = if answered { 1.0 / *inverse } else { f32::NAN };
        }
        for (amplitude, answered) in self.amplitude.iter_mut().zip(&*self.measured) {
            *amplitude = if *answered { *amplitude } else { f32::NAN };
        }
        landed
    }

    #[inline(always)]
    fn sample<S: Simd>(&mut self, simd: S, mesh: &Mesh, x: usize, y: usize) {
        let i = y * mesh.width + x;
        if self.lonely[i] {
            self.square(mesh, i);
        }
        match usize::from(self.kinds[i]) {
            0 => {}
            1 => self.whole(simd, mesh, x, y, [[0, 1, 2], [1, 3, 2]]),
            2 => self.whole(simd, mesh, x, y, [[0, 1, 3], [0, 3, 2]]),
            kind => {
                let corners = mesh.corners(x, y);
                let samples = TRIANGLES[kind][0].map(|c| corners[c]);
                let v = samples.map(|i| mesh.vertex(i));
                if let Some(frame) = self.frame(mesh, v)
                    && let Some(triangle) = Triangle::new(v, samples)
                {
                    self.paint(simd, mesh, frame, [triangle]);
                }
            }
        }
    }

    /// A quad of two triangles.
    #[inline(always)]
    fn whole<S: Simd>(
        &mut self,
        simd: S,
        mesh: &Mesh,
        x: usize,
        y: usize,
        [first, second]: [[usize; 3]; 2],
    ) {
        let samples = mesh.corners(x, y);
        let [i, j, k, l] = samples;
        // Spelled out: closures over arrays are not inlined here.
        let v = [
            mesh.vertex(i),
            mesh.vertex(j),
            mesh.vertex(k),
            mesh.vertex(l),
        ];
        let Some(frame) = self.frame(mesh, v) else {
            return;
        };
        let [a, b, c] = first;
        let first = Triangle::new([v[a], v[b], v[c]], [samples[a], samples[b], samples[c]]);
        let [a, b, c] = second;
        let second = Triangle::new([v[a], v[b], v[c]], [samples[a], samples[b], samples[c]]);
        match (first, second) {
            (Some(first), Some(second)) => self.paint(simd, mesh, frame, [first, second]),
            (Some(one), None) | (None, Some(one)) => self.paint(simd, mesh, frame, [one]),
            (None, None) => {}
        }
    }

    /// Pixels that may lie within these vertices: first and past the last x, first and past the last y.
    /// `None` when there are none in this band, or the vertices lie too far apart.
    #[inline(always)]
    fn frame<const N: usize>(&self, mesh: &Mesh, vertices: [Vertex; N]) -> Option<[usize; 4]> {
        let (mut left, mut top) = (f32::INFINITY, f32::INFINITY);
        let (mut right, mut bottom) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
        for [x, y, ..] in vertices {
            (left, right) = (left.min(x), right.max(x));
            (top, bottom) = (top.min(y), bottom.max(y));
        }
        if right - left > mesh.largest || bottom - top > mesh.largest {
            return None;
        }
        let (x0, x1) = near_centres(left, right, 0, self.width);
        let (y0, y1) = near_centres(top, bottom, self.first_row, self.rows);
        (x0 < x1 && y0 < y1).then_some([x0, x1, y0, y1])
    }

    /// Paints the pixels whose centre lies in one of the triangles.
    #[inline(always)]
    fn paint<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        mesh: &Mesh,
        [x0, x1, y0, y1]: [usize; 4],
        triangles: [Triangle; N],
    ) {
        // A pixel on a shared side belongs to both triangles rather than to none.
        const ON_SIDE: f32 = -1e-4;
        let ramp = f32x4::load_array(simd, [0.0, 1.0, 2.0, 3.0]);
        let past = x1 as f32;
        for y in y0..y1 {
            let py = y as f32;
            let row = (y - self.first_row) * self.width;
            let mut x = x0;
            while x < x1 {
                let px = ramp + x as f32;
                let within = px.simd_lt(past);
                let nearest = lanes(simd, self.inverse, row + x);
                let mut inverse = nearest;
                let mut sigma = lanes(simd, self.sigma, row + x);
                for triangle in &triangles {
                    let [a, b, c] = triangle.vertices;
                    let at_a = (px - b[0]).mul_add(
                        splat(simd, b[1] - c[1]),
                        splat(simd, (c[0] - b[0]) * (py - b[1])),
                    );
                    let at_b = (px - c[0]).mul_add(
                        splat(simd, c[1] - a[1]),
                        splat(simd, (a[0] - c[0]) * (py - c[1])),
                    );
                    let at_c = splat(simd, triangle.area) - at_a - at_b;
                    let inside = within & at_a.min(at_b).min(at_c).simd_ge(ON_SIDE);
                    let [da, db, base] = triangle.inverse;
                    let here = at_a.mul_add(
                        splat(simd, da),
                        at_b.mul_add(splat(simd, db), splat(simd, base)),
                    );
                    let shown = inside & here.simd_gt(inverse);
                    inverse = shown.select(here, inverse);
                    let [da, db, base] = triangle.sigma;
                    let said = at_a.mul_add(
                        splat(simd, da),
                        at_b.mul_add(splat(simd, db), splat(simd, base)),
                    );
                    sigma = shown.select(said, sigma);
                    if let Some(plane) = mesh.amplitude {
                        let [a, b, c] = triangle.samples;
                        let [da, db, base] =
                            linear([plane[a], plane[b], plane[c]], triangle.per_area);
                        let amplitude = lanes(simd, self.amplitude, row + x);
                        let said = at_a.mul_add(
                            splat(simd, da),
                            at_b.mul_add(splat(simd, db), splat(simd, base)),
                        );
                        store(shown.select(said, amplitude), self.amplitude, row + x);
                    }
                }
                store(inverse, self.inverse, row + x);
                store(sigma, self.sigma, row + x);
                x += LANES;
            }
        }
    }

    /// Pixels whose centre lies within half a sample of this one.
    fn square(&mut self, mesh: &Mesh, sample: usize) {
        let [px, py, inverse, sigma] = mesh.vertex(sample);
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

/// [`centres`], or a few pixels more, for the many small ones.
#[inline(always)]
fn near_centres(from: f32, to: f32, first: usize, count: usize) -> (usize, usize) {
    // From here on the low bits of a float are its whole number; both sides stay within the picture.
    const WHOLE: f32 = 8_388_608.0;
    let rounded = |at: f32| ((at + WHOLE).to_bits() & 0x7f_ffff) as usize;
    let (low, past) = (first as f32, (first + count) as f32);
    if to < low || from >= past {
        return (first, first);
    }
    // Half up and half down, with what rounding may add.
    let start = rounded((from + 0.499).clamp(low, past));
    let end = rounded((to - 0.499).clamp(low, past)) + 1;
    (start.max(first), end.min(first + count))
}

/// A front-facing triangle of three samples.
struct Triangle {
    vertices: [Vertex; 3],
    samples: [usize; 3],
    area: f32,
    per_area: f32,
    /// See [`linear`].
    inverse: [f32; 3],
    /// NaN where a corner is assumed and the triangle only hides.
    sigma: [f32; 3],
}

impl Triangle {
    /// `None` where it is turned away from the color camera (or NaN): something nearer hides it.
    #[inline(always)]
    fn new(vertices: [Vertex; 3], samples: [usize; 3]) -> Option<Self> {
        let [a, b, c] = vertices;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let answers = a[3].min(b[3]).min(c[3]) > 0.0;
        if area.is_nan() || area <= 1e-6 {
            return None;
        }
        let per_area = 1.0 / area;
        let mut sigma = linear([a[3], b[3], c[3]], per_area);
        sigma[2] = if answers { sigma[2] } else { f32::NAN };
        Some(Self {
            vertices,
            samples,
            area,
            per_area,
            inverse: linear([a[2], b[2], c[2]], per_area),
            sigma,
        })
    }
}

/// What grows from corner c toward a, toward b (per twice the area opposite), and its value at c.
#[inline(always)]
fn linear([a, b, c]: [f32; 3], per_area: f32) -> [f32; 3] {
    [(a - c) * per_area, (b - c) * per_area, c]
}

#[inline(always)]
fn splat<S: Simd>(simd: S, value: f32) -> f32x4<S> {
    f32x4::splat(simd, value)
}

/// Four pixels from `start`, or fewer at the end of the plane.
#[inline(always)]
fn lanes<S: Simd>(simd: S, plane: &[f32], start: usize) -> f32x4<S> {
    if let Some(whole) = plane.get(start..start + LANES) {
        return f32x4::from_slice(simd, whole);
    }
    let mut lanes = [0.0; LANES];
    lanes[..plane.len() - start].copy_from_slice(&plane[start..]);
    f32x4::load_array(simd, lanes)
}

/// Puts back what [`lanes`] took.
#[inline(always)]
fn store<S: Simd>(values: f32x4<S>, plane: &mut [f32], start: usize) {
    if let Some(whole) = plane.get_mut(start..start + LANES) {
        values.store_slice(whole);
    } else {
        let rest = &mut plane[start..];
        rest.copy_from_slice(&<[f32; LANES]>::from(values)[..rest.len()]);
    }
}
