//! Some rows of the color grid, painted with triangles and squares.

use super::{Mesh, SEGMENT, TRIANGLES, Vertex};
use fearless_simd::{Simd, f32x4, prelude::*};

/// Pixels painted side by side.
const LANES: usize = 4;

/// Some rows of the result; `inverse` becomes metres at the end.
pub(super) struct Band<'a> {
    pub kinds: &'a [u8],
    pub lonely: &'a [bool],
    pub first_row: usize,
    pub rows: usize,
    pub width: usize,
    pub inverse: &'a mut [f32],
    pub sigma: &'a mut [f32],
    pub measured: &'a mut [bool],
    /// Empty when the frame has none.
    pub amplitude: &'a mut [f32],
}

impl Band<'_> {
    /// True when anything landed.
    #[inline(always)]
    pub fn draw<S: Simd>(&mut self, simd: S, mesh: &Mesh) -> bool {
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
            // Not `min` and `max`, which look for NaN first: a drawn sample has none.
            left = if x < left { x } else { left };
            right = if x > right { x } else { right };
            top = if y < top { y } else { top };
            bottom = if y > bottom { y } else { bottom };
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
