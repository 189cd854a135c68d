//! Quads of two triangles, prepared for painting a segment of a row at a time.

use super::{SEGMENT, Vertex, mesh::Mesh};

/// A front-facing triangle of three samples a, b, c.
pub(super) struct Triangle {
    pub b: [f32; 2],
    pub c: [f32; 2],
    /// From c to b and from a to c: turned, they measure how far a pixel lies toward a and b.
    pub c_to_b: [f32; 2],
    pub a_to_c: [f32; 2],
    /// Twice the area, square pixels.
    pub area: f32,
    /// See [`linear`].
    pub inverse: [f32; 3],
    /// NaN where a corner is assumed and the triangle only hides.
    pub sigma: [f32; 3],
    pub samples: [usize; 3],
}

impl Triangle {
    /// `None` where it is turned away from the color camera (or NaN): something nearer hides it.
    #[inline(always)]
    pub fn new(vertices: [Vertex; 3], samples: [usize; 3]) -> Option<Self> {
        let triangle = Self::any(vertices, samples);
        is_front(triangle.area).then_some(triangle)
    }

    #[inline(always)]
    fn any([a, b, c]: [Vertex; 3], samples: [usize; 3]) -> Self {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let per_area = 1.0 / area;
        let answers = (a[3] > 0.0) & (b[3] > 0.0) & (c[3] > 0.0);
        let mut sigma = linear([a[3], b[3], c[3]], per_area);
        sigma[2] = if answers { sigma[2] } else { f32::NAN };
        Self {
            b: [b[0], b[1]],
            c: [c[0], c[1]],
            c_to_b: [b[0] - c[0], b[1] - c[1]],
            a_to_c: [c[0] - a[0], c[1] - a[1]],
            area,
            inverse: linear([a[2], b[2], c[2]], per_area),
            sigma,
            samples,
        }
    }
}

#[inline(always)]
fn is_front(area: f32) -> bool {
    // False for NaN.
    area > 1e-6
}

/// What grows from corner c toward a, toward b (per twice the area opposite), and its value at c.
#[inline(always)]
pub(super) fn linear([a, b, c]: [f32; 3], per_area: f32) -> [f32; 3] {
    [(a - c) * per_area, (b - c) * per_area, c]
}

/// Rows and columns of the color grid that are painted.
#[derive(Clone, Copy)]
pub(super) struct Region {
    pub first_row: usize,
    pub rows: usize,
    pub width: usize,
}

impl Region {
    /// Pixels that may lie within these vertices: first and past the last x, first and past the
    /// last y. Empty also where the vertices lie more than `largest` pixels apart.
    #[inline(always)]
    pub fn frame<const N: usize>(&self, largest: f32, vertices: [Vertex; N]) -> [u32; 4] {
        let (mut left, mut top) = (f32::INFINITY, f32::INFINITY);
        let (mut right, mut bottom) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
        for [x, y, ..] in vertices {
            // Not `min` and `max`, which look for NaN first: a drawn sample has none.
            left = if x < left { x } else { left };
            right = if x > right { x } else { right };
            top = if y < top { y } else { top };
            bottom = if y > bottom { y } else { bottom };
        }
        let [x0, x1] = near_centres(left, right, 0, self.width);
        let [y0, y1] = near_centres(top, bottom, self.first_row, self.rows);
        let torn = (right - left > largest) | (bottom - top > largest);
        [x0, x1, y0, if torn { 0 } else { y1 }]
    }
}

/// Half-open range of whole numbers in [from, to], cut to `first..first + count`, or a few more.
#[inline(always)]
fn near_centres(from: f32, to: f32, first: usize, count: usize) -> [u32; 2] {
    // From here on the low bits of a float are its whole number; both sides stay within the picture.
    const WHOLE: f32 = 8_388_608.0;
    let (low, past) = (first as f32, (first + count) as f32);
    let rounded = |at: f32| {
        let at = if at > low { at } else { low };
        let at = if at < past { at } else { past };
        (at + WHOLE).to_bits() & 0x7f_ffff
    };
    // Half up and half down, with what rounding may add.
    let (start, end) = (rounded(from + 0.499), rounded(to - 0.499) + 1);
    let outside = (to < low) | (from >= past);
    let end = if outside { 0 } else { end };
    [start, end.min((first + count) as u32)]
}

/// One number of each quad of a segment.
type Each = [f32; SEGMENT];

/// One of the two triangles of each quad; fields as in [`Triangle`].
struct Half {
    b: [Each; 2],
    c: [Each; 2],
    c_to_b: [Each; 2],
    a_to_c: [Each; 2],
    area: Each,
    inverse: [Each; 3],
    sigma: [Each; 3],
}

/// The quads of a segment that lie on one surface.
pub(super) struct Quads {
    /// See [`Region::frame`].
    frames: [[u32; SEGMENT]; 4],
    halves: [Half; 2],
}

impl Default for Quads {
    fn default() -> Self {
        let half = || Half {
            b: [[0.0; SEGMENT]; 2],
            c: [[0.0; SEGMENT]; 2],
            c_to_b: [[0.0; SEGMENT]; 2],
            a_to_c: [[0.0; SEGMENT]; 2],
            area: [0.0; SEGMENT],
            inverse: [[0.0; SEGMENT]; 3],
            sigma: [[0.0; SEGMENT]; 3],
        };
        Self {
            frames: [[0; SEGMENT]; 4],
            halves: [half(), half()],
        }
    }
}

