//! What two pictures of one scene share whatever the light: texture, by scale.

use super::LinearImage;
use drivers::Plane;
use rayon::prelude::*;

/// Pixels above which the finest level is left out: patches are placed to a few hundredths of a
/// pixel, so half resolution still gives a tenth of a full one.
const PIXELS_AT_MOST: usize = 5_000_000;
/// Shorter side of the coarsest level, at least.
const COARSEST_SIDE: usize = 40;
/// Half the side of the window in which brightness and contrast are evened out.
const WINDOW_REACH: usize = 7;
/// Contrast (in cube-root units, where middle grey is 0.58) under which texture counts as noise.
const CONTRAST_FLOOR: f32 = 0.015;

/// Pixels, nearly, of which a picture's median brightness is taken.
const MEDIAN_OF: usize = 16_384;

/// Texture of a picture at one scale: cube-root luminance, its local mean removed and divided by
/// its local contrast, so that neither the lamp's strength nor its slow fall-off shows.
pub(super) struct Texture {
    /// About −3 … 3, finite everywhere.
    pub values: Plane<f32>,
    /// False where the picture is clipped or unknown.
    pub known: Plane<bool>,
}

/// Textures from fine to coarse, each half the size of the one before.
pub(super) fn pyramid(image: &LinearImage) -> Vec<Texture> {
    let (width, height) = image.0.size();
    let mut luminance = if image.0.len() > PIXELS_AT_MOST {
        halved(width, height, |x, y| grey(&image.0[(x, y)]))
    } else {
        let samples = image.0.samples().par_iter().map(grey).collect();
        Plane::new(width, height, samples).unwrap_or_default()
    };
    let mut levels = Vec::new();
    loop {
        levels.push(texture(&luminance));
        let (width, height) = luminance.size();
        if width.min(height) / 2 < COARSEST_SIDE {
            return levels;
        }
        luminance = halved(width, height, |x, y| luminance[(x, y)]);
    }
}

fn grey(rgb: &[f32; 3]) -> f32 {
    (rgb[0] + rgb[1] + rgb[2]) / 3.0
}

/// Means over 2×2 pixels; unknown where one of them is.
fn halved(width: usize, height: usize, at: impl Fn(usize, usize) -> f32 + Sync) -> Plane<f32> {
    let (half_width, half_height) = (width / 2, height / 2);
    let mut half = Plane::filled(half_width, half_height, 0.0f32);
    half.samples_mut()
        .par_chunks_mut(half_width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, sample) in row.iter_mut().enumerate() {
                let (x, y) = (2 * x, 2 * y);
                *sample = (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) / 4.0;
            }
        });
    half
}

fn texture(luminance: &Plane<f32>) -> Texture {
    let known = luminance.map(|light| light.is_finite());
    let stride = luminance.len().div_ceil(MEDIAN_OF);
    let looked_at = luminance.samples().iter().step_by(stride.max(1)).copied();
    let mut finite: Vec<f32> = looked_at.filter(|light| light.is_finite()).collect();
    let (middle, brightest) = if finite.is_empty() {
        (1.0, 1.0)
    } else {
        let brightest = finite.iter().copied().fold(0.0, f32::max);
        let half = finite.len() / 2;
        let (_, middle, _) = finite.select_nth_unstable_by(half, f32::total_cmp);
        (
            middle.max(1e-3 * brightest).max(f32::MIN_POSITIVE),
            brightest,
        )
    };
    // Middle grey at 0.2; what clips is at least as bright as the brightest known.
    let scale = 0.2 / middle;
    let mut root = luminance.clone();
    root.samples_mut().par_iter_mut().for_each(|light| {
        let known = if light.is_finite() { *light } else { brightest };
        *light = cube_root((known * scale).max(0.0));
    });
    let root = smoothed(&root);
    Texture {
        values: evened(&root),
        known,
    }
}

/// The cube root of a number ≥ 0, within 1e-4 of it: two steps of Newton's from the exponent's third.
fn cube_root(value: f32) -> f32 {
    let mut root = f32::from_bits(value.max(f32::MIN_POSITIVE).to_bits() / 3 + 0x2a51_37a0);
    for _ in 0..2 {
        root -= (root - value / (root * root)) / 3.0;
    }
    root
}
/// Binomial 1-2-1 in both directions, edges repeated.
fn smoothed(plane: &Plane<f32>) -> Plane<f32> {
    let (width, height) = plane.size();
    let mut smooth = plane.clone();
    smooth
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, out)| {
            let above = plane.row(y.saturating_sub(1));
            let here = plane.row(y);
            let below = plane.row((y + 1).min(height - 1));
            let column = |x: usize| above[x] + 2.0 * here[x] + below[x];
            for (x, out) in out.iter_mut().enumerate() {
                let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
                *out = (column(left) + 2.0 * column(x) + column(right)) / 16.0;
            }
        });
    smooth
}

