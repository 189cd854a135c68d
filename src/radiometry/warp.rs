//! A small change of viewpoint between two frames, and resampling by it.

use super::LinearImage;

/// Where each pixel of one frame lies in another: `position + displacement(position)`.
///
/// Planar surface flow (Bergen, Anandan, Hanna & Hingorani, "Hierarchical model-based motion
/// estimation", ECCV 1992): the homography of a small camera rotation, linear in its parameters.
/// With X, Y the position from the picture's centre in units of half its longer side,
/// `dx = p0 + p1 X + p2 Y + p6 X² + p7 XY`, `dy = p3 + p4 X + p5 Y + p6 XY + p7 Y²`, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Warp {
    width: usize,
    height: usize,
    parameters: [f64; 8],
}

impl Warp {
    /// Moves nothing in a `width`×`height` picture.
    pub fn identity(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            parameters: [0.0; 8],
        }
    }

    /// The warp with the given `p0 … p7`.
    pub fn new(width: usize, height: usize, parameters: [f64; 8]) -> Self {
        Self {
            width,
            height,
            parameters,
        }
    }

    /// `p0 … p7`.
    pub fn parameters(&self) -> [f64; 8] {
        self.parameters
    }

    /// The same motion on a grid of another size.
    #[must_use]
    pub(super) fn on_grid(&self, width: usize, height: usize) -> Self {
        let scale = width as f64 / self.width as f64;
        Self {
            width,
            height,
            parameters: self.parameters.map(|p| p * scale),
        }
    }

    /// Another motion of the same picture.
    #[must_use]
    pub(super) fn with(&self, parameters: [f64; 8]) -> Self {
        Self {
            parameters,
            ..*self
        }
    }

    /// Whether it moves nothing.
    pub fn is_identity(&self) -> bool {
        self.parameters == [0.0; 8]
    }

    /// Position in the model's units.
    pub(super) fn normalised(&self, x: f64, y: f64) -> [f64; 2] {
        let radius = (self.width.max(self.height) as f64 / 2.0).max(1.0);
        [
            (x - (self.width as f64 - 1.0) / 2.0) / radius,
            (y - (self.height as f64 - 1.0) / 2.0) / radius,
        ]
    }

    /// Displacement of the pixel (x, y), in pixels.
    pub fn displacement(&self, x: f64, y: f64) -> [f64; 2] {
        let [u, v] = self.normalised(x, y);
        let p = &self.parameters;
        [
            p[0] + p[1] * u + p[2] * v + (p[6] * u + p[7] * v) * u,
            p[3] + p[4] * u + p[5] * v + (p[6] * u + p[7] * v) * v,
        ]
    }

    /// Displacement at the centre of the picture, pixels.
    pub fn shift(&self) -> [f32; 2] {
        [self.parameters[0] as f32, self.parameters[3] as f32]
    }

    /// Length of the largest displacement of the four corners, pixels.
    pub fn corner_shift(&self) -> f32 {
        self.furthest_from(&Self::identity(self.width, self.height))
    }

    /// How far two motions of one picture move its corners apart at most, pixels.
    pub(super) fn furthest_from(&self, other: &Self) -> f32 {
        let (right, bottom) = (self.width as f64 - 1.0, self.height as f64 - 1.0);
        [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]]
            .iter()
            .map(|&[x, y]| {
                let ([dx, dy], [ox, oy]) = (self.displacement(x, y), other.displacement(x, y));
                (dx - ox).hypot(dy - oy) as f32
            })
            .fold(0.0, f32::max)
    }
}

/// One resampled pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Resampled {
    /// Light; NaN (all three) where it is unknown.
    pub light: [f32; 3],
    /// Sum of the squared weights: the factor on the variance.
    pub variance_factor: f32,
    /// False where the position lies outside the picture.
    pub inside: bool,
}

impl Resampled {
    /// A pixel that nothing moved.
    pub fn still(light: [f32; 3]) -> Self {
        Self {
            light,
            variance_factor: 1.0,
            inside: true,
        }
    }
}

/// Row `y` of `image` as seen through `warp`.
///
/// Cubic convolution with a = −½ (Keys, IEEE TASSP 1981). Where one of its outer samples is
/// unknown or outside, linear interpolation serves; where one of the inner samples with weight is
/// unknown, so is the pixel. Positions up to half a pixel outside take the edge's value.
pub(super) fn resample_row(image: &LinearImage, warp: &Warp, y: usize, out: &mut [Resampled]) {
    let (width, height) = image.0.size();
    let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
    for (x, pixel) in out.iter_mut().enumerate() {
        let [dx, dy] = warp.displacement(x as f64, y as f64);
        let (sx, sy) = (x as f64 + dx, y as f64 + dy);
        if !(sx >= -0.5 && sy >= -0.5 && sx <= right + 0.5 && sy <= bottom + 0.5) {
            *pixel = Resampled {
                light: [f32::NAN; 3],
                variance_factor: 1.0,
                inside: false,
            };
            continue;
        }
        let (sx, sy) = (sx.clamp(0.0, right), sy.clamp(0.0, bottom));
        let (ix, iy) = (sx as usize, sy as usize);
        let (fx, fy) = ((sx - ix as f64) as f32, (sy - iy as f64) as f32);
        *pixel = cubic(image, ix, iy, fx, fy).unwrap_or_else(|| linear(image, ix, iy, fx, fy));
    }
}

fn cubic(image: &LinearImage, ix: usize, iy: usize, fx: f32, fy: f32) -> Option<Resampled> {
    let (width, height) = image.0.size();
    if ix < 1 || iy < 1 || ix + 2 >= width || iy + 2 >= height {
        return None;
    }
    let (wx, wy) = (keys(fx), keys(fy));
    // First down, four pixels of three channels at a time, then across.
    let mut columns = [0.0f32; 12];
    for (row, weight) in wy.iter().enumerate() {
        let taps = &image.0.row(iy - 1 + row)[ix - 1..ix + 3];
        for (sum, tap) in columns.iter_mut().zip(taps.as_flattened()) {
            *sum += weight * tap;
        }
    }
    let mut light = [0.0f32; 3];
    for (column, weight) in columns.chunks_exact(3).zip(&wx) {
        for (sum, channel) in light.iter_mut().zip(column) {
            *sum += weight * channel;
        }
    }
    let squares = |w: &[f32; 4]| w.iter().map(|w| w * w).sum::<f32>();
    light
        .iter()
        .all(|channel| !channel.is_nan())
        .then(|| Resampled {
            light,
            variance_factor: squares(&wx) * squares(&wy),
            inside: true,
        })
}

fn linear(image: &LinearImage, ix: usize, iy: usize, fx: f32, fy: f32) -> Resampled {
    let (wx, wy) = ([1.0 - fx, fx], [1.0 - fy, fy]);
    let mut light = [0.0f32; 3];
    for (row, weight_y) in wy.iter().enumerate() {
        for (column, weight_x) in wx.iter().enumerate() {
            let weight = weight_x * weight_y;
            // A neighbour without weight must not spread its NaN.
            if weight > 0.0
                && let Some(tap) = image.0.get(ix + column, iy + row)
            {
                for (sum, channel) in light.iter_mut().zip(tap) {
                    *sum += weight * channel;
                }
            }
        }
    }
    let squares = |w: &[f32; 2]| w[0] * w[0] + w[1] * w[1];
    Resampled {
        light,
        variance_factor: squares(&wx) * squares(&wy),
        inside: true,
    }
}

/// Weights of the four samples around a position `t` of the way from the second to the third.
pub(super) fn keys(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    ]
}
