//! Flash and ambient photograph against each other: what moved, and lamps that pulse.

use super::{
    Finding,
    finding::percent,
    look::{Look, quantile},
};
use crate::radiometry::linearise;
use drivers::Plane;
use rayon::prelude::*;

/// Side of a block that is looked for, in pixels of the halved grid at 256×256.
const BLOCK: usize = 12;
/// How far a block is looked for, the same pixels.
const REACH: isize = 8;
/// Contrast of a block, standard deviation of the light's logarithm, that can be found again.
const CONTRAST: f32 = 0.05;
/// Correlation a block found again has at least, and gains at least by its shift.
const FOUND: f32 = 0.8;
const GAINED: f32 = 0.1;
/// Blocks around a moved one, of eight, that move along at least.
const COMPANY: usize = 1;
/// Room light over the flash's from which its noise is all there is.
const HARMFUL_AMBIENT: f32 = 4.0;
/// Share of the blocks that have moved.
const HARMFUL_MOVED: f32 = 0.03;
/// Swing of the room's light from row to row, as a share of it, times its share of the flash's.
const HARMFUL_SWING: f32 = 0.04;
/// The room over the flash where the flash added nothing.
const BEYOND: f32 = 1e3;
/// Pulses during one picture that are looked for.
const PULSES: std::ops::RangeInclusive<usize> = 3..=12;

/// What the pair shows.
pub(super) struct Pair {
    moved: f32,
    swing: f32,
    /// Median of the room's light over the flash's, where there is something to light.
    room_to_flash: f32,
}

impl Pair {
    pub fn of(look: &Look<'_>) -> Self {
        let report = &look.development.flash_only.report;
        let mut pair = Self {
            moved: report.moved_fraction,
            swing: 0.0,
            room_to_flash: 0.0,
        };
        let Some(room) = look.shot.ambient.first() else {
            return pair;
        };
        let (Ok(flash), Ok(room)) = (linearise(&look.shot.flash), linearise(room)) else {
            return pair;
        };
        let (width, height) = flash.0.size();
        let stride = (width.max(height) / 128).max(1);
        let size = (width / stride, height / stride);
        let halved = |light: &Plane<[f32; 3]>| halved(light, stride, size);
        let (flash, room) = rayon::join(|| halved(&flash.0), || halved(&room.0));
        pair.room_to_flash = room_to_flash(look, &flash, &room);
        let (flash, room) = (logarithm(&flash), logarithm(&room));
        pair.swing = swing(&flash, &room);
        pair.moved = pair.moved.max(moved(&flash, &room));
        pair
    }

    /// The room outshines the flash.
    pub fn bright_ambient(&self, look: &Look<'_>) -> Finding {
        let times = self.room_to_flash;
        let unusable = look.development.flash_only.report.weak_fraction;
        Finding::new(
            "bright-ambient",
            times / HARMFUL_AMBIENT,
            Some(unusable),
            || {
                format!(
                    "ambient light {times:.0}× the flash: {} of pixels unusable; move closer or darken the room",
                    percent(unusable)
                )
            },
        )
    }

    pub fn motion(&self) -> Finding {
        Finding::new(
            "motion",
            self.moved / HARMFUL_MOVED,
            Some(self.moved),
            || {
                format!(
                    "{} of the picture moved between the frames; hold still, or take the frames closer together",
                    percent(self.moved)
                )
            },
        )
    }

    pub fn mains_flicker(&self) -> Finding {
        let harm = self.swing * self.room_to_flash.min(1.0);
        Finding::new("mains-flicker", harm / HARMFUL_SWING, None, || {
            format!(
                "the room's light pulses by {} while rows are read out; expose for whole periods of the mains or switch the lamps off",
                percent(self.swing)
            )
        })
    }
}