/// Rows whose windows are summed by one thread, each from the one above.
const ROWS_AT_ONCE: usize = 32;

/// The plane less its mean over the window around every pixel, over the contrast there; windows are cut at the edges.
fn evened(plane: &Plane<f32>) -> Plane<f32> {
    let (width, height) = plane.size();
    let mut out = Plane::filled(width, height, 0.0f32);
    let rows = out
        .samples_mut()
        .par_chunks_mut(width.max(1) * ROWS_AT_ONCE);
    rows.enumerate().for_each(|(block, out)| {
        let first = block * ROWS_AT_ONCE;
        let window = |y: usize| y.saturating_sub(WINDOW_REACH)..(y + WINDOW_REACH + 1).min(height);
        // Sums and sums of squares of the window's columns.
        let mut columns = vec![[0.0f32; 2]; width];
        let take = |columns: &mut [[f32; 2]], y: usize, sign: f32| {
            for (sums, value) in columns.iter_mut().zip(plane.row(y)) {
                sums[0] += sign * value;
                sums[1] += sign * value * value;
            }
        };
        window(first).for_each(|y| take(&mut columns, y, 1.0));
        for (out, y) in out.chunks_exact_mut(width).zip(first..) {
            if y > first {
                (window(y - 1).start..window(y).start).for_each(|y| take(&mut columns, y, -1.0));
                (window(y - 1).end..window(y).end).for_each(|y| take(&mut columns, y, 1.0));
            }
            even_row(&columns, window(y).len(), plane.row(y), out);
        }
    });
    out
}

/// One row of [`evened`], of the sums of its windows' columns of `rows` pixels.
fn even_row(columns: &[[f32; 2]], rows: usize, values: &[f32], out: &mut [f32]) {
    let width = columns.len();
    let mut running = [0.0f64; 2];
    let (mut from, mut to) = (0, 0);
    for (x, (value, out)) in values.iter().zip(out).enumerate() {
        while to < (x + WINDOW_REACH + 1).min(width) {
            running[0] += f64::from(columns[to][0]);
            running[1] += f64::from(columns[to][1]);
            to += 1;
        }
        while from + WINDOW_REACH < x {
            running[0] -= f64::from(columns[from][0]);
            running[1] -= f64::from(columns[from][1]);
            from += 1;
        }
        let count = ((to - from) * rows) as f32;
        let (mean, square) = (running[0] as f32 / count, running[1] as f32 / count);
        let contrast = (square - mean * mean).max(0.0).sqrt();
        *out = (value - mean) / (contrast + CONTRAST_FLOOR);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_root_is_one() {
        for step in 0..=3000 {
            let value = step as f32 * 1e-3;
            let found = cube_root(value);
            assert!((found - value.cbrt()).abs() <= 1e-4, "{value}: {found}");
        }
    }

    #[test]
    fn windows_summed_from_row_to_row_are_those_summed_anew() {
        let plane = Plane::from_fn(70, 90, |x, y| ((x * 37 + y * 91) % 23) as f32 / 23.0);
        let found = evened(&plane);
        for (x, y) in [
            (0usize, 0usize),
            (35, 31),
            (35, 32),
            (69, 63),
            (3, 64),
            (69, 89),
        ] {
            let rows = y.saturating_sub(WINDOW_REACH)..(y + WINDOW_REACH + 1).min(90);
            let columns = x.saturating_sub(WINDOW_REACH)..(x + WINDOW_REACH + 1).min(70);
            let seen: Vec<f32> = rows
                .flat_map(|y| plane.row(y)[columns.clone()].to_vec())
                .collect();
            let mean = seen.iter().sum::<f32>() / seen.len() as f32;
            let square = seen.iter().map(|v| v * v).sum::<f32>() / seen.len() as f32;
            let contrast = (square - mean * mean).sqrt();
            let expected = (plane[(x, y)] - mean) / (contrast + CONTRAST_FLOOR);
            assert!((found[(x, y)] - expected).abs() < 1e-3, "{x} {y}");
        }
    }
}
