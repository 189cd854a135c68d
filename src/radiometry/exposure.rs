//! The ratio of two exposures, from the pictures alone.

use super::LinearImage;
use super::warp::Warp;
use drivers::Plane;

/// Pixels along the side of a block that is compared as one.
const BLOCK: usize = 8;
/// Share of blocks let below the ratio: what shadows of the flash, noise and misfits may be.
const LOW_SHARE: f32 = 0.05;
/// Blocks needed for an answer.
const BLOCKS_AT_LEAST: usize = 50;

/// Factor that takes the ambient frame's light to the flash frame's exposure.
///
/// The flash only adds light, so `flash / ambient ≥ k` everywhere, and `= k` where the flash does
/// not reach (far background, shadows of the flash). `k` is the fifth percentile of the ratio over
/// blocks of 8×8 pixels, dark blocks left out. It is an upper bound: in a picture the flash reaches
/// everywhere, `k` comes out too high and the flash-only light too dark.
///
/// `None` when fewer than 50 blocks are known and lit.
pub fn ratio(flash: &LinearImage, ambient: &LinearImage, warp: &Warp) -> Option<f32> {
    let flash = blocks(flash, None);
    let ambient = blocks(ambient, Some(warp));
    let mut lit: Vec<f32> = ambient
        .iter()
        .copied()
        .filter(|light| light.is_finite())
        .collect();
    if lit.len() < BLOCKS_AT_LEAST {
        return None;
    }
    let upper = lit.len() * 3 / 4;
    let (_, bright, _) = lit.select_nth_unstable_by(upper, f32::total_cmp);
    // In darker blocks black level and flare decide the ratio.
    let floor = 0.1 * *bright;
    let mut ratios: Vec<f32> = flash
        .iter()
        .zip(&ambient)
        .filter(|(flash, ambient)| **ambient > floor && flash.is_finite())
        .map(|(flash, ambient)| flash / ambient)
        .collect();
    if floor <= 0.0 || ratios.len() < BLOCKS_AT_LEAST {
        return None;
    }
    let low = (ratios.len() as f32 * LOW_SHARE) as usize;
    let (_, ratio, _) = ratios.select_nth_unstable_by(low, f32::total_cmp);
    (*ratio > 0.0).then_some(*ratio)
}

/// Mean of the channels' sum over each block, NaN where a pixel is unknown. Blocks follow the
/// warp by whole pixels, which is fine at their size.
fn blocks(image: &LinearImage, warp: Option<&Warp>) -> Vec<f32> {
    let (width, height) = image.0.size();
    let grid = Plane::from_fn(width / BLOCK, height / BLOCK, |column, row| {
        let (left, top) = (column * BLOCK, row * BLOCK);
        let [dx, dy] = warp.map_or([0.0; 2], |warp| {
            let middle = (BLOCK - 1) as f64 / 2.0;
            warp.displacement(left as f64 + middle, top as f64 + middle)
        });
        let (left, top) = (
            left as isize + dx.round() as isize,
            top as isize + dy.round() as isize,
        );
        let (Ok(left), Ok(top)) = (usize::try_from(left), usize::try_from(top)) else {
            return f32::NAN;
        };
        if left + BLOCK > width || top + BLOCK > height {
            return f32::NAN;
        }
        let sum: f32 = (top..top + BLOCK)
            .flat_map(|y| &image.0.row(y)[left..left + BLOCK])
            .map(|rgb| rgb[0] + rgb[1] + rgb[2])
            .sum();
        sum / (BLOCK * BLOCK) as f32
    });
    grid.into_samples()
}
