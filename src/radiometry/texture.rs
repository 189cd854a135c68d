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
    let mut finite: Vec<f32> = luminance
        .samples()
        .par_iter()
        .copied()
        .filter(|light| light.is_finite())
        .collect();
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
        *light = (known * scale).max(0.0).cbrt();
    });
    let root = smoothed(&root);
    let mut squares = root.clone();
    squares
        .samples_mut()
        .par_iter_mut()
        .for_each(|value| *value *= *value);
    let (mean, mean_square) = (window_means(&root), window_means(&squares));
    let mut values = root;
    values
        .samples_mut()
        .par_iter_mut()
        .zip(mean.samples().par_iter().zip(mean_square.samples()))
        .for_each(|(value, (mean, square))| {
            let contrast = (square - mean * mean).max(0.0).sqrt();
            *value = (*value - mean) / (contrast + CONTRAST_FLOOR);
        });
    Texture { values, known }
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

/// Mean over the window around every pixel, cut at the edges.
fn window_means(plane: &Plane<f32>) -> Plane<f32> {
    let (width, height) = plane.size();
    let mut means = Plane::filled(width, height, 0.0f32);
    means
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each_init(
            || vec![0.0f32; width],
            |columns, (y, out)| {
                let rows = y.saturating_sub(WINDOW_REACH)..(y + WINDOW_REACH + 1).min(height);
                columns.fill(0.0);
                for row in rows.clone() {
                    for (sum, value) in columns.iter_mut().zip(plane.row(row)) {
                        *sum += value;
                    }
                }
                let mut running: f64 = 0.0;
                let (mut from, mut to) = (0, 0);
                for (x, out) in out.iter_mut().enumerate() {
                    while to < (x + WINDOW_REACH + 1).min(width) {
                        running += f64::from(columns[to]);
                        to += 1;
                    }
                    while from + WINDOW_REACH < x {
                        running -= f64::from(columns[from]);
                        from += 1;
                    }
                    *out = (running / ((to - from) * rows.len()) as f64) as f32;
                }
            },
        );
    means
}
