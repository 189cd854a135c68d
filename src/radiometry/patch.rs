//! One patch of texture, found again in the other picture.
//!
//! Enhanced correlation coefficient (Evangelidis & Psarakis, "Parametric image alignment using
//! enhanced correlation coefficient maximization", IEEE PAMI 2008) for a translation: it is blind
//! to gain and offset, so it asks only whether the pattern is the same.

use super::texture::Texture;
use super::warp::{Warp, keys};

/// Pixels along the side of a patch.
pub(super) const SIDE: usize = 32;
/// Corrections made, at most.
const STEPS: usize = 10;
/// Length of a correction that counts as arrived, pixels.
const ARRIVED: f64 = 0.004;
/// How far a patch may be from where the warp expects it, pixels.
const REACH: f64 = 3.0;
/// Correlation from which a patch counts as found.
const CORRELATION_AT_LEAST: f64 = 0.6;
/// Smallest mean squared gradient in the weakest direction: less is a wall, or one straight edge.
const CORNER_AT_LEAST: f64 = 0.01;
/// Share of a patch that has to be known in both pictures.
const KNOWN_AT_LEAST: f32 = 0.95;

/// A patch found again.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// Its centre in the first picture, pixels.
    pub centre: [f64; 2],
    /// Where its centre lies in the second, relative to `centre`, pixels.
    pub displacement: [f64; 2],
}

/// Looks for the patch with top left corner (`left`, `top`) of `first` near where `warp` expects
/// it in `second`.
pub(super) fn find(
    first: &Texture,
    second: &Texture,
    warp: &Warp,
    left: usize,
    top: usize,
) -> Option<Match> {
    let half = (SIDE - 1) as f64 / 2.0;
    let centre = [left as f64 + half, top as f64 + half];
    let expected = warp.displacement(centre[0], centre[1]);
    if known_share(first, centre[0], centre[1]) < KNOWN_AT_LEAST {
        return None;
    }
    let mut pattern = Vec::with_capacity(SIDE * SIDE);
    for y in top..top + SIDE {
        pattern.extend_from_slice(&first.values.row(y)[left..left + SIDE]);
    }
    centred(&mut pattern);
    let mut off = [0.0f64; 2];
    for _ in 0..STEPS {
        let seen = sample(&second.values, warp, left, top, off)?;
        let step = correction(&pattern, &seen)?;
        off = [off[0] + step.shift[0], off[1] + step.shift[1]];
        if off[0].hypot(off[1]) > REACH {
            return None;
        }
        if step.shift[0].hypot(step.shift[1]) < ARRIVED {
            let displacement = [expected[0] + off[0], expected[1] + off[1]];
            let there = known_share(
                second,
                centre[0] + displacement[0],
                centre[1] + displacement[1],
            );
            let found = step.correlation >= CORRELATION_AT_LEAST && there >= KNOWN_AT_LEAST;
            return found.then_some(Match {
                centre,
                displacement,
            });
        }
    }
    None
}

/// Correlation of a patch with what lies at its place under `warp`; `None` outside.
pub(super) fn correlation(
    first: &Texture,
    second: &Texture,
    warp: &Warp,
    left: usize,
    top: usize,
) -> Option<f64> {
    let mut pattern = Vec::with_capacity(SIDE * SIDE);
    for y in top..top + SIDE {
        pattern.extend_from_slice(&first.values.row(y)[left..left + SIDE]);
    }
    centred(&mut pattern);
    let seen = sample(&second.values, warp, left, top, [0.0; 2])?;
    correction(&pattern, &seen).map(|step| step.correlation)
}

/// Side of the sampled window: the patch and one pixel around it for gradients.
const WINDOW: usize = SIDE + 2;

