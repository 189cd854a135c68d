//! What moved between the frames of a shot.
//!
//! A flash only adds light: where the room alone is brighter than room and flash together, by far
//! more than noise and over a patch, something moved. Two ambient frames that disagree show it too.

use super::LinearImage;
use drivers::Plane;
use rayon::prelude::*;

/// Standard deviations under zero from which a difference is suspect.
const SUSPECT_SIGMAS: f32 = 4.0;
/// Share of the room's light a suspect difference has at least, so that edges resampled and
/// exposures known to some per cent are not called motion.
const SUSPECT_SHARE: f32 = 0.15;
/// Half the side of the patch that has to agree.
const REACH: usize = 2;
/// Share of the patch that has to be suspect.
const MAJORITY: f32 = 0.5;
/// A mask that covers more than this is no moving thing but a wrong exposure or another scene:
/// then nothing is masked, and the report's `inconsistent_fraction` tells.
const COVER_AT_MOST: f32 = 0.4;

/// Whether the room's light exceeds the flash frame's. `difference` and `room` are sums of the
/// channels, `variance` is the mean of the channels'.
pub(super) fn exceeds(difference: f32, variance: f32, room: f32) -> bool {
    -difference > SUSPECT_SHARE * room && -difference > SUSPECT_SIGMAS * (3.0 * variance).sqrt()
}

/// Whether two ambient frames disagree, once `agreement` (their common ratio) is taken out.
pub(super) fn disagree(
    first: [f32; 3],
    second: [f32; 3],
    variances: [f32; 2],
    agreement: f32,
) -> bool {
    let first: f32 = first.iter().sum();
    let second: f32 = second.iter().sum::<f32>() * agreement;
    let sigma = (3.0 * (variances[0] + agreement * agreement * variances[1])).sqrt();
    let apart = (first - second).abs();
    apart > (SUSPECT_SIGMAS + 1.0) * sigma && apart > SUSPECT_SHARE * first.max(second)
}

/// Median ratio of two ambient frames: lamps may flicker between them without anything moving.
pub(super) fn agreement(first: &LinearImage, second: &LinearImage) -> f32 {
    let stride = (first.0.len() / 20_000).max(1);
    let ratios: Vec<f32> = first
        .0
        .samples()
        .iter()
        .zip(second.0.samples())
        .step_by(stride)
        .filter_map(|(a, b)| {
            let (a, b): (f32, f32) = (a.iter().sum(), b.iter().sum());
            (a > 0.0 && b > 0.0).then(|| a / b)
        })
        .collect();
    super::report::median(ratios).unwrap_or(1.0)
}

/// Makes pixels unknown whose patch is mostly suspect; returns how many.
pub(super) fn mask(
    suspects: &Plane<u8>,
    light: &mut LinearImage,
    variance: &mut Plane<f32>,
) -> usize {
    let moved = patches(suspects);
    let count = moved.samples().par_iter().filter(|&&moved| moved).count();
    let known = light
        .0
        .samples()
        .par_iter()
        .filter(|rgb| rgb[0].is_finite())
        .count();
    if count == 0 || count as f32 > COVER_AT_MOST * known as f32 {
        return 0;
    }
    light
        .0
        .samples_mut()
        .par_iter_mut()
        .zip(variance.samples_mut())
        .zip(moved.samples())
        .map(|((light, variance), &moved)| {
            let newly = moved && light[0].is_finite();
            if moved {
                *light = [f32::NAN; 3];
                *variance = f32::NAN;
            }
            usize::from(newly)
        })
        .sum()
}

/// Pixels within a mostly suspect patch: a majority filter, then grown back by its own reach, as
/// the rim of a moving thing holds a minority of suspects.
fn patches(suspects: &Plane<u8>) -> Plane<bool> {
    let (width, height) = suspects.size();
    let side = 2 * REACH + 1;
    let needed = ((side * side) as f32 * MAJORITY) as u16;
    let core = box_sums(suspects);
    let core = core.map(|&sum| u8::from(sum > needed));
    let grown = box_sums(&core);
    let mut moved = Plane::filled(width, height, false);
    for (moved, sum) in moved.samples_mut().iter_mut().zip(grown.samples()) {
        *moved = *sum > 0;
    }
    moved
}

/// Sum over the (2·REACH+1)² patch around every pixel; outside counts zero.
fn box_sums(plane: &Plane<u8>) -> Plane<u16> {
    let (width, height) = plane.size();
    let mut sums = Plane::filled(width, height, 0u16);
    sums.samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each_init(
            || vec![0u16; width],
            |columns, (y, out)| {
                columns.fill(0);
                for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
                    for (sum, &sample) in columns.iter_mut().zip(plane.row(row)) {
                        *sum += u16::from(sample);
                    }
                }
                for (x, out) in out.iter_mut().enumerate() {
                    *out = columns[x.saturating_sub(REACH)..(x + REACH + 1).min(width)]
                        .iter()
                        .sum();
                }
            },
        );
    sums
}
