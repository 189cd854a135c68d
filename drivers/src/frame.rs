//! What a device delivers: color and depth frames with their time, light and exposure.

use crate::{jpeg::luma_of_jpeg, plane::Plane};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Nanoseconds on `CLOCK_MONOTONIC` at which the first row of a frame starts to expose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Timestamp(u64);

impl Timestamp {
    /// A moment `nanoseconds` after the clock's zero.
    pub const fn from_nanos(nanoseconds: u64) -> Self {
        Self(nanoseconds)
    }

    /// Nanoseconds since the clock's zero.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// This moment.
    pub fn now() -> Self {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        // The clock starts at 0 with the machine, so neither part is ever negative.
        Self(now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64)
    }

    /// This moment moved earlier; stops at the clock's zero.
    #[must_use]
    pub fn before(self, lead: Duration) -> Self {
        Self(
            self.0
                .saturating_sub(u64::try_from(lead.as_nanos()).unwrap_or(u64::MAX)),
        )
    }

    /// How long after `earlier` this moment is; zero when it is not.
    pub fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// This moment moved later; stops at the end of the clock.
    #[must_use]
    pub fn after(self, delay: Duration) -> Self {
        Self(
            self.0
                .saturating_add(u64::try_from(delay.as_nanos()).unwrap_or(u64::MAX)),
        )
    }

    /// How far two moments lie apart, whichever comes first.
    pub fn distance(self, other: Self) -> Duration {
        Duration::from_nanos(self.0.abs_diff(other.0))
    }
}

/// Which light the frame was taken in. A frame of unknown light never passes the door.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Illumination {
    /// The room's light alone.
    Ambient,
    /// The room's light and the flash.
    Flash,
}

/// Exposure the device *granted* (never what was asked for).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exposure {
    /// Time the sensor was open, in seconds; > 0.
    pub seconds: f32,
    /// Total linear gain, 1 = base; > 0.
    pub gain: f32,
}

impl Exposure {
    /// One second at base gain: dividing by it changes nothing.
    pub const UNIT: Self = Self {
        seconds: 1.0,
        gain: 1.0,
    };

    /// `seconds · gain`, the factor between scene-linear light and pixel values.
    pub fn factor(self) -> f32 {
        self.seconds * self.gain
    }
}

/// Order of the color filters in the top-left 2×2 pixels, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum BayerPattern {
    Rggb,
    Grbg,
    Gbrg,
    Bggr,
}

/// How pixel values relate to light; the value is `encode(light)` with light and value in [0, 1].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Transfer {
    /// Value = light.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// ITU-R BT.709 camera curve.
    Bt709,
    /// Value = light^(1/gamma).
    Gamma(f32),
    /// A measured response: light in [0, 1] at 256 evenly spaced values, non-decreasing.
    Response(Vec<f32>),
}

impl Transfer {
    /// Light of a value in [0, 1]. Values below black become negative light on a straight line.
    pub fn light(&self, value: f32) -> f32 {
        match self {
            _ if value <= 0.0 => value,
            Self::Linear => value,
            Self::Srgb if value <= 0.04045 => value / 12.92,
            Self::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            Self::Bt709 if value < 0.081 => value / 4.5,
            Self::Bt709 => ((value + 0.099) / 1.099).powf(1.0 / 0.45),
            Self::Gamma(gamma) => value.powf(*gamma),
            Self::Response(light) => {
                let place = (value * 255.0).round().min(255.0) as usize;
                light.get(place).copied().unwrap_or(value)
            }
        }
    }
}

/// The samples of a color frame as the device delivered them.
#[derive(Debug, Clone, PartialEq)]
pub enum Pixels {
    /// Raw sensor samples, one color per pixel, linear between the two levels.
    Bayer {
        /// Raw numbers, full scale 65535 whatever the sensor's depth.
        samples: Plane<u16>,
        /// Filter order.
        pattern: BayerPattern,
    },
    /// Packed `Y0 U Y1 V`, BT.601 limited range, `2 · width` bytes per row; even width.
    Yuyv {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// `2 · width · height` bytes.
        bytes: Vec<u8>,
    },
    /// A full plane of Y, then one of interleaved U and V at half size, BT.601 limited range; even sizes.
    Nv12 {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// `width · height · 3 / 2` bytes.
        bytes: Vec<u8>,
    },
    /// One JPEG picture.
    Mjpg {
        /// Declared pixels per row; the JPEG must agree.
        width: usize,
        /// Declared rows; the JPEG must agree.
        height: usize,
        /// The JPEG file.
        bytes: Vec<u8>,
    },
    /// 8-bit red, green, blue.
    Rgb8(Plane<[u8; 3]>),
    /// 16-bit red, green, blue, full scale 65535.
    Rgb16(Plane<[u16; 3]>),
    /// Floating point red, green, blue; full scale 1. NaN = unknown.
    RgbF32(Plane<[f32; 3]>),
}

