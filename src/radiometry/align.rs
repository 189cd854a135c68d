//! Alignment of an ambient frame on the flash frame, whatever the light.
//!
//! Coarse to fine: both pictures become texture that neither lamp's strength nor fall-off shows in
//! (`texture`), patches of one are found in the other to sub-pixel (`patch`), and one motion of
//! the whole picture is fitted to them robustly. At the finest level cross-validation decides how
//! rich a motion the patches support (`flow`); standing still is one of the answers, so a pair
//! that lies right is not moved.

use super::LinearImage;
use super::flow::{self, Motion};
use super::patch::{self, Match};
use super::texture::{self, Texture};
use super::warp::Warp;
use rayon::prelude::*;
use serde::Serialize;

/// What alignment came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AlignmentOutcome {
    /// There was nothing to align.
    NotNeeded,
    /// It was switched off.
    NotAsked,
    /// The pair lies on each other as well as can be told; nothing was moved.
    AlreadyAligned,
    /// The ambient frame was resampled.
    Aligned,
    /// Too few patches look the same under both lights; nothing was moved.
    TooLittleTexture,
}

/// How an ambient frame lies on a flash frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// From each pixel of the flash frame to its place in the ambient frame.
    pub warp: Warp,
    /// What it came to.
    pub outcome: AlignmentOutcome,
    /// Patches found in both frames.
    pub patches: usize,
    /// Median distance between the patches and `warp`, pixels; 0 without patches.
    pub residual_pixels: f32,
}

/// Patches placed along the longer side, at most.
const PATCHES_ALONG: usize = 24;
/// Every how many of them say which of two motions fits better.
const ASKED: usize = 3;
/// Whole pixels looked around at the coarsest level.
const COARSE_REACH: isize = 4;
/// How much better a coarse shift must correlate than none, coarsely and in the end: textures that
/// repeat lie well on themselves in more than one place.
const COARSE_GAIN: f64 = 0.05;
/// Fits at the finest level, each starting where the last ended …
const FINEST_ROUNDS: usize = 2;
/// … unless that is no further from where it started than this, pixels: patches would be found where
/// they were.
const SETTLED: f32 = 0.25;

/// What frames are aligned on.
pub(super) struct Anchor {
    size: (usize, usize),
    pyramid: Vec<Texture>,
}

impl Anchor {
    /// Of the flash frame; nothing is kept of one too small to be aligned on.
    pub fn of(flash: &LinearImage) -> Self {
        let size = flash.0.size();
        let pyramid = if size.0.min(size.1) < 2 * patch::SIDE {
            Vec::new()
        } else {
            texture::pyramid(flash)
        };
        Self { size, pyramid }
    }

    /// Finds the motion from the frame it is of to one of the same size.
    ///
    /// Serves shifts up to about a twelfth of the shorter side, and the small rotations, zooms and
    /// tilts of a hand. A moving thing that fills less than half of the textured picture is outvoted.
    pub fn align(&self, ambient: &LinearImage) -> Alignment {
        let (width, height) = self.size;
        let still = |outcome, patches, residual_pixels| Alignment {
            warp: Warp::identity(width, height),
            outcome,
            patches,
            residual_pixels,
        };
        if ambient.0.size() != (width, height) || self.pyramid.is_empty() {
            return still(AlignmentOutcome::TooLittleTexture, 0, 0.0);
        }
        let (first, second) = (&self.pyramid, texture::pyramid(ambient));
        let Some((coarse_first, coarse_second)) = first.last().zip(second.last()) else {
            return still(AlignmentOutcome::TooLittleTexture, 0, 0.0);
        };
        let (coarse_width, coarse_height) = coarse_first.values.size();
        // The finest level has rounds of its own.
        let next = usize::from(first.len() > 1);
        let (coarser_first, coarser_second) = (&first[next..], &second[next..]);
        let refined = |start| refined(coarser_first, coarser_second, start);
        let near = refined(Warp::identity(coarse_width, coarse_height));
        let mut warp = near;
        let start = whole_shift(coarse_first, coarse_second);
        if !start.is_identity() {
            let far = refined(start);
            let score = |warp: &Warp| agreement(&coarser_first[0], &coarser_second[0], warp);
            if score(&far) > score(&near) + COARSE_GAIN {
                warp = far;
            }
        }
        let (Some(first), Some(second)) = (first.first(), second.first()) else {
            return still(AlignmentOutcome::TooLittleTexture, 0, 0.0);
        };
        let (fine_width, fine_height) = first.values.size();
        warp = warp.on_grid(fine_width, fine_height);
        let mut motion = Motion::Still;
        let mut found = Vec::new();
        for _ in 0..FINEST_ROUNDS {
            let start = better_start(first, second, warp);
            found = matches(first, second, &start);
            if found.len() < flow::MATCHES_AT_LEAST {
                return still(AlignmentOutcome::TooLittleTexture, found.len(), 0.0);
            }
            (motion, warp) = flow::choose(&found, fine_width, fine_height);
            if warp.furthest_from(&start) < SETTLED {
                break;
            }
        }
        let scale = width as f32 / fine_width as f32;
        let residual_pixels = flow::residual(&found, &warp) * scale;
        let identity = Warp::identity(fine_width, fine_height);
        let gained = || agreement(first, second, &warp) > agreement(first, second, &identity);
        if motion == Motion::Still || !gained() {
            let residual_pixels = flow::residual(&found, &identity) * scale;
            return still(
                AlignmentOutcome::AlreadyAligned,
                found.len(),
                residual_pixels,
            );
        }
        Alignment {
            warp: warp.on_grid(width, height),
            outcome: AlignmentOutcome::Aligned,
            patches: found.len(),
            residual_pixels,
        }
    }
}