/// The light's mean over squares of `stride` pixels; NaN = unknown. Channels weigh differently, or surfaces
/// that differ in color alone would look alike.
fn halved(light: &Plane<[f32; 3]>, stride: usize, (width, height): (usize, usize)) -> Plane<f32> {
    let rows: Vec<Vec<f32>> = (0..height)
        .into_par_iter()
        .map(|y| {
            let mut sums = vec![0.0f32; width];
            for y in y * stride..(y + 1) * stride {
                let row = light.row(y);
                for (x, sum) in sums.iter_mut().enumerate() {
                    for rgb in &row[x * stride..(x + 1) * stride] {
                        *sum += 3.0 * rgb[0] + 2.0 * rgb[1] + rgb[2];
                    }
                }
            }
            let area = (6 * stride * stride) as f32;
            sums.iter().map(|sum| sum / area).collect()
        })
        .collect();
    Plane::new(width, height, rows.concat()).unwrap_or_default()
}

/// Logarithm of light; NaN = dark or unknown.
fn logarithm(light: &Plane<f32>) -> Plane<f32> {
    light.map(|value| if *value > 0.0 { value.ln() } else { f32::NAN })
}

/// Median of the room's light over the flash's, of what the flash lights.
fn room_to_flash(look: &Look<'_>, flash: &Plane<f32>, room: &Plane<f32>) -> f32 {
    let ((width, height), (columns, rows)) = (flash.size(), look.size());
    let ratios = (0..flash.len())
        .filter(|index| {
            let (x, y) = (index % width, index / width);
            let at = (x * columns / width, y * rows / height);
            look.light[at].is_finite() && look.metres[at].is_finite()
        })
        .map(|index| {
            // Under its own noise a dark room may seem darker than black; unknown = it clips.
            let room = room.samples()[index];
            let flash = flash.samples()[index] - room;
            if flash > 0.0 {
                room.max(0.0) / flash
            } else {
                BEYOND
            }
        });
    quantile(ratios.collect(), 0.5).unwrap_or(0.0)
}

/// Amplitude of the strongest pulse over the rows that the room's light has and the flash's frame
/// has not, as a share of the light.
fn swing(flash: &Plane<f32>, room: &Plane<f32>) -> f32 {
    let (width, height) = room.size();
    // From row to row, the median over the columns: neither texture nor outlines count.
    let rise = |plane: &Plane<f32>, y: usize| {
        let rises = (0..width)
            .map(|x| plane[(x, y + 1)] - plane[(x, y)])
            .collect();
        quantile(rises, 0.5).unwrap_or(0.0)
    };
    let mut profile = vec![0.0f32; height];
    for y in 0..height.saturating_sub(1) {
        profile[y + 1] = profile[y] + rise(room, y) - rise(flash, y);
    }
    let profile = without_trend(&profile);
    let strengths: Vec<f32> = (0..=PULSES.end() + 2)
        .map(|pulses| strength(&profile, pulses))
        .collect();
    // A pulse stands out of what is faster; how a room's light slowly changes does not.
    PULSES
        .map(|pulses| strengths[pulses] - strengths[pulses + 2])
        .fold(0.0, f32::max)
}

/// A profile less the cubic that fits it best: projections on Legendre's polynomials.
fn without_trend(profile: &[f32]) -> Vec<f32> {
    let count = profile.len() as f32;
    let place = |i: usize| (2.0 * i as f32 + 1.0) / count - 1.0;
    let legendre = |t: f32| [1.0, t, 1.5 * t * t - 0.5, (2.5 * t * t - 1.5) * t];
    let mut parts = [0.0f32; 4];
    for (i, value) in profile.iter().enumerate() {
        for (degree, (part, basis)) in parts.iter_mut().zip(legendre(place(i))).enumerate() {
            *part += value * basis * (2 * degree + 1) as f32 / count;
        }
    }
    let trend = |t: f32| -> f32 { legendre(t).iter().zip(parts).map(|(b, p)| b * p).sum() };
    (0..profile.len())
        .map(|i| profile[i] - trend(place(i)))
        .collect()
}

/// Amplitude of one frequency in a profile.
fn strength(profile: &[f32], pulses: usize) -> f32 {
    let (mut re, mut im) = (0.0, 0.0);
    for (i, value) in profile.iter().enumerate() {
        let turns = pulses as f32 * (i as f32 + 0.5) / profile.len() as f32;
        let (sin, cos) = (std::f32::consts::TAU * turns).sin_cos();
        re += value * cos;
        im += value * sin;
    }
    2.0 * re.hypot(im) / profile.len().max(1) as f32
}