impl Quads {
    /// Prepares the quads whose upper left samples are (x, y), (x + 1, y), …; those of other kinds
    /// than 1 and 2 hold no meaning. Without a branch, so that the compiler takes many at a time.
    #[inline(always)]
    pub fn prepare(&mut self, mesh: &Mesh, kinds: &[u8], [x, y]: [usize; 2], region: Region) {
        let mut padded = [[0.0; SEGMENT + 1]; 8];
        let [above, below] = rows(mesh, [x, y], &mut padded);
        let mut falling = [false; SEGMENT];
        for (falling, kind) in falling.iter_mut().zip(&kinds[y * mesh.width + x..]) {
            *falling = *kind == 1;
        }
        for (n, falling) in falling.into_iter().enumerate() {
            let vertex = |[x, y, inverse, sigma]: [&[f32; SEGMENT + 1]; 4], n: usize| {
                [x[n], y[n], inverse[n], sigma[n]]
            };
            let v = [
                vertex(above, n),
                vertex(above, n + 1),
                vertex(below, n),
                vertex(below, n + 1),
            ];
            let [x0, x1, y0, y1] = region.frame(mesh.largest, v);
            self.frames[0][n] = x0;
            self.frames[1][n] = x1;
            self.frames[2][n] = y0;
            self.frames[3][n] = y1;
            let pick = |one: Vertex, other: Vertex| {
                let pick = |of: usize| if falling { one[of] } else { other[of] };
                [pick(0), pick(1), pick(2), pick(3)]
            };
            self.halves[0].put(n, [v[0], v[1], pick(v[2], v[3])]);
            self.halves[1].put(n, [pick(v[1], v[0]), v[3], v[2]]);
        }
    }

    /// First and past the last x, first and past the last y of what may be painted; `None` for
    /// nothing.
    #[inline(always)]
    pub fn frame(&self, n: usize) -> Option<[usize; 4]> {
        solid([0, 1, 2, 3].map(|side| self.frames[side][n]))
    }

    /// The triangles of a quad with these corners, as they turn for its kind.
    #[inline(always)]
    pub fn triangles(&self, n: usize, kind: u8, corners: [usize; 4]) -> [Option<Triangle>; 2] {
        let [i, j, k, l] = corners;
        let samples = if kind == 1 {
            [[i, j, k], [j, l, k]]
        } else {
            [[i, j, l], [i, l, k]]
        };
        [
            self.halves[0].triangle(n, samples[0]),
            self.halves[1].triangle(n, samples[1]),
        ]
    }
}

/// The planes of vertices from (x, y) and (x, y + 1) on, lengthened in `padded` at the end of a row.
#[inline(always)]
fn rows<'a>(
    mesh: &Mesh<'a>,
    [x, y]: [usize; 2],
    padded: &'a mut [[f32; SEGMENT + 1]; 8],
) -> [[&'a [f32; SEGMENT + 1]; 4]; 2] {
    let from = |y: usize| y * mesh.width + x;
    let [above, below] = [y, y + 1].map(|y| mesh.vertices.map(|plane| &plane[from(y)..]));
    if x + SEGMENT < mesh.width {
        // Long enough, so that the fallback is never taken.
        let whole = |plane: &'a [f32]| plane.first_chunk().unwrap_or(&[0.0; SEGMENT + 1]);
        return [above.map(whole), below.map(whole)];
    }
    let planes = above.into_iter().chain(below);
    for (padded, plane) in padded.iter_mut().zip(planes) {
        let count = mesh.width - x;
        padded[..count].copy_from_slice(&plane[..count]);
    }
    let [a, b, c, d, e, f, g, h] = padded.each_ref();
    [[a, b, c, d], [e, f, g, h]]
}

/// A frame that holds pixels.
#[inline(always)]
pub(super) fn solid([x0, x1, y0, y1]: [u32; 4]) -> Option<[usize; 4]> {
    let frame = [x0 as usize, x1 as usize, y0 as usize, y1 as usize];
    (x0 < x1 && y0 < y1).then_some(frame)
}

impl Half {
    #[inline(always)]
    fn put(&mut self, n: usize, vertices: [Vertex; 3]) {
        let triangle = Triangle::any(vertices, [0; 3]);
        for axis in [0, 1] {
            self.b[axis][n] = triangle.b[axis];
            self.c[axis][n] = triangle.c[axis];
            self.c_to_b[axis][n] = triangle.c_to_b[axis];
            self.a_to_c[axis][n] = triangle.a_to_c[axis];
        }
        self.area[n] = triangle.area;
        for term in [0, 1, 2] {
            self.inverse[term][n] = triangle.inverse[term];
            self.sigma[term][n] = triangle.sigma[term];
        }
    }

    #[inline(always)]
    fn triangle(&self, n: usize, samples: [usize; 3]) -> Option<Triangle> {
        let two = |of: &[Each; 2]| [of[0][n], of[1][n]];
        let three = |of: &[Each; 3]| [of[0][n], of[1][n], of[2][n]];
        is_front(self.area[n]).then(|| Triangle {
            b: two(&self.b),
            c: two(&self.c),
            c_to_b: two(&self.c_to_b),
            a_to_c: two(&self.a_to_c),
            area: self.area[n],
            inverse: three(&self.inverse),
            sigma: three(&self.sigma),
            samples,
        })
    }
}
