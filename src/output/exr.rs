//! OpenEXR out: scan lines, ZIP, blocks compressed in parallel a batch at a time.
//!
//! Half floats carry 11 bits (an error of at most 1 part in 2048), far below what a photograph
//! resolves; [`Precision::for_light`] takes them where the values fit their range and full floats
//! elsewhere. Distances are always full floats.

use ::exr::{
    block::{UncompressedBlock, enumerate_ordered_header_block_indices, writer::ChunksWriter as _},
    meta::{
        BlockDescription,
        attribute::{ChannelDescription, LineOrder, SampleType, Text},
        header::Header,
    },
    prelude::{Compression, SmallVec},
};
use drivers::Plane;
use rayon::prelude::*;
use std::io::Cursor;
use thiserror::Error;

/// Blocks of 16 rows held uncompressed at once.
const BATCH: usize = 16;
/// Largest half float.
const HALF_MAX: f32 = 65_504.0;
/// Pictures darker than this would fall among the half floats with fewer bits.
const HALF_DARKEST: f32 = 1.0 / 64.0;

/// An image that cannot be encoded.
#[derive(Debug, Error)]
pub enum EncodeError {
    /// The EXR encoder refused.
    #[error("OpenEXR: {0}; a picture needs at least one pixel")]
    Exr(String),
    /// The PNG encoder refused.
    #[error("PNG: {0}; a picture needs at least one pixel")]
    Png(#[from] ::png::EncodingError),
}

/// Bits per sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// 16-bit floats: 11 significant bits, up to 65504.
    Half,
    /// 32-bit floats.
    Float,
}

impl Precision {
    /// Half floats where the picture's brightest value lies within their comfortable range.
    pub fn for_light(light: &Plane<[f32; 3]>) -> Self {
        let brightest = light
            .samples()
            .par_iter()
            .map(|rgb| {
                rgb.iter()
                    .fold(0.0_f32, |most, value| most.max(value.abs()))
            })
            .reduce(|| 0.0, f32::max);
        if brightest <= HALF_MAX && (brightest >= HALF_DARKEST || brightest == 0.0) {
            Self::Half
        } else {
            Self::Float
        }
    }
}

/// Red, green, blue → one EXR file's bytes; NaN stays NaN.
///
/// # Errors
/// [`EncodeError::Exr`] for a plane without pixels.
pub fn rgb(plane: &Plane<[f32; 3]>, precision: Precision) -> Result<Vec<u8>, EncodeError> {
    // Channels stand in alphabetical order in the file.
    encode(plane, &["B", "G", "R"], precision, |pixel, channel| {
        pixel[2 - channel]
    })
}

/// One channel, named Y → one EXR file's bytes; NaN stays NaN.
///
/// # Errors
/// [`EncodeError::Exr`] for a plane without pixels.
pub fn gray(plane: &Plane<f32>, precision: Precision) -> Result<Vec<u8>, EncodeError> {
    encode(plane, &["Y"], precision, |pixel, _| *pixel)
}

/// Several named channels, which stand in alphabetical order → one EXR file's bytes; NaN stays NaN.
///
/// # Errors
/// [`EncodeError::Exr`] for a plane without pixels.
pub fn layers<const N: usize>(
    plane: &Plane<[f32; N]>,
    channels: &[&'static str; N],
    precision: Precision,
) -> Result<Vec<u8>, EncodeError> {
    encode(plane, channels, precision, |pixel, channel| pixel[channel])
}

fn encode<T: Sync>(
    plane: &Plane<T>,
    channels: &[&'static str],
    precision: Precision,
    sample: impl Fn(&T, usize) -> f32 + Sync,
) -> Result<Vec<u8>, EncodeError> {
    let refused = |error: ::exr::error::Error| EncodeError::Exr(error.to_string());
    if plane.is_empty() {
        return Err(EncodeError::Exr("no pixels".into()));
    }
    let (kind, bytes) = match precision {
        Precision::Half => (SampleType::F16, 2),
        Precision::Float => (SampleType::F32, 4),
    };
    let list: SmallVec<[ChannelDescription; 5]> = channels
        .iter()
        .map(|name| ChannelDescription::named(*name, kind))
        .collect();
    let mut header = Header::new(Text::from("captured"), plane.size(), list).with_encoding(
        Compression::ZIP16,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    // A single part needs no name, and some readers show it as a layer.
    header.own_attributes.layer_name = None;

    let mut file = Cursor::new(Vec::with_capacity(plane.len() * channels.len() * bytes / 2));
    let headers = SmallVec::from_iter([header]);
    ::exr::block::write(&mut file, headers, true, |meta, writer| {
        let indices: Vec<_> = enumerate_ordered_header_block_indices(&meta.headers).collect();
        for batch in indices.chunks(BATCH) {
            let chunks = batch
                .par_iter()
                .map(|&(index, block)| {
                    let (x, y) = (block.pixel_position.0, block.pixel_position.1);
                    let (width, height) = (block.pixel_size.0, block.pixel_size.1);
                    let mut data = Vec::with_capacity(width * height * channels.len() * bytes);
                    for row in y..y + height {
                        let pixels = &plane.row(row)[x..x + width];
                        for channel in 0..channels.len() {
                            let values = pixels.iter().map(|pixel| sample(pixel, channel));
                            match precision {
                                Precision::Half => data.extend(
                                    values.flat_map(|v| half::f16::from_f32(v).to_ne_bytes()),
                                ),
                                Precision::Float => data.extend(values.flat_map(f32::to_ne_bytes)),
                            }
                        }
                    }
                    let block = UncompressedBlock { index: block, data };
                    Ok((index, block.compress_to_chunk(&meta.headers)?))
                })
                .collect::<::exr::error::Result<Vec<_>>>()?;
            for (index, chunk) in chunks {
                writer.write_chunk(index, chunk)?;
            }
        }
        Ok(())
    })
    .map_err(refused)?;
    Ok(file.into_inner())
}
