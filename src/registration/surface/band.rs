//! Some rows of the color grid, painted with triangles and squares.

use super::{
    SEGMENT,
    mesh::{Mesh, TRIANGLES},
    quads::{Quads, Region, Triangle, linear, solid},
};
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
        if mesh.amplitude.is_some() {
            self.draw_mesh::<S, true>(simd, mesh)
        } else {
            self.draw_mesh::<S, false>(simd, mesh)
        }
    }

    #[inline(always)]
    fn draw_mesh<S: Simd, const AMPLITUDE: bool>(&mut self, simd: S, mesh: &Mesh) -> bool {
        self.inverse.fill(0.0);
        self.sigma.fill(f32::NAN);
        self.amplitude.fill(f32::NAN);
        let mut quads = Quads::default();
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
                if y < next {
                    quads.prepare(mesh, self.kinds, [first, y], self.region());
                }
                for n in 0..SEGMENT.min(mesh.width - first) {
                    self.sample::<S, AMPLITUDE>(simd, mesh, &quads, [first, n, y]);
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

    fn region(&self) -> Region {
        Region {
            first_row: self.first_row,
            rows: self.rows,
            width: self.width,
        }
    }

    /// Draws what belongs to sample n of a segment that begins at `first` in row `y`.
    #[inline(always)]
    fn sample<S: Simd, const AMPLITUDE: bool>(
        &mut self,
        simd: S,
        mesh: &Mesh,
        quads: &Quads,
        [first, n, y]: [usize; 3],
    ) {
        let i = y * mesh.width + first + n;
        if self.lonely[i] {
            self.square(mesh, i);
        }
        let kind = self.kinds[i];
        if kind == 0 {
            return;
        }
        let corners = mesh.corners(first + n, y);
        if kind <= 2 {
            let Some(frame) = quads.frame(n) else {
                return;
            };
            match quads.triangles(n, kind, corners) {
                [Some(one), Some(other)] => {
                    self.paint::<S, 2, AMPLITUDE>(simd, mesh, frame, [one, other]);
                }
                [Some(one), None] | [None, Some(one)] => {
                    self.paint::<S, 1, AMPLITUDE>(simd, mesh, frame, [one]);
                }
                [None, None] => {}
            }
            return;
        }
        let samples = TRIANGLES[usize::from(kind)][0].map(|c| corners[c]);
        let v = samples.map(|i| mesh.vertex(i));
        if let Some(frame) = solid(self.region().frame(mesh.largest, v))
            && let Some(triangle) = Triangle::new(v, samples)
        {
            self.paint::<S, 1, AMPLITUDE>(simd, mesh, frame, [triangle]);
        }
    }

    /// Paints the pixels whose centre lies in one of the triangles.
    #[inline(always)]
    fn paint<S: Simd, const N: usize, const AMPLITUDE: bool>(
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
                    let Triangle {
                        b,
                        c,
                        c_to_b,
                        a_to_c,
                        ..
                    } = triangle;
                    let at_a = (px - b[0]).mul_add(
                        splat(simd, c_to_b[1]),
                        splat(simd, -c_to_b[0] * (py - b[1])),
                    );
                    let at_b = (px - c[0]).mul_add(
                        splat(simd, a_to_c[1]),
                        splat(simd, -a_to_c[0] * (py - c[1])),
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
                    if AMPLITUDE && let Some(plane) = mesh.amplitude {
                        let corners = triangle.samples.map(|i| plane[i]);
                        let [da, db, base] = linear(corners, 1.0 / triangle.area);
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
