//! Blocks of 8×8 pixels, as compression leaves them.

use super::{Finding, look::Look};
use rayon::prelude::*;

/// Rows, and columns, looked at.
const LINES: usize = 64;
/// How much more often a jump stands at the border of a block than elsewhere.
const HARMFUL_EXCESS: f32 = 0.9;

/// Jumps counted by their place within 8 pixels.
type Counts = [u32; 8];

/// How much more often the light jumps between blocks than within them.
pub(super) fn jpeg(look: &Look<'_>) -> Finding {
    let light = &look.development.flash_only.light.0;
    let (width, height) = light.size();
    let green = |x: usize, y: usize| light[(x, y)][1];
    let lines = |count: usize| (0..count).into_par_iter().step_by((count / LINES).max(1));
    let sum = |a: Counts, b: Counts| std::array::from_fn(|i| a[i] + b[i]);
    let across = lines(height)
        .map(|y| jumps(width, |x| green(x, y)))
        .reduce(Counts::default, sum);
    let down = lines(width)
        .map(|x| jumps(height, |y| green(x, y)))
        .reduce(Counts::default, sum);
    let excess = 0.5 * (excess(across) + excess(down));
    Finding::new("jpeg", excess / HARMFUL_EXCESS, None, || {
        "the photograph shows the blocks of strong compression; set a higher quality or store raw"
            .into()
    })
}

/// Where along a line the difference of neighbours is larger than both beside it.
fn jumps(length: usize, light: impl Fn(usize) -> f32) -> Counts {
    let mut counts = Counts::default();
    let step = |x: usize| (light(x + 1) - light(x)).abs();
    if length < 4 {
        return counts;
    }
    let (mut before, mut here) = (step(0), step(1));
    for x in 1..length - 2 {
        let after = step(x + 1);
        // False for NaN.
        if here > before && here > after {
            counts[x % 8] += 1;
        }
        (before, here) = (here, after);
    }
    counts
}

/// The most frequent place against the mean of the others.
fn excess(counts: Counts) -> f32 {
    let total: u32 = counts.iter().sum();
    let most = counts.iter().copied().max().unwrap_or(0);
    let others = (total - most) as f32 / 7.0;
    if others < 10.0 {
        return 0.0;
    }
    // The largest of eight counts lies some two standard deviations above their mean by chance.
    (most as f32 - 2.0 * (most as f32).sqrt()) / others - 1.0
}