/// A coarse warp carried down to the finest level.
fn refined(first: &[Texture], second: &[Texture], start: Warp) -> Warp {
    first
        .iter()
        .zip(second)
        .rev()
        .fold(start, |warp, (first, second)| {
            let (width, height) = first.values.size();
            let warp = better_start(first, second, warp.on_grid(width, height));
            flow::coarse(&matches(first, second, &warp), width, height).unwrap_or(warp)
        })
}

/// Top left corners of the patches of a grid.
fn corners(width: usize, height: usize) -> Vec<[usize; 2]> {
    // One pixel of margin for gradients, one for interpolation.
    let margin = 2;
    let span = |length: usize| length.saturating_sub(patch::SIDE + 2 * margin);
    let step = (width.max(height) / PATCHES_ALONG).max(patch::SIDE / 2);
    (0..=span(height))
        .step_by(step)
        .flat_map(|y| {
            (0..=span(width))
                .step_by(step)
                .map(move |x| [x + margin, y + margin])
        })
        .filter(|&[x, y]| x + patch::SIDE <= width && y + patch::SIDE <= height)
        .collect()
}

fn matches(first: &Texture, second: &Texture, warp: &Warp) -> Vec<Match> {
    let (width, height) = first.values.size();
    corners(width, height)
        .into_par_iter()
        .filter_map(|[left, top]| patch::find(first, second, warp, left, top))
        .collect()
}

/// Mean correlation of some patches, all over the picture, under a warp; patches that leave the picture do not count.
fn agreement(first: &Texture, second: &Texture, warp: &Warp) -> f64 {
    let (width, height) = first.values.size();
    let found: Vec<f64> = corners(width, height)
        .into_par_iter()
        .step_by(ASKED)
        .filter_map(|[left, top]| patch::correlation(first, second, warp, left, top))
        .collect();
    if found.is_empty() {
        -1.0
    } else {
        found.iter().sum::<f64>() / found.len() as f64
    }
}

/// The warp, or standing still where that fits better: a wrong coarse answer must not outlive its
/// level.
fn better_start(first: &Texture, second: &Texture, warp: Warp) -> Warp {
    let (width, height) = first.values.size();
    let identity = Warp::identity(width, height);
    if warp.is_identity() || agreement(first, second, &warp) >= agreement(first, second, &identity)
    {
        warp
    } else {
        identity
    }
}

/// The shift in whole pixels under which two coarse pictures correlate best.
fn whole_shift(first: &Texture, second: &Texture) -> Warp {
    let (width, height) = first.values.size();
    let score = |dx: isize, dy: isize| {
        let [mut ab, mut aa, mut bb] = [0.0f64; 3];
        for y in dy.min(0).unsigned_abs()..height - dy.max(0).unsigned_abs() {
            let shifted = (y as isize + dy) as usize;
            for x in dx.min(0).unsigned_abs()..width - dx.max(0).unsigned_abs() {
                let a = f64::from(first.values[(x, y)]);
                let b = f64::from(second.values[((x as isize + dx) as usize, shifted)]);
                ab += a * b;
                aa += a * a;
                bb += b * b;
            }
        }
        ab / (aa * bb).sqrt().max(f64::MIN_POSITIVE)
    };
    let none = score(0, 0);
    let mut best = (none + COARSE_GAIN, 0, 0);
    for dy in -COARSE_REACH..=COARSE_REACH {
        for dx in -COARSE_REACH..=COARSE_REACH {
            let score = score(dx, dy);
            if score > best.0 {
                best = (score, dx, dy);
            }
        }
    }
    let (_, dx, dy) = best;
    Warp::new(
        width,
        height,
        [dx as f64, 0.0, 0.0, dy as f64, 0.0, 0.0, 0.0, 0.0],
    )
}
