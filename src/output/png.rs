//! PNG out: sRGB pictures and gray maps, with the fast compressor.

use super::{exr::EncodeError, tone::Tone};
use crate::radiometry::LinearImage;
use drivers::Plane;
use rayon::prelude::*;

/// Light → 8-bit sRGB with alpha; where light is unknown the pixel is transparent black.
///
/// # Errors
/// [`EncodeError::Png`] for a picture without pixels.
pub fn picture(light: &LinearImage, tone: &Tone) -> Result<Vec<u8>, EncodeError> {
    let plane = &light.0;
    let mut bytes = vec![0_u8; plane.len() * 4];
    let width = plane.width().max(1);
    bytes
        .par_chunks_mut(4 * width)
        .zip(plane.samples().par_chunks(width))
        .for_each(|(row, pixels)| {
            for (out, rgb) in row.chunks_exact_mut(4).zip(pixels) {
                if let Some([r, g, b]) = tone.srgb8(*rgb) {
                    out.copy_from_slice(&[r, g, b, 255]);
                }
            }
        });
    encode(
        plane.size(),
        ::png::ColorType::Rgba,
        ::png::BitDepth::Eight,
        true,
        &bytes,
    )
}

/// Fractions in [0, 1] → 8-bit gray, linear; unknown = 0.
///
/// # Errors
/// [`EncodeError::Png`] for a plane without pixels.
pub fn fraction(plane: &Plane<f32>) -> Result<Vec<u8>, EncodeError> {
    // A cast from float saturates and takes NaN to 0.
    let bytes: Vec<u8> = plane
        .samples()
        .par_iter()
        .map(|v| (v * 255.0).round() as u8)
        .collect();
    gray8(plane.size(), &bytes)
}

/// 8-bit sRGB as it stands.
///
/// # Errors
/// [`EncodeError::Png`] for a plane without pixels.
pub fn rgb8(plane: &Plane<[u8; 3]>) -> Result<Vec<u8>, EncodeError> {
    let bytes = plane.samples().as_flattened();
    encode(
        plane.size(),
        ::png::ColorType::Rgb,
        ::png::BitDepth::Eight,
        true,
        bytes,
    )
}

/// 16-bit color numbers as they stand.
///
/// # Errors
/// [`EncodeError::Png`] for a plane without pixels.
pub fn rgb16(plane: &Plane<[u16; 3]>) -> Result<Vec<u8>, EncodeError> {
    let samples = plane.samples().as_flattened();
    let bytes: Vec<u8> = samples
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .collect();
    encode(
        plane.size(),
        ::png::ColorType::Rgb,
        ::png::BitDepth::Sixteen,
        false,
        &bytes,
    )
}

/// Bits: true = 255.
///
/// # Errors
/// [`EncodeError::Png`] for a plane without pixels.
pub fn mask(plane: &Plane<bool>) -> Result<Vec<u8>, EncodeError> {
    let bytes: Vec<u8> = plane
        .samples()
        .iter()
        .map(|&set| if set { 255 } else { 0 })
        .collect();
    gray8(plane.size(), &bytes)
}

fn gray8(size: (usize, usize), bytes: &[u8]) -> Result<Vec<u8>, EncodeError> {
    encode(
        size,
        ::png::ColorType::Grayscale,
        ::png::BitDepth::Eight,
        false,
        bytes,
    )
}

fn encode(
    (width, height): (usize, usize),
    color: ::png::ColorType,
    depth: ::png::BitDepth,
    srgb: bool,
    bytes: &[u8],
) -> Result<Vec<u8>, EncodeError> {
    let side = |pixels| u32::try_from(pixels).unwrap_or(0); // 0 is refused by the encoder
    let mut file = Vec::with_capacity(bytes.len() / 2 + 1024);
    let mut encoder = ::png::Encoder::new(&mut file, side(width), side(height));
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(::png::Compression::Fast);
    if srgb {
        encoder.set_source_srgb(::png::SrgbRenderingIntent::Perceptual);
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(file)
}
