//! Which light a frame was taken in, as its pixels tell it.
//!
//! A flash only adds light, most where things are near, so a flash frame is brighter than the
//! ambient frame beside it, and not by one factor everywhere as under flickering mains.

use drivers::{ColorFrame, Pixels, Plane, Transfer};

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
/// A relative rise that mains flicker cannot reach.
const BEYOND_FLICKER: f32 = 0.8;
/// Least spread of the rise, between its 10th and 90th percentile, that is not one factor
/// everywhere. Block means of a noisy 8-bit picture spread by under 0.02.
const SPREAD: f32 = 0.04;
/// Fewest bright blocks to judge the spread by.
const FEW: usize = 8;

/// A frame's light, unit exposure, on a coarse grid; NaN = clipped.
#[derive(Debug, Clone)]
pub(super) struct Brightness {
    blocks: Vec<f32>,
    /// [`DARK`] at this frame's exposure.
    dark: f32,
}

/// What two frames say about each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Comparison {
    Brighter,
    NotBrighter,
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
                decoded = jpeg_luma(bytes, width, height)?;
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
        let mut blocks = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            let ys = row * height / rows..(row + 1) * height / rows;
            for column in 0..columns {
                let xs = column * width / columns..(column + 1) * width / columns;
                let (mut sum, mut count, mut clipped) = (0.0, 0.0, 0.0);
                for y in ys.clone().step_by(ys.len().div_ceil(SAMPLES).max(1)) {
                    for x in xs.clone().step_by(xs.len().div_ceil(SAMPLES).max(1)) {
                        let rgb = value(x, y);
                        if rgb.iter().any(|v| !(*v < CLIPPED * frame.white_level)) {
                            clipped += 1.0;
                        } else {
                            let range = frame.white_level - frame.black_level;
                            let light = rgb
                                .map(|v| linear((v - frame.black_level) / range, &frame.transfer));
                            sum += (light[0] + light[1] + light[2]) / 3.0;
                            count += 1.0;
                        }
                    }
                }
                blocks.push(if count > clipped {
                    sum / count / factor
                } else {
                    f32::NAN
                });
            }
        }
        Some(Self {
            blocks,
            dark: DARK / factor,
        })
    }

    /// Whether this frame holds light that `ambient` lacks: in a tenth of the picture at least
    /// `rise` more, relative to `ambient`.
    pub fn against(&self, ambient: &Self, rise: f32) -> Comparison {
        let dark = self.dark.max(ambient.dark);
        let mut rises = Vec::with_capacity(self.blocks.len());
        let mut bright = Vec::with_capacity(self.blocks.len());
        for (lit, unlit) in self.blocks.iter().zip(&ambient.blocks) {
            // A block that clips only with the flash on has risen, by how much is unknown.
            let lit = if lit.is_nan() && !unlit.is_nan() {
                f32::INFINITY
            } else {
                *lit
            };
            let relative = (lit - unlit) / unlit.max(dark);
            if relative.is_nan() {
                continue;
            }
            rises.push(relative);
            if *unlit >= dark && relative.is_finite() {
                bright.push(relative);
            }
        }
        if rises.is_empty() {
            return Comparison::Unclear;
        }
        let high = percentile(&mut rises, 90);
        if high < rise {
            return Comparison::NotBrighter;
        }
        if high < BEYOND_FLICKER && bright.len() >= FEW {
            let middle = percentile(&mut bright, 50);
            let spread = percentile(&mut bright, 90) - percentile(&mut bright, 10);
            if spread < SPREAD * (1.0 + middle.max(0.0)) {
                return Comparison::NotBrighter;
            }
        }
        Comparison::Brighter
    }
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

/// Light of a value in [0, 1]. Values below black become negative light on a straight line.
fn linear(value: f32, transfer: &Transfer) -> f32 {
    match transfer {
        _ if value <= 0.0 => value,
        Transfer::Linear => value,
        Transfer::Srgb if value <= 0.04045 => value / 12.92,
        Transfer::Srgb => ((value + 0.055) / 1.055).powf(2.4),
        Transfer::Bt709 if value < 0.081 => value / 4.5,
        Transfer::Bt709 => ((value + 0.099) / 1.099).powf(1.0 / 0.45),
        Transfer::Gamma(gamma) => value.powf(*gamma),
        Transfer::Response(light) => {
            let place = (value * 255.0).round().min(255.0) as usize;
            light.get(place).copied().unwrap_or(value)
        }
    }
}

/// Luma of a JPEG whose size is what was declared; nothing is decoded otherwise.
fn jpeg_luma(bytes: &[u8], width: usize, height: usize) -> Option<Vec<u8>> {
    use zune_jpeg::{
        JpegDecoder,
        zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
    };
    let options = DecoderOptions::default()
        .set_max_width(width)
        .set_max_height(height)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().ok()?;
    if decoder.dimensions() != Some((width, height)) {
        return None;
    }
    decoder
        .decode()
        .ok()
        .filter(|luma| luma.len() == width * height)
}
