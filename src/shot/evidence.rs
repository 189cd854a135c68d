//! Which light a frame was taken in, as its pixels tell it.
//!
//! A flash only adds light, most where things are near, so a flash frame is brighter than the
//! ambient frame beside it, and not by one factor everywhere as under flickering mains.

use super::partial::{self, Strips};
use drivers::{ColorFrame, Pixels, Plane, luma_of_jpeg};

/// Blocks across and down that a picture is summed up in.
const COLUMNS: usize = 16;
const ROWS: usize = 12;
/// Samples across and down in one block.
const SAMPLES: usize = 6;
/// Light, as a fraction of white, below which a block counts as this dark: three codes of an
/// 8-bit sRGB picture, where noise and rounding would pass for a relative change.
const DARK: f32 = 0.016;
/// A value this near the white level counts as clipped.
const CLIPPED: f32 = 0.98;
/// Light, as a fraction of white, that the brightest tenth of a flash photograph reaches; in less,
/// noise looks like structure.
const WEAK: f32 = 0.03;
/// Least part of a frame's light that is not the ambient frame's light times one factor. Measured on
/// the synthetic rig at 64×48 pixels, gain 1 and 8: mains flicker leaves up to 0.035 above [`WEAK`];
/// a flash 0.08 and more, even on a flat wall in a room that is as bright as the flash.
const UNEXPLAINED: f32 = 0.05;
/// An ambient block under this fraction of white that clips with the flash on has at least
/// quintupled, which flicker does not do.
const QUINTUPLED: f32 = 0.2;
/// Fewest blocks to judge that by.
const FEW: usize = 8;

/// A frame's light, unit exposure, on a coarse grid; +∞ = clipped, NaN = unknown.
#[derive(Debug, Clone)]
pub(super) struct Brightness {
    blocks: Vec<f32>,
    strips: Strips,
    /// Light that reaches the white level.
    white: f32,
}

/// What two frames say about each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Comparison {
    Brighter,
    NotBrighter,
    /// Brighter in a part of the rows only, as a rolling shutter shows a flash that came too late or
    /// ended too soon.
    PartlyBrighter,
    /// Nothing could be compared.
    Unclear,
}

impl Brightness {
    /// `None` when the pixels cannot be read.
    pub fn of(frame: &ColorFrame) -> Option<Self> {
        let factor = frame.exposure.factor();
        let (width, height) = frame.pixels.size();
        let (columns, rows) = (COLUMNS.min(width), ROWS.min(height));
        let decoded;
        let value: &dyn Fn(usize, usize) -> [f32; 3] = match &frame.pixels {
            Pixels::Bayer { samples, .. } => &|x, y| [quad(samples, x, y); 3],
            Pixels::Yuyv { bytes, .. } => &|x, y| [limited(bytes.get(2 * (y * width + x))); 3],
            Pixels::Nv12 { bytes, .. } => &|x, y| [limited(bytes.get(y * width + x)); 3],
            Pixels::Mjpg { bytes, .. } => {
                decoded = luma_of_jpeg(bytes, width, height)?;
                &|x, y| {
                    [decoded
                        .get(y * width + x)
                        .map_or(f32::NAN, |v| f32::from(*v) / 255.0); 3]
                }
            }
            Pixels::Rgb8(plane) => &|x, y| plane[(x, y)].map(|v| f32::from(v) / 255.0),
            Pixels::Rgb16(plane) => &|x, y| plane[(x, y)].map(|v| f32::from(v) / 65535.0),
            Pixels::RgbF32(plane) => &|x, y| plane[(x, y)],
        };
        let grid = |columns: usize, rows: usize, samples: usize| {
            let mut cells = Vec::with_capacity(columns * rows);
            for row in 0..rows {
                let ys = row * height / rows..(row + 1) * height / rows;
                for column in 0..columns {
                    let xs = column * width / columns..(column + 1) * width / columns;
                    let (mut sum, mut count, mut clipped) = (0.0, 0.0, 0.0);
                    for y in ys.clone().step_by(ys.len().div_ceil(samples).max(1)) {
                        for x in xs.clone().step_by(xs.len().div_ceil(samples).max(1)) {
                            let rgb = value(x, y);
                            if rgb.iter().any(|v| *v >= CLIPPED * frame.white_level) {
                                clipped += 1.0;
                            } else if rgb.iter().all(|v| !v.is_nan()) {
                                let range = frame.white_level - frame.black_level;
                                let light = rgb
                                    .map(|v| frame.transfer.light((v - frame.black_level) / range));
                                sum += (light[0] + light[1] + light[2]) / 3.0;
                                count += 1.0;
                            }
                        }
                    }
                    // Without any sample this is 0/0: unknown.
                    cells.push(if clipped > count {
                        f32::INFINITY
                    } else {
                        sum / count / factor
                    });
                }
            }
            cells
        };
        let blocks = grid(columns, rows, SAMPLES);
        let (across, down) = (partial::COLUMNS.min(width), partial::ROWS.min(height));
        let strips = Strips::new(across, grid(across, down, partial::SAMPLES));
        Some(Self {
            blocks,
            strips,
            white: 1.0 / factor,
        })
    }