/// Share of the blocks that lie elsewhere in the other picture than most do.
fn moved(flash: &Plane<f32>, room: &Plane<f32>) -> f32 {
    let (width, height) = flash.size();
    let (columns, rows) = (width / BLOCK, height / BLOCK);
    let shifts: Vec<Option<[isize; 2]>> = (0..columns * rows)
        .into_par_iter()
        .map(|block| {
            let corner = (block % columns * BLOCK, block / columns * BLOCK);
            shift_of(flash, room, corner)
        })
        .collect();
    let middle = |axis: usize| {
        let along = shifts.iter().flatten().map(|shift| shift[axis] as f32);
        quantile(along.collect(), 0.5).unwrap_or(0.0)
    };
    let (right, down) = (middle(0), middle(1));
    let strays = |shift: [isize; 2]| (shift[0] as f32 - right).hypot(shift[1] as f32 - down) > 1.0;
    let shifts = Plane::new(columns, rows, shifts).unwrap_or_default();
    let moved = (0..columns * rows)
        .filter(|block| {
            let (x, y) = (block % columns, block / columns);
            let Some(shift) = shifts[(x, y)].filter(|shift| strays(*shift)) else {
                return false;
            };
            let around = (y.saturating_sub(1)..=y + 1)
                .flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| (x, y)));
            let along = around
                .filter_map(|(x, y)| shifts.get(x, y).copied().flatten())
                .filter(|other| other[0].abs_diff(shift[0]) + other[1].abs_diff(shift[1]) <= 2)
                .count();
            // It goes along with itself.
            along > COMPANY
        })
        .count();
    moved as f32 / (columns * rows).max(1) as f32
}

/// Where a block of the first picture lies in the second; `None` where it cannot be told.
fn shift_of(
    first: &Plane<f32>,
    second: &Plane<f32>,
    (left, top): (usize, usize),
) -> Option<[isize; 2]> {
    let block = |plane: &Plane<f32>, left: isize, top: isize| -> Option<[f32; BLOCK * BLOCK]> {
        let (width, height) = plane.size();
        let (left, top) = (usize::try_from(left).ok()?, usize::try_from(top).ok()?);
        if left + BLOCK > width || top + BLOCK > height {
            return None;
        }
        let mut values = [0.0; BLOCK * BLOCK];
        for (y, row) in values.chunks_mut(BLOCK).enumerate() {
            row.copy_from_slice(&plane.row(top + y)[left..left + BLOCK]);
        }
        let mean = values.iter().sum::<f32>() / (BLOCK * BLOCK) as f32;
        values.iter_mut().for_each(|value| *value -= mean);
        let power = values.iter().map(|v| v * v).sum::<f32>().sqrt();
        // False for NaN.
        (power > CONTRAST * BLOCK as f32).then(|| values.map(|v| v / power))
    };
    let pattern = block(first, left as isize, top as isize)?;
    let correlation = |dx: isize, dy: isize| {
        let seen = block(second, left as isize + dx, top as isize + dy)?;
        Some(pattern.iter().zip(&seen).map(|(a, b)| a * b).sum::<f32>())
    };
    let none = correlation(0, 0)?;
    if none > 0.97 {
        return Some([0, 0]);
    }
    let mut best = (none + GAINED, [0, 0]);
    let mut look_at = |dx: isize, dy: isize| {
        if let Some(found) = correlation(dx, dy).filter(|found| *found > best.0) {
            best = (found, [dx, dy]);
        }
        best.1
    };
    // Coarsely, then around the best.
    let mut near = [0, 0];
    for dy in (-REACH..=REACH).step_by(2) {
        for dx in (-REACH..=REACH).step_by(2) {
            near = look_at(dx, dy);
        }
    }
    for dy in near[1] - 1..=near[1] + 1 {
        for dx in near[0] - 1..=near[0] + 1 {
            look_at(dx, dy);
        }
    }
    (best.0 > FOUND).then_some(best.1)
}
