//! Draws depth samples as a connected surface on the distorted color grid.
//!
//! Neighbouring samples on one surface span triangles, so an upsampled surface has no pinholes
//! and hides what lies behind it; triangles over a depth edge are not drawn, so no surface
//! bleeds over its rim. The nearest surface wins (z-buffer on inverse depth, which is linear in
//! the picture for a plane). Samples that span no triangle, on thin things, paint a square of
//! their own size.

mod band;
mod mesh;
mod quads;

use super::{
    RegisteredDepth,
    cleaning::{Cleaned, STEEP, STEEPEST},
    maps::{ColorGrid, DepthGrid, Rays},
};
use band::Band;
use drivers::DepthFrame;
use fearless_simd::{Level, dispatch};
use mesh::Mesh;
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
    /// Per quad, named by its upper left sample: what is drawn of it, an index of [`mesh::TRIANGLES`].
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
            steep: std::f32::consts::SQRT_2 * STEEP * depth.spacing,
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
