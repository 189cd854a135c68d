//! Thin things that the photograph shows and depth does not.

use super::{Finding, finding::percent, look::Look};
use rayon::prelude::*;

/// Half the width of the widest thin thing, pixels at 256×256.
const REACH: f32 = 4.0;
/// Contrast of a thin thing against both sides, in natural logarithms of light.
const CONTRAST: f32 = 0.25;
/// Step to what is behind a thin thing, as a share of its depth.
const STEP: f32 = 0.02;
/// Share of the picture with thin lines of which depth knows nothing.
const HARMFUL: f32 = 0.02;

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
    Finding::new("thin-structures", missing / HARMFUL, Some(missing), || {
        format!(
            "the photograph shows thin things of which depth knows nothing, on {} of it; go nearer or use a finer depth camera",
            percent(missing)
        )
    })
}
