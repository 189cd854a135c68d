//! How sharp the photograph's own edges are, direction by direction.

use super::{
    Finding,
    look::{Look, quantile},
    steps::Steps,
};
use rayon::prelude::*;

/// Contrast of an edge that tells, in natural logarithms, over its full width.
const CONTRAST: f32 = 0.3;
/// Half the width over which an edge's contrast is taken, pixels at 256×256.
const REACH: f32 = 5.0;
/// Of the edges of a direction, the share that are blurred where something else blurs them.
const SHARPEST: f32 = 0.85;
/// Only every so many rows are looked at.
const EVERY: usize = 4;
/// Fewer edges of a direction tell nothing.
const FEWEST: usize = 40;
/// How far apart the photographs of a shot lie, pixels at 256×256: alignment can take that out.
const HARMFUL_APART: f32 = 5.0;
/// What the sharpest edges are wider than one pixel, pixels at 256×256, that does harm.
const HARMFUL_WIDTH: f32 = 1.5;

/// Edges smeared along the way of a moving hand, and a pair that lies apart.
pub(super) fn hand_shake(look: &Look<'_>, steps: &Steps) -> Finding {
    let pixel = look.side() / 256.0;
    let widths: Vec<f32> = [(1, 0), (0, 1), (1, 1), (1, -1)]
        .into_par_iter()
        .filter_map(|direction| edge_width(look, direction))
        .collect();
    // One thing without its outline may be smooth all over.
    let widths = if look.shot.mask.is_some() && !steps.outline(look) {
        Vec::new()
    } else {
        widths
    };
    let widest = widths.iter().copied().fold(1.0, f32::max);
    let [right, down] = look.development.flash_only.report.shift_pixels;
    let apart = right.hypot(down) / (look.photograph_pixels() * pixel);
    let smeared = (widest - 1.0) / (HARMFUL_WIDTH * pixel);
    let apart_score = apart / HARMFUL_APART;
    Finding::new("hand-shake", smeared.max(apart_score), None, || {
        let seen = if smeared > apart_score {
            let wide = widest * look.photograph_pixels();
            format!("even the sharpest edges of one direction are {wide:.0} pixels wide")
        } else {
            let lie = right.hypot(down);
            format!("the photographs with and without flash lie {lie:.0} pixels apart")
        };
        format!("{seen}: the camera moved; hold it against something or expose shorter")
    })
}

/// Width in pixels of the sharpest edges that run across a direction; `None` where there are few.
fn edge_width(look: &Look<'_>, (dx, dy): (isize, isize)) -> Option<f32> {
    let (width, height) = look.size();
    let length = ((dx * dx + dy * dy) as f32).sqrt();
    let reach = ((REACH * look.side() / 256.0 / length).round() as isize).max(2);
    let widths: Vec<f32> = (reach as usize..height.saturating_sub(reach as usize))
        .into_par_iter()
        .step_by(EVERY)
        .with_min_len(16)
        .flat_map_iter(|y| {
            (reach..width as isize - reach).filter_map(move |x| {
                let at = |steps: isize| {
                    look.light[(
                        (x + steps * dx) as usize,
                        (y as isize + steps * dy) as usize,
                    )]
                };
                let whole = (at(reach) - at(-reach)).abs();
                if whole.is_nan() || whole <= CONTRAST {
                    return None;
                }
                let slope = (at(1) - at(0)).abs();
                // A peak of the slope; false for NaN.
                let peak = slope >= (at(2) - at(1)).abs() && slope > (at(0) - at(-1)).abs();
                peak.then(|| (whole / slope).max(1.0) * length)
            })
        })
        .collect();
    if widths.len() < FEWEST {
        return None;
    }
    quantile(widths, 1.0 - SHARPEST)
}