    /// Whether this frame holds light that `ambient` lacks: in a tenth of the picture at least
    /// `rise` more, relative to `ambient`, and not by one factor everywhere.
    pub fn against(&self, ambient: &Self, rise: f32) -> Comparison {
        let dark = DARK * self.white.max(ambient.white);
        let mut rises = Vec::with_capacity(self.blocks.len());
        let mut pairs = Vec::with_capacity(self.blocks.len());
        for (lit, unlit) in self.blocks.iter().zip(&ambient.blocks) {
            // Clipped in one frame only: risen without bound, or (NaN) not to be compared.
            let relative = (lit - unlit) / unlit.max(dark);
            if relative.is_nan() {
                continue;
            }
            rises.push(relative);
            if lit.is_finite() {
                pairs.push((*lit, *unlit));
            } else if *unlit < QUINTUPLED * self.white {
                pairs.push((self.white, *unlit));
            }
        }
        if rises.is_empty() {
            return Comparison::Unclear;
        }
        if percentile(&mut rises, 90) < rise {
            return Comparison::NotBrighter;
        }
        let mut lights: Vec<f32> = pairs.iter().map(|(lit, _)| *lit).collect();
        if pairs.len() < FEW || percentile(&mut lights, 90) < WEAK * self.white {
            return Comparison::Unclear;
        }
        if unexplained(&pairs) < UNEXPLAINED {
            return Comparison::NotBrighter;
        }
        if self.strips.partly_lit(&ambient.strips, rise, dark) {
            return Comparison::PartlyBrighter;
        }
        Comparison::Brighter
    }
}

/// The part of the light in the first frame that is not the second's times one factor, in [0, 2].
/// Weighted by light, so that the noise of dark blocks counts for little.
fn unexplained(pairs: &[(f32, f32)]) -> f32 {
    let (lit, unlit) = pairs
        .iter()
        .fold((0.0, 0.0), |(l, u), pair| (l + pair.0, u + pair.1));
    let factor = lit / unlit.max(f32::MIN_POSITIVE);
    let rest: f32 = pairs.iter().map(|(l, u)| (l - factor * u).abs()).sum();
    rest / lit.max(f32::MIN_POSITIVE)
}

fn percentile(values: &mut [f32], percent: usize) -> f32 {
    let place = (values.len() - 1) * percent / 100;
    *values.select_nth_unstable_by(place, f32::total_cmp).1
}

/// Mean of the 2×2 filter quad a pixel lies in.
fn quad(samples: &Plane<u16>, x: usize, y: usize) -> f32 {
    let (x, y) = (x & !1, y & !1);
    let all = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
    let (sum, count) = all
        .iter()
        .filter_map(|(x, y)| samples.get(*x, *y))
        .fold((0.0, 0.0f32), |(sum, count), v| {
            (sum + f32::from(*v) / 65535.0, count + 1.0)
        });
    sum / count.max(1.0)
}

/// Luma of BT.601 limited range as a value in [0, 1].
fn limited(luma: Option<&u8>) -> f32 {
    luma.map_or(f32::NAN, |v| (f32::from(*v) - 16.0) / 219.0)
}
