//! Scene-linear light → display sRGB: which light becomes white.

use crate::radiometry::transfer::srgb_encode;
use drivers::Plane;

/// Steps of the encoding table; at sRGB's steepest (12.92) one step is 0.05 of an 8-bit code.
const TABLE: usize = 1 << 16;
/// At most this many pixels are looked at for a robust scale.
const SAMPLED: usize = 200_000;
/// Fraction of the pixels that stay below white with a robust scale.
const ROBUST_QUANTILE: f64 = 0.99;

/// The exposure and encoding of a displayed picture.
#[derive(Debug, Clone)]
pub struct Tone {
    white: f32,
    table: Vec<u8>,
}

impl Tone {
    /// `white` is the light that becomes sRGB white; anything but a positive number counts as 1.
    pub fn new(white: f32) -> Self {
        let white = if white.is_finite() && white > 0.0 {
            white
        } else {
            1.0
        };
        let table = (0..TABLE)
            .map(|step| (srgb_encode(step as f32 / (TABLE - 1) as f32) * 255.0).round() as u8)
            .collect();
        Self { white, table }
    }

    /// Scene-linear 1.0, a white Lambertian facing the lamp, becomes white: right wherever the
    /// scale is known.
    pub fn absolute() -> Self {
        Self::new(1.0)
    }

    /// For pictures right up to one global scale: the light that 99 % of all known pixels of all
    /// `images` together stay below (brightest of three channels) becomes white. One scale for all
    /// of them, so that they can be compared.
    pub fn robust<'a>(images: impl IntoIterator<Item = &'a Plane<[f32; 3]>>) -> Self {
        let images: Vec<&Plane<[f32; 3]>> = images.into_iter().collect();
        let pixels: usize = images.iter().map(|image| image.len()).sum();
        let stride = pixels.div_ceil(SAMPLED).max(1);
        let mut brightest: Vec<f32> = images
            .iter()
            .flat_map(|image| image.samples().iter().step_by(stride))
            .map(|rgb| rgb[0].max(rgb[1]).max(rgb[2]))
            .filter(|value| value.is_finite())
            .collect();
        if brightest.is_empty() {
            return Self::absolute();
        }
        let at = ((brightest.len() - 1) as f64 * ROBUST_QUANTILE) as usize;
        let (_, white, _) = brightest.select_nth_unstable_by(at, f32::total_cmp);
        Self::new(*white)
    }

    /// The light that becomes white.
    pub fn white(&self) -> f32 {
        self.white
    }

    /// 8-bit sRGB of one pixel; `None` where light is unknown.
    pub fn srgb8(&self, rgb: [f32; 3]) -> Option<[u8; 3]> {
        if rgb.iter().any(|value| value.is_nan()) {
            return None;
        }
        let scale = (TABLE - 1) as f32 / self.white;
        // A cast from float saturates, so light outside [0, 1] clips.
        Some(rgb.map(|value| {
            let step = ((value * scale + 0.5) as usize).min(TABLE - 1);
            self.table[step]
        }))
    }
}
