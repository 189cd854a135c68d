//! Thin things that the photograph shows and depth does not.

use super::{Finding, finding::percent, look::Look};
use drivers::Plane;
use rayon::prelude::*;

/// Half the width of the widest thin thing, pixels at 256×256.
const REACH: f32 = 4.0;
/// Contrast of a thin thing against both sides, in natural logarithms of light.
const CONTRAST: f32 = 0.25;
/// Step to what is behind a thin thing, as a share of its depth.
const STEP: f32 = 0.02;
/// Share of the picture with thin lines of which depth knows nothing.
const HARMFUL: f32 = 0.004;
/// More of them say no more: texture has lines, too.
const MOST_LINES: f32 = 1.5;
/// Half the side of the square that everything in depth holds, where it lacks what is thin; samples at
/// 256×256.
const OPENED: f32 = 3.0;
/// Share of the outlines' samples that no such square holds in a depth that lacks nothing.
const USUAL: f32 = 0.008;
/// Fewer samples beside outlines tell nothing.
const FEWEST: usize = 100;
/// Samples beside outlines that are asked, at most.
const MOST_SAMPLES: usize = 600;

/// Only every so many rows are looked at.
const EVERY: usize = 2;

#[derive(Clone, Copy, Default)]
struct Counts {
    seen: usize,
    explained: usize,
}

/// Lines in the photograph without any in depth.
pub(super) fn thin_structures(look: &Look<'_>) -> Finding {
    let (width, height) = look.size();
    let reach = ((REACH * look.side() / 256.0).round() as usize).max(1);
    let rows = reach..height.saturating_sub(reach);
    let counts = rows
        .into_par_iter()
        .step_by(EVERY)
        .with_min_len(16)
        .map(|y| {
            let mut counts = Counts::default();
            for x in reach..width.saturating_sub(reach) {
                for (a, b) in [
                    ((x - reach, y), (x + reach, y)),
                    ((x, y - reach), (x, y + reach)),
                ] {
                    let (here, a_light, b_light) =
                        (look.light[(x, y)], look.light[a], look.light[b]);
                    let (rise, fall) = (here - a_light, here - b_light);
                    let apart = (a_light - b_light).abs();
                    let line =
                        rise * fall > 0.0 && rise.abs().min(fall.abs()) > CONTRAST.max(apart);
                    if line {
                        counts.seen += 1;
                        let sides = look.metres[a].min(look.metres[b]);
                        counts.explained += usize::from(sides > look.metres[(x, y)] * (1.0 + STEP));
                    }
                }
            }
            counts
        })
        .reduce(Counts::default, |a, b| Counts {
            seen: a.seen + b.seen,
            explained: a.explained + b.explained,
        });
    let missing =
        (EVERY * (counts.seen - counts.explained)) as f32 / look.light.len().max(1) as f32;
    let score = thinless(look) * (missing / HARMFUL).min(MOST_LINES);
    Finding::new("thin-structures", score, Some(missing), || {
        format!(
            "the photograph shows thin things of which depth knows nothing, on {} of it; go nearer or use a finer depth camera",
            percent(missing)
        )
    })
}

/// How surely depth lacks all that is thin: 1 where everything that stands before something else
/// is at least a square wide, 0 where as much as usual is not.
fn thinless(look: &Look<'_>) -> f32 {
    let depth = match look.shot.rig.depth {
        None => &look.metres,
        Some(_) => &look.shot.depth.metres,
    };
    let (width, height) = depth.size();
    let scale = (depth.len() as f32).sqrt() / 256.0;
    let reach = ((OPENED * scale).round() as usize).max(1);
    let window = |at: usize, end: usize| at.saturating_sub(reach)..(at + reach + 1).min(end);
    let back = farthest(depth, reach);
    let beside: Vec<(usize, usize)> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .filter(|&at| back[at] > depth[at] * (1.0 + 2.0 * STEP))
        .collect();
    let step = beside.len().div_ceil(MOST_SAMPLES).max(1);
    let asked = beside.len().div_ceil(step);
    let thin = beside
        .par_iter()
        .step_by(step)
        .filter(|&&(x, y)| {
            // Of all squares that hold the sample, the one whose back is nearest.
            let nearest = window(y, height)
                .flat_map(|y| back.row(y)[window(x, width)].iter())
                .fold(f32::NAN, |a, b| a.min(*b));
            nearest > depth[(x, y)] * (1.0 + STEP)
        })
        .count();
    if beside.len() < FEWEST {
        return 0.0;
    }
    (1.0 - thin as f32 / (USUAL * asked as f32)).max(0.0)
}

/// The largest known depth of the square that reaches so many samples to each side.
fn farthest(depth: &Plane<f32>, reach: usize) -> Plane<f32> {
    let (width, height) = depth.size();
    let mut across = depth.clone();
    across
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .zip(depth.samples().par_chunks(width.max(1)))
        .with_min_len(16)
        .for_each(|(out, row)| {
            for apart in 1..=reach.min(width.saturating_sub(1)) {
                raise(&mut out[apart..], row);
                raise(out, &row[apart..]);
            }
        });
    let mut both = across.clone();
    both.samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .with_min_len(16)
        .for_each(|(y, out)| {
            for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                raise(out, across.row(row));
            }
        });
    both
}

/// Raises values to those of another row; NaN never wins.
fn raise(out: &mut [f32], row: &[f32]) {
    for (out, value) in out.iter_mut().zip(row) {
        *out = out.max(*value);
    }
}
