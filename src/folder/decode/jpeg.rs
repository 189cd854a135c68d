//! JPEG: 8-bit gray or color, baseline or progressive; truncation is an error, not gray rows.

use super::{Gate, ImageError, Samples, exif};
use drivers::Plane;
use std::io::{BufRead, Read};
use zune_jpeg::{
    JpegDecoder,
    zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
};

/// A JPEG larger than its decoded picture by more than this is padded or lying.
const SLACK_BYTES: usize = 16 << 20;

/// The samples, and EXIF's orientation.
pub(super) fn decode<R: BufRead>(gate: &Gate<'_>, reader: R) -> Result<(Samples, u16), ImageError> {
    let picture = gate
        .expected
        .map_or(gate.limits.max_pixels, |(w, h)| w.saturating_mul(h));
    let limit = picture.saturating_mul(3).saturating_add(SLACK_BYTES);
    if gate.file_bytes > limit as u64 {
        let found = usize::try_from(gate.file_bytes).unwrap_or(usize::MAX);
        return Err(gate.too_large("the file's size in bytes", found, limit));
    }
    let mut bytes = Vec::with_capacity(gate.file_bytes as usize);
    reader
        .take(limit as u64)
        .read_to_end(&mut bytes)
        .map_err(|source| ImageError::Io {
            path: gate.path.into(),
            source,
        })?;

    let options = DecoderOptions::default()
        .set_max_width(gate.limits.max_side)
        .set_max_height(gate.limits.max_side)
        .set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&bytes), options);
    let damaged = |error| gate.malformed(format!("JPEG: {error}"));
    decoder.decode_headers().map_err(damaged)?;
    let info = decoder
        .info()
        .ok_or_else(|| gate.malformed("JPEG: no frame header"))?;
    let size = (usize::from(info.width), usize::from(info.height));
    gate.admit(size.0, size.1)?;
    let orientation = decoder
        .exif()
        .map_or(exif::UPRIGHT, |bytes| exif::orientation(bytes));
    let color = decoder.input_colorspace();
    let gray = match color {
        Some(ColorSpace::Luma) => true,
        Some(ColorSpace::RGB | ColorSpace::YCbCr) => false,
        other => {
            return Err(gate.unsupported(
                format!("JPEG: color space {other:?} is not gray or RGB"),
                "save it as an RGB JPEG or PNG",
            ));
        }
    };
    let out = if gray {
        ColorSpace::Luma
    } else {
        ColorSpace::RGB
    };
    decoder.set_options(options.jpeg_set_out_colorspace(out));
    let needed = decoder.output_buffer_size();
    if gray {
        let mut plane = Plane::filled(size.0, size.1, 0_u8);
        if needed != Some(plane.len()) {
            return Err(gate.malformed("JPEG: component count contradicts the header"));
        }
        decoder.decode_into(plane.samples_mut()).map_err(damaged)?;
        Ok((Samples::Gray8(plane), orientation))
    } else {
        let mut plane = Plane::filled(size.0, size.1, [0_u8; 3]);
        if needed != Some(plane.len() * 3) {
            return Err(gate.malformed("JPEG: component count contradicts the header"));
        }
        decoder
            .decode_into(plane.samples_mut().as_flattened_mut())
            .map_err(damaged)?;
        Ok((Samples::Rgb8(plane), orientation))
    }
}
