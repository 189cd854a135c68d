//! Planes fitted to windows of one size.

use drivers::Plane;
use rayon::prelude::*;
use std::ops::Add;

/// Weighted sums over the pixels of a block; `w` is 1/z. Twice the digits of a pixel, because the
/// spread of 1/z is a difference of large numbers.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    count: f64,
    weight: f64,
    x: f64,
    y: f64,
    w: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    xw: f64,
    yw: f64,
    ww: f64,
}

impl Moments {
    pub fn add_pixel(&mut self, x: f64, y: f64, w: f64, weight: f64) {
        self.count += 1.0;
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.w += weight * w;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
        self.yy += weight * y * y;
        self.xw += weight * x * w;
        self.yw += weight * y * w;
        self.ww += weight * w * w;
    }
}

impl Add for Moments {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            weight: self.weight + other.weight,
            x: self.x + other.x,
            y: self.y + other.y,
            w: self.w + other.w,
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            yy: self.yy + other.yy,
            xw: self.xw + other.xw,
            yw: self.yw + other.yw,
            ww: self.ww + other.ww,
        }
    }
}

/// Moments of blocks of `side`×`side` pixels, each pixel weighed by 1/sigma².
pub(super) fn blocks(inverse: &Plane<f32>, sigma: &Plane<f32>, side: usize) -> Plane<Moments> {
    let (width, height) = inverse.size();
    let (across, down) = (width.div_ceil(side), height.div_ceil(side));
    let mut blocks = Plane::filled(across, down, Moments::default());
    blocks
        .samples_mut()
        .par_chunks_mut(across.max(1))
        .enumerate()
        .for_each(|(j, row)| {
            for y in j * side..((j + 1) * side).min(height) {
                let pixels = inverse.row(y).iter().zip(sigma.row(y));
                for (x, (&w, &sigma)) in pixels.enumerate() {
                    let weight = 1.0 / f64::from(sigma * sigma);
                    if !w.is_nan() && weight.is_finite() {
                        row[x / side].add_pixel(x as f64, y as f64, f64::from(w), weight);
                    }
                }
            }
        });
    blocks
}

/// Moments of blocks twice as wide and high.
pub(super) fn halved(fine: &Plane<Moments>) -> Plane<Moments> {
    let (across, down) = (fine.width().div_ceil(2), fine.height().div_ceil(2));
    Plane::from_fn(across, down, |i, j| {
        [(0, 0), (1, 0), (0, 1), (1, 1)]
            .into_iter()
            .filter_map(|(di, dj)| fine.get(2 * i + di, 2 * j + dj))
            .fold(Moments::default(), |sum, &block| sum + block)
    })
}

/// The plane that fits 1/z best in one window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// Mean position of its pixels.
    pub center: [f32; 2],
    /// 1/z there.
    pub value: f32,
    /// Change of 1/z per pixel to the right and down.
    pub slope: [f32; 2],
    /// Root mean square of what the plane leaves, in stated sigmas; NaN without pixels.
    pub misfit: f32,
    /// Sigma of one pixel, as stated; NaN without pixels.
    pub sigma: f32,
    /// Share of the window with known depth; what lies outside the picture counts as unknown.
    pub fill: f32,
}

/// Windows of 2×2 blocks around every corner of the blocks, those of the picture's rim included:
/// window (i, j) is centred where blocks (i − 1, j − 1) and (i, j) meet. Every pixel lies in four.
pub(super) fn windows(blocks: &Plane<Moments>, side: usize) -> Plane<Window> {
    Plane::from_fn(blocks.width() + 1, blocks.height() + 1, |i, j| {
        let moments = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .into_iter()
            .filter_map(|(back, up)| blocks.get(i.checked_sub(back)?, j.checked_sub(up)?))
            .fold(Moments::default(), |sum, &block| sum + block);
        // A window of one column or one pixel has no slope across; the ridge keeps it at zero.
        fit(
            &moments,
            1e-6 * (side * side) as f64,
            (4 * side * side) as f64,
        )
    })
}

impl Window {
    /// 1/z of the plane at a position.
    pub fn at(&self, x: f32, y: f32) -> f32 {
        self.value + self.slope[0] * (x - self.center[0]) + self.slope[1] * (y - self.center[1])
    }
}

/// `ridge`, in pixels², flattens slopes that few pixels tell; `area` is the window's in pixels.
pub(super) fn fit(moments: &Moments, ridge: f64, area: f64) -> Window {
    let m = moments;
    let (x, y, w) = (m.x / m.weight, m.y / m.weight, m.w / m.weight);
    let xx = m.xx / m.weight - x * x;
    let yy = m.yy / m.weight - y * y;
    let xy = m.xy / m.weight - x * y;
    let xw = m.xw / m.weight - x * w;
    let yw = m.yw / m.weight - y * w;
    let (wide, tall) = (xx + ridge, yy + ridge);
    let determinant = wide * tall - xy * xy;
    let across = (xw * tall - yw * xy) / determinant;
    let down = (yw * wide - xw * xy) / determinant;
    let explained = 2.0 * (across * xw + down * yw)
        - (across * across * xx + 2.0 * across * down * xy + down * down * yy);
    let rest = (m.ww / m.weight - w * w - explained).max(0.0);
    Window {
        center: [x as f32, y as f32],
        value: w as f32,
        slope: [across as f32, down as f32],
        misfit: (rest * m.weight / m.count).sqrt() as f32,
        sigma: (m.count / m.weight).sqrt() as f32,
        fill: (m.count / area) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_plane_is_fitted_exactly_by_windows_of_any_size() {
        let inverse = Plane::from_fn(40, 28, |x, y| 0.5 + 0.003 * x as f32 - 0.002 * y as f32);
        let sigma = inverse.map(|_| 1e-3);
        let mut blocks = blocks(&inverse, &sigma, 4);
        for side in [4, 8, 16] {
            for window in windows(&blocks, side).samples() {
                assert!((window.slope[0] - 0.003).abs() < 1e-6, "{window:?}");
                assert!((window.slope[1] + 0.002).abs() < 1e-6, "{window:?}");
                assert!(window.misfit < 0.01, "{window:?}");
            }
            blocks = halved(&blocks);
        }
    }

    #[test]
    fn misfit_is_told_in_sigmas_and_nothing_known_has_none() {
        let inverse = Plane::from_fn(16, 16, |x, y| 1.0 + 0.002 * ((x + y) % 2) as f32);
        let found = windows(&blocks(&inverse, &inverse.map(|_| 1e-3), 8), 8);
        assert!((found[(1, 1)].misfit - 1.0).abs() < 0.01);
        assert!((found[(0, 0)].fill - 0.25).abs() < 1e-6);
        let unknown = inverse.map(|_| f32::NAN);
        let found = windows(&blocks(&unknown, &unknown, 8), 8);
        assert!(found[(1, 1)].misfit.is_nan() && found[(1, 1)].fill == 0.0);
    }
}