/// The window around a patch as seen through `warp` moved on by `off`; the warp is taken as
/// straight across a patch.
fn sample(
    plane: &drivers::Plane<f32>,
    warp: &Warp,
    left: usize,
    top: usize,
    off: [f64; 2],
) -> Option<Vec<f32>> {
    let (width, height) = plane.size();
    let origin = [left as f64 - 1.0, top as f64 - 1.0];
    let at = |x: f64, y: f64| warp.displacement(origin[0] + x, origin[1] + y);
    let span = (WINDOW - 1) as f64;
    let (start, right, down) = (at(0.0, 0.0), at(span, 0.0), at(0.0, span));
    let across = [(right[0] - start[0]) / span, (right[1] - start[1]) / span];
    let along = [(down[0] - start[0]) / span, (down[1] - start[1]) / span];
    let mut window = Vec::with_capacity(WINDOW * WINDOW);
    for row in 0..WINDOW {
        for column in 0..WINDOW {
            let (u, v) = (column as f64, row as f64);
            let x = origin[0] + u + start[0] + off[0] + across[0] * u + along[0] * v;
            let y = origin[1] + v + start[1] + off[1] + across[1] * u + along[1] * v;
            if !(x >= 1.0 && y >= 1.0 && x < width as f64 - 2.0 && y < height as f64 - 2.0) {
                return None;
            }
            let (ix, iy) = (x as usize, y as usize);
            let (wx, wy) = (keys((x - ix as f64) as f32), keys((y - iy as f64) as f32));
            let mut value = 0.0;
            for (row, weight) in wy.iter().enumerate() {
                let taps = &plane.row(iy - 1 + row)[ix - 1..ix + 3];
                value += weight
                    * (taps[0] * wx[0] + taps[1] * wx[1] + taps[2] * wx[2] + taps[3] * wx[3]);
            }
            window.push(value);
        }
    }
    Some(window)
}

struct Step {
    shift: [f64; 2],
    correlation: f64,
}

/// The closed-form step of the paper's equation 17 for a translation.
fn correction(pattern: &[f32], window: &[f32]) -> Option<Step> {
    let mut seen = Vec::with_capacity(SIDE * SIDE);
    let mut gradients = Vec::with_capacity(SIDE * SIDE);
    for y in 1..=SIDE {
        for x in 1..=SIDE {
            let i = y * WINDOW + x;
            seen.push(window[i]);
            gradients.push([
                0.5 * (window[i + 1] - window[i - 1]),
                0.5 * (window[i + WINDOW] - window[i - WINDOW]),
            ]);
        }
    }
    centred(&mut seen);
    let count = (SIDE * SIDE) as f64;
    let mut mean = [0.0f64; 2];
    for gradient in &gradients {
        mean[0] += f64::from(gradient[0]) / count;
        mean[1] += f64::from(gradient[1]) / count;
    }
    let [mut gxx, mut gxy, mut gyy] = [0.0f64; 3];
    let [mut sx, mut sy, mut px, mut py] = [0.0f64; 4];
    let [mut ss, mut pp, mut sp] = [0.0f64; 3];
    for ((gradient, &seen), &pattern) in gradients.iter().zip(&seen).zip(pattern) {
        let (gx, gy) = (
            f64::from(gradient[0]) - mean[0],
            f64::from(gradient[1]) - mean[1],
        );
        let (s, p) = (f64::from(seen), f64::from(pattern));
        gxx += gx * gx;
        gxy += gx * gy;
        gyy += gy * gy;
        sx += gx * s;
        sy += gy * s;
        px += gx * p;
        py += gy * p;
        ss += s * s;
        pp += p * p;
        sp += s * p;
    }
    let determinant = gxx * gyy - gxy * gxy;
    let trace = gxx + gyy;
    let weakest = 0.5 * (trace - (trace * trace - 4.0 * determinant).max(0.0).sqrt()) / count;
    if !(weakest > CORNER_AT_LEAST && ss > 0.0 && pp > 0.0) {
        return None;
    }
    let solve = |x: f64, y: f64| {
        [
            (gyy * x - gxy * y) / determinant,
            (gxx * y - gxy * x) / determinant,
        ]
    };
    let [seen_x, seen_y] = solve(sx, sy);
    let seen_in_gradients = seen_x * sx + seen_y * sy;
    let pattern_in_gradients = seen_x * px + seen_y * py;
    let denominator = sp - pattern_in_gradients;
    // Opposite patterns have no gain that would make them alike.
    if denominator <= 0.0 {
        return None;
    }
    let gain = (ss - seen_in_gradients) / denominator;
    let shift = solve(gain * px - sx, gain * py - sy);
    Some(Step {
        shift,
        correlation: sp / (ss * pp).sqrt(),
    })
}

fn centred(values: &mut [f32]) {
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    values.iter_mut().for_each(|value| *value -= mean);
}

fn known_share(texture: &Texture, x: f64, y: f64) -> f32 {
    let (width, height) = texture.known.size();
    let half = SIDE as f64 / 2.0;
    let range = |middle: f64, length: usize| {
        ((middle - half).max(0.0) as usize).min(length)
            ..((middle + half).max(0.0) as usize).min(length)
    };
    let columns = range(x, width);
    let known: usize = range(y, height)
        .map(|y| {
            texture.known.row(y)[columns.clone()]
                .iter()
                .filter(|&&known| known)
                .count()
        })
        .sum();
    known as f32 / (SIDE * SIDE) as f32
}
