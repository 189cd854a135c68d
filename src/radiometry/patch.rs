//! One patch of texture, found again in the other picture.
//!
//! Enhanced correlation coefficient (Evangelidis & Psarakis, "Parametric image alignment using
//! enhanced correlation coefficient maximization", IEEE PAMI 2008) for a translation: it is blind
//! to gain and offset, so it asks only whether the pattern is the same.

use super::texture::Texture;
use super::warp::Warp;
use super::window::{WINDOW, sample};
use fearless_simd::{Level, Simd, dispatch};

pub(super) use super::window::SIDE;

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
    let pattern = Pattern::of(first, left, top);
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
    let pattern = Pattern::of(first, left, top);
    let seen = sample(&second.values, warp, left, top, [0.0; 2])?;
    correction(&pattern, &seen).map(|step| step.correlation)
}

/// The patch that is looked for, its mean taken out.
struct Pattern {
    values: [f32; SIDE * SIDE],
    /// Sum of the squared values.
    power: f64,
}

impl Pattern {
    fn of(texture: &Texture, left: usize, top: usize) -> Self {
        let mut values = [0.0; SIDE * SIDE];
        for (y, row) in values.chunks_exact_mut(SIDE).enumerate() {
            row.copy_from_slice(&texture.values.row(top + y)[left..left + SIDE]);
        }
        let mean = by_lanes(&values, |value| value) / values.len() as f32;
        values.iter_mut().for_each(|value| *value -= mean);
        let power = f64::from(by_lanes(&values, |value| value * value));
        Self { values, power }
    }
}

struct Step {
    shift: [f64; 2],
    correlation: f64,
}

/// Sums kept apart while a row is walked, so that they are added in vector registers.
const LANES: usize = 8;

fn eight(row: &[f32], from: usize) -> [f32; LANES] {
    let mut eight = [0.0; LANES];
    eight.copy_from_slice(&row[from..from + LANES]);
    eight
}

/// The sum of something of every value.
fn by_lanes(values: &[f32], of: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0f32; LANES];
    for values in values.chunks_exact(LANES) {
        for (sum, value) in lanes.iter_mut().zip(values) {
            *sum += of(*value);
        }
    }
    lanes.iter().sum()
}

/// Sums over the patch of the products that the step is made of. The order: gradients x and y,
/// what is seen, their six products, and the products of the pattern with all three.
#[inline(always)]
fn sums<S: Simd>(_simd: S, pattern: &Pattern, window: &[f32; WINDOW * WINDOW]) -> [f64; 12] {
    let mut sums = [0.0f64; 12];
    let rows = pattern.values.chunks_exact(SIDE).enumerate();
    for (y, pattern) in rows {
        let row = |y: usize| &window[y * WINDOW..(y + 1) * WINDOW];
        let (above, here, below) = (row(y), row(y + 1), row(y + 2));
        let mut lanes = [[0.0f32; LANES]; 12];
        for x in (0..SIDE).step_by(LANES) {
            let p = eight(pattern, x);
            let s = eight(here, x + 1);
            let (left, right) = (eight(here, x), eight(here, x + 2));
            let (up, down) = (eight(above, x + 1), eight(below, x + 1));
            for i in 0..LANES {
                let (p, s) = (p[i], s[i]);
                let (gx, gy) = (0.5 * (right[i] - left[i]), 0.5 * (down[i] - up[i]));
                lanes[0][i] += gx;
                lanes[1][i] += gy;
                lanes[2][i] += s;
                lanes[3][i] += gx * gx;
                lanes[4][i] += gx * gy;
                lanes[5][i] += gy * gy;
                lanes[6][i] += gx * s;
                lanes[7][i] += gy * s;
                lanes[8][i] += s * s;
                lanes[9][i] += gx * p;
                lanes[10][i] += gy * p;
                lanes[11][i] += s * p;
            }
        }
        for (sum, lanes) in sums.iter_mut().zip(lanes) {
            *sum += f64::from(lanes.iter().sum::<f32>());
        }
    }
    sums
}

/// The closed-form step of the paper's equation 17 for a translation.
fn correction(pattern: &Pattern, window: &[f32; WINDOW * WINDOW]) -> Option<Step> {
    let [
        x,
        y,
        s,
        mut gxx,
        mut gxy,
        mut gyy,
        mut sx,
        mut sy,
        mut ss,
        px,
        py,
        sp,
    ] = dispatch!(Level::new(), simd => sums(simd, pattern, window));
    let count = (SIDE * SIDE) as f64;
    // The means are taken out of the sums; the pattern has none.
    gxx -= x * x / count;
    gxy -= x * y / count;
    gyy -= y * y / count;
    sx -= x * s / count;
    sy -= y * s / count;
    ss -= s * s / count;
    let pp = pattern.power;
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
