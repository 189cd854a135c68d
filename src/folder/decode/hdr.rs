//! Radiance HDR: shared-exponent float color, as environment maps come.

use super::{Gate, ImageError, Samples};
use drivers::Plane;
use image::{ImageDecoder as _, codecs::hdr::HdrDecoder};
use std::io::{BufRead, Read, Seek};

/// Where a header must have ended; the decoder itself would read lines without end.
const HEADER_BYTES: u64 = 64 << 10;

pub(super) fn decode<R: BufRead + Seek>(
    gate: &Gate<'_>,
    mut reader: R,
) -> Result<Samples, ImageError> {
    let io = |source| ImageError::Io {
        path: gate.path.into(),
        source,
    };
    let mut header = Vec::new();
    reader
        .by_ref()
        .take(HEADER_BYTES)
        .read_to_end(&mut header)
        .map_err(io)?;
    let end = header.windows(2).position(|pair| pair == b"\n\n");
    let resolution_ends =
        end.and_then(|at| header[at + 2..].iter().position(|&byte| byte == b'\n'));
    if resolution_ends.is_none() {
        return Err(gate.malformed("Radiance HDR: the header does not end within 64 KiB"));
    }
    reader.rewind().map_err(io)?;

    let damaged = |error: image::ImageError| gate.malformed(format!("Radiance HDR: {error}"));
    let decoder = HdrDecoder::new_nonstrict(reader).map_err(damaged)?;
    let metadata = decoder.metadata();
    let (width, height) = (metadata.width as usize, metadata.height as usize);
    gate.admit(width, height)?;
    let mut plane = Plane::filled(width, height, [0.0_f32; 3]);
    decoder
        .read_image(bytemuck::cast_slice_mut(plane.samples_mut()))
        .map_err(damaged)?;
    // EXPOSURE says what the values were multiplied with (Ward, Radiance file formats).
    if let Some(exposure) = metadata.exposure {
        if !exposure.is_finite() || exposure <= 0.0 {
            return Err(gate.malformed(format!("Radiance HDR: EXPOSURE is {exposure}")));
        }
        for value in plane.samples_mut().as_flattened_mut() {
            *value /= exposure;
        }
    }
    Ok(Samples::RgbF32(plane))
}
