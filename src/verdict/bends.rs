//! Flat surfaces that depth bends, as infrared does that comes over a second surface.

use super::{Finding, finding::percent, look::Look, steps::Steps};
use rayon::prelude::*;

/// Distance across which a surface is asked how much it bends, pixels at 256×256.
const APART_PIXELS: f32 = 8.0;
/// Only every so many rows and columns are looked at.
const EVERY: usize = 2;
/// Second difference of inverse depth, as a share of it, of what is flat at most …
const FLAT: f32 = 3e-5;
/// … of what hardly bends …
const HARDLY: f32 = 1e-3;
/// … and of what is round.
const ROUND: f32 = 1e-2;
/// Share of the picture that hardly bends, beyond what round things explain.
const HARMFUL: f32 = 0.08;

/// Samples by how much depth bends around them.
#[derive(Debug, Clone, Copy, Default)]
struct Bends {
    hardly: usize,
    round: usize,
    all: usize,
}

/// Light that reaches corners over other surfaces makes them deeper and bends what is flat. Walls and
/// floors do not bend at all and things bend much; where much of a picture hardly bends, it was flat.
/// Told only of depth quieter than that (1 ‰ of its distance); where nothing is flat it cannot be told.
pub(super) fn multipath(look: &Look<'_>, steps: &Steps) -> Finding {
    let (width, height) = look.size();
    let apart = ((APART_PIXELS * look.side() / 256.0).round() as usize).max(1);
    let bends = (apart..height.saturating_sub(apart))
        .into_par_iter()
        .step_by(EVERY)
        .with_min_len(16)
        .map(|y| {
            let mut bends = Bends::default();
            for x in (apart..width.saturating_sub(apart)).step_by(EVERY) {
                let near = |x: usize, y: usize| look.metres[(x, y)].recip();
                let here = near(x, y);
                let across = near(x - apart, y) + near(x + apart, y) - 2.0 * here;
                let down = near(x, y - apart) + near(x, y + apart) - 2.0 * here;
                let bend = (across.abs().max(down.abs())) / here;
                bends.all += 1;
                bends.hardly += usize::from(bend > FLAT && bend <= HARDLY);
                bends.round += usize::from(bend > HARDLY && bend <= ROUND);
            }
            bends
        })
        .reduce(Bends::default, |a, b| Bends {
            hardly: a.hardly + b.hardly,
            round: a.round + b.round,
            all: a.all + b.all,
        });
    // Of round things, as many bend by so much as by any other amount of the same span.
    let of_round = bends.round as f32 * HARDLY / (ROUND - HARDLY);
    // One thing cut out of its picture stands in no corner.
    let alone = look.shot.mask.is_some() && !steps.outline(look);
    let bent = if alone {
        0.0
    } else {
        (bends.hardly as f32 - of_round) / bends.all.max(1) as f32
    };
    Finding::new(
        "multipath",
        (bent / HARMFUL).max(0.0),
        Some(bent.max(0.0)),
        || {
            format!(
                "{} of the picture is nearly but not quite flat: infrared reaches it over other surfaces and makes corners deeper; keep bright walls out of the picture's sides or use a higher modulation frequency",
                percent(bent)
            )
        },
    )
}
