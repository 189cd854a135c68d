//! Photographs stored as JPEG.

use super::{
    CorruptionError,
    field::upper,
    photographs::{Light, Photographs, brightest},
};
use crate::{radiometry::transfer::srgb_encode, shot::Shot};
use drivers::{ColorFrame, Exposure, Pixels, Transfer, chance::Chance, jpeg};

/// Share of the pixels of the flash photograph that reach white: glints.
const CLIPPED_PERCENT: f32 = 0.1;

/// Photographs of 8 bits and sRGB, stored as JPEG of this `quality`; their gain is set so that all
/// but glints of the flash photograph stay under white, and stated.
pub(super) fn on_shot(shot: &Shot, quality: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let light = Photographs::of(shot)?;
    let white = upper(brightest(&light.flash), CLIPPED_PERCENT).filter(|white| *white > 0.0);
    let white = white.ok_or(CorruptionError::NoLight {
        photograph: "flash",
    })?;
    let stored = |frame: &ColorFrame, light: &Light| {
        let (width, height) = light.size();
        let bytes = light.map(|rgb| rgb.map(|value| code(value / white)));
        ColorFrame {
            exposure: Exposure {
                gain: 1.0 / (white * frame.exposure.seconds),
                ..frame.exposure
            },
            pixels: Pixels::Mjpg {
                width,
                height,
                bytes: jpeg(&bytes, quality as u8),
            },
            transfer: Transfer::Srgb,
            black_level: 0.0,
            white_level: 1.0,
            ..frame.clone()
        }
    };
    let ambient = shot.ambient.iter().zip(&light.ambient);
    Ok(Shot {
        flash: stored(&shot.flash, &light.flash),
        ambient: ambient.map(|(frame, light)| stored(frame, light)).collect(),
        ..shot.clone()
    })
}

/// 8-bit sRGB; what is unknown is taken as clipped.
fn code(light: f32) -> u8 {
    if light.is_nan() {
        return 255;
    }
    (255.0 * srgb_encode(light.clamp(0.0, 1.0))).round() as u8
}
