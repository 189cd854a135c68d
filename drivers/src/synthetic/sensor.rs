//! Light → the numbers a camera would deliver: noise, clipping, curve, packing.

use crate::{
    chance::Chance,
    frame::{BayerPattern, Pixels, Transfer},
    jpeg::jpeg,
    plane::Plane,
};

/// Electrons at white level and base gain.
const FULL_WELL: f32 = 8000.0;
/// Electrons of read noise.
const READ_NOISE: f32 = 4.0;
/// Black level of the 12-bit mosaic.
const BAYER_BLACK: f32 = 256.0;
const BAYER_FULL: f32 = 4095.0;

/// Form in which the color camera delivers its pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelKind {
    /// 12-bit mosaic with a black level, RGGB.
    Bayer,
    /// Packed 4:2:2, sRGB curve.
    Yuyv,
    /// 4:2:0, sRGB curve.
    Nv12,
    /// JPEG of quality 92, sRGB curve.
    Mjpg,
    /// 8 bits, sRGB curve.
    Rgb8,
    /// 16 bits, linear.
    Rgb16,
    /// Floating point, linear, unclipped below.
    RgbF32,
}

impl PixelKind {
    /// Names in addresses.
    pub const NAMES: [(&'static str, Self); 7] = [
        ("bayer", Self::Bayer),
        ("yuyv", Self::Yuyv),
        ("nv12", Self::Nv12),
        ("mjpg", Self::Mjpg),
        ("rgb8", Self::Rgb8),
        ("rgb16", Self::Rgb16),
        ("rgbf32", Self::RgbF32),
    ];

    /// Curve of the numbers.
    pub fn transfer(self) -> Transfer {
        match self {
            Self::Bayer | Self::Rgb16 | Self::RgbF32 => Transfer::Linear,
            Self::Yuyv | Self::Nv12 | Self::Mjpg | Self::Rgb8 => Transfer::Srgb,
        }
    }

    /// Value of no light, as a fraction of full scale.
    pub fn black_level(self) -> f32 {
        if self == Self::Bayer {
            BAYER_BLACK / BAYER_FULL
        } else {
            0.0
        }
    }
}

/// Adds shot and read noise to light in [0, 1] at white level.
pub(super) fn noisy(light: &mut Plane<[f32; 3]>, gain: f32, scale: f32, chance: Chance) {
    if scale <= 0.0 {
        return;
    }
    let read = READ_NOISE * gain / FULL_WELL;
    for (counter, value) in (0..).zip(light.samples_mut().as_flattened_mut()) {
        let variance = value.max(0.0) * gain / FULL_WELL + read * read;
        *value += scale * variance.sqrt() * chance.normal(counter);
    }
}

/// Packs light as `kind`; light is clipped to [0, 1] except in floating point, where only the white
/// level clips.
pub(super) fn pack(light: &Plane<[f32; 3]>, kind: PixelKind) -> Pixels {
    let (width, height) = light.size();
    let encoded = || light.map(|rgb| rgb.map(srgb));
    match kind {
        PixelKind::Bayer => Pixels::Bayer {
            samples: mosaic(light),
            pattern: BayerPattern::Rggb,
        },
        PixelKind::Rgb8 => Pixels::Rgb8(bytes(&encoded())),
        PixelKind::Rgb16 => Pixels::Rgb16(
            light.map(|rgb| rgb.map(|v| (v.clamp(0.0, 1.0) * 65535.0).round() as u16)),
        ),
        PixelKind::RgbF32 => Pixels::RgbF32(light.map(|rgb| rgb.map(|v| v.min(1.0)))),
        PixelKind::Yuyv => Pixels::Yuyv {
            width,
            height,
            bytes: yuyv(&encoded()),
        },
        PixelKind::Nv12 => Pixels::Nv12 {
            width,
            height,
            bytes: nv12(&encoded()),
        },
        PixelKind::Mjpg => Pixels::Mjpg {
            width,
            height,
            bytes: jpeg(&bytes(&encoded()), 92),
        },
    }
}

/// IEC 61966-2-1, of light clipped to [0, 1].
fn srgb(light: f32) -> f32 {
    let light = light.clamp(0.0, 1.0);
    if light <= 0.003_130_8 {
        12.92 * light
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }
}

fn bytes(encoded: &Plane<[f32; 3]>) -> Plane<[u8; 3]> {
    encoded.map(|rgb| rgb.map(|v| (v * 255.0).round() as u8))
}

fn mosaic(light: &Plane<[f32; 3]>) -> Plane<u16> {
    Plane::from_fn(light.width(), light.height(), |x, y| {
        let value = light[(x, y)][[[0, 1], [1, 2]][y % 2][x % 2]];
        let code = BAYER_BLACK + value * (BAYER_FULL - BAYER_BLACK);
        let code = code.round().clamp(0.0, BAYER_FULL) as u16;
        // 12 bits spread over 16 so that full scale stays full scale.
        code << 4 | code >> 8
    })
}

/// BT.601 limited range from red, green, blue in [0, 1].
fn ycbcr([r, g, b]: [f32; 3]) -> [f32; 3] {
    [
        16.0 + 65.481 * r + 128.553 * g + 24.966 * b,
        128.0 - 37.797 * r - 74.203 * g + 112.0 * b,
        128.0 + 112.0 * r - 93.786 * g - 18.214 * b,
    ]
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

fn yuyv(encoded: &Plane<[f32; 3]>) -> Vec<u8> {
    let (pairs, _) = encoded.samples().as_chunks::<2>();
    pairs
        .iter()
        .flat_map(|[left, right]| {
            let (l, r) = (ycbcr(*left), ycbcr(*right));
            [
                byte(l[0]),
                byte((l[1] + r[1]) / 2.0),
                byte(r[0]),
                byte((l[2] + r[2]) / 2.0),
            ]
        })
        .collect()
}

fn nv12(encoded: &Plane<[f32; 3]>) -> Vec<u8> {
    let (width, height) = encoded.size();
    let yuv = encoded.map(|rgb| ycbcr(*rgb));
    let mut packed: Vec<u8> = yuv.samples().iter().map(|v| byte(v[0])).collect();
    for y in (0..height).step_by(2) {
        for x in (0..width).step_by(2) {
            let block = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|at| yuv[at]);
            packed.extend([1, 2].map(|c| byte(block.iter().map(|v| v[c]).sum::<f32>() / 4.0)));
        }
    }
    packed
}