impl Pixels {
    /// `(width, height)` in pixels.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Bayer { samples, .. } => samples.size(),
            Self::Yuyv { width, height, .. }
            | Self::Nv12 { width, height, .. }
            | Self::Mjpg { width, height, .. } => (*width, *height),
            Self::Rgb8(plane) => plane.size(),
            Self::Rgb16(plane) => plane.size(),
            Self::RgbF32(plane) => plane.size(),
        }
    }
}

/// One picture of the color camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorFrame {
    /// When its first row started to expose.
    pub at: Timestamp,
    /// The device's own count of frames; gaps are frames the device lost.
    pub sequence: u64,
    /// The light it was taken in, as the device's metadata proves it.
    pub light: Illumination,
    /// Exposure granted.
    pub exposure: Exposure,
    /// The picture.
    pub pixels: Pixels,
    /// How `pixels` relate to light.
    pub transfer: Transfer,
    /// Value of no light, as a fraction of full scale; in [0, 1).
    pub black_level: f32,
    /// Value at which the sensor clips, as a fraction of full scale; in (black, 1]. Floating-point
    /// pixels with 1 here are not clipped at all.
    pub white_level: f32,
}

/// Samples across and down that [`ColorFrame::sampled_light`] takes.
const SAMPLES: usize = 128;

impl ColorFrame {
    /// Light of some 16 000 samples spread over the picture, as fractions of white, at most 1: of the
    /// brightest channel, or of luma. JPEG pictures are decoded for it; `None` for one that is not what
    /// the frame says.
    pub fn sampled_light(&self) -> Option<Vec<f32>> {
        let (width, height) = self.pixels.size();
        let limited = |luma: u8| (f32::from(luma) - 16.0) / 219.0;
        let decoded;
        let value: &dyn Fn(usize, usize) -> f32 = match &self.pixels {
            Pixels::Bayer { samples, .. } => &|x, y| f32::from(samples[(x, y)]) / 65535.0,
            Pixels::Yuyv { bytes, .. } => &|x, y| limited(bytes[2 * (y * width + x)]),
            Pixels::Nv12 { bytes, .. } => &|x, y| limited(bytes[y * width + x]),
            Pixels::Rgb8(plane) => &|x, y| f32::from(brightest(plane[(x, y)])) / 255.0,
            Pixels::Rgb16(plane) => &|x, y| f32::from(brightest(plane[(x, y)])) / 65535.0,
            Pixels::RgbF32(plane) => &|x, y| plane[(x, y)].into_iter().fold(0.0, f32::max),
            Pixels::Mjpg { bytes, .. } => {
                decoded = luma_of_jpeg(bytes, width, height)?;
                &|x, y| f32::from(decoded[y * width + x]) / 255.0
            }
        };
        // An odd step visits all four filters of a Bayer picture.
        let step = |side: usize| (side / SAMPLES) | 1;
        let range = self.white_level - self.black_level;
        let light = (0..height)
            .step_by(step(height))
            .flat_map(|y| (0..width).step_by(step(width)).map(move |x| (x, y)))
            .map(|(x, y)| {
                let value = ((value(x, y) - self.black_level) / range).min(1.0);
                self.transfer.light(value)
            });
        Some(light.collect())
    }
}

fn brightest<T: Ord + Copy>(rgb: [T; 3]) -> T {
    rgb[0].max(rgb[1]).max(rgb[2])
}

/// One picture of the Time-of-Flight camera; all planes share one size.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthFrame {
    /// When it started to expose.
    pub at: Timestamp,
    /// The device's own count of frames.
    pub sequence: u64,
    /// Distance along z in metres; NaN = no answer.
    pub metres: Plane<f32>,
    /// Active infrared, in the device's own linear units, ≥ 0.
    pub amplitude: Option<Plane<f32>>,
    /// Standard deviation of `metres`, in metres, where the device states it; NaN = not stated.
    pub sigma: Option<Plane<f32>>,
}

/// Anything a stream delivers.
#[derive(Debug, Clone, PartialEq)]
pub enum Frame {
    /// From the color camera.
    Color(ColorFrame),
    /// From the depth camera.
    Depth(DepthFrame),
}

impl Frame {
    /// When it started to expose.
    pub fn at(&self) -> Timestamp {
        match self {
            Self::Color(frame) => frame.at,
            Self::Depth(frame) => frame.at,
        }
    }

    /// The camera's own count of frames.
    pub fn sequence(&self) -> u64 {
        match self {
            Self::Color(frame) => frame.sequence,
            Self::Depth(frame) => frame.sequence,
        }
    }
}
