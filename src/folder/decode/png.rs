//! PNG: 8 and 16 bits, gray, color, palette; alpha is dropped.

use super::{Gate, ImageError, Samples, exif};
use std::io::{BufRead, Seek};

/// The decoder's own buffers; the picture is ours.
const WORKING_BYTES: usize = 32 << 20;

/// The samples, and EXIF's orientation.
pub(super) fn decode<R: BufRead + Seek>(
    gate: &Gate<'_>,
    reader: R,
) -> Result<(Samples, u16), ImageError> {
    let damaged = |error: ::png::DecodingError| gate.malformed(format!("PNG: {error}"));
    let mut decoder = ::png::Decoder::new_with_limits(
        reader,
        ::png::Limits {
            bytes: WORKING_BYTES,
        },
    );
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(damaged)?;
    let (width, height) = (header.width as usize, header.height as usize);
    gate.admit(width, height)?;
    decoder.set_transformations(::png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (color, depth) = reader.output_color_type();
    let channels = color.samples();
    let size = (width, height);

    // An interlaced picture comes whole; others come row by row and need no second copy.
    let whole = if reader.info().interlaced {
        let bytes = reader
            .output_buffer_size()
            .ok_or_else(|| gate.malformed("PNG: size overflows"))?;
        let mut buffer = vec![0; bytes];
        reader.next_frame(&mut buffer).map_err(damaged)?;
        Some(buffer)
    } else {
        None
    };
    let row_bytes = width
        * channels
        * if depth == ::png::BitDepth::Sixteen {
            2
        } else {
            1
        };
    let mut each_row = |row: &mut dyn FnMut(&[u8])| -> Result<(), ImageError> {
        for y in 0..height {
            if let Some(buffer) = &whole {
                row(buffer
                    .get(y * row_bytes..(y + 1) * row_bytes)
                    .ok_or_else(|| gate.malformed(format!("PNG: row {y} is missing")))?);
            } else {
                let data = reader.next_row().map_err(damaged)?;
                let data =
                    data.ok_or_else(|| gate.malformed(format!("PNG: row {y} is missing")))?;
                row(data
                    .data()
                    .get(..row_bytes)
                    .ok_or_else(|| gate.malformed(format!("PNG: row {y} is short")))?);
            }
        }
        Ok(())
    };

    let gray = channels < 3;
    let word = |bytes: &[u8]| u16::from_be_bytes([bytes[0], bytes[1]]);
    let decoded = match (depth, gray) {
        (::png::BitDepth::Eight, true) => {
            let mut samples = Vec::with_capacity(width * height);
            each_row(&mut |row| samples.extend(row.chunks_exact(channels).map(|p| p[0])))?;
            Samples::Gray8(gate.plane(size, samples)?)
        }
        (::png::BitDepth::Eight, false) => {
            let mut samples = Vec::with_capacity(width * height);
            each_row(&mut |row| {
                samples.extend(row.chunks_exact(channels).map(|p| [p[0], p[1], p[2]]));
            })?;
            Samples::Rgb8(gate.plane(size, samples)?)
        }
        (::png::BitDepth::Sixteen, true) => {
            let mut samples = Vec::with_capacity(width * height);
            each_row(&mut |row| samples.extend(row.chunks_exact(2 * channels).map(word)))?;
            Samples::Gray16(gate.plane(size, samples)?)
        }
        (::png::BitDepth::Sixteen, false) => {
            let mut samples = Vec::with_capacity(width * height);
            each_row(&mut |row| {
                let pixels = row.chunks_exact(2 * channels);
                samples.extend(pixels.map(|p| [word(p), word(&p[2..]), word(&p[4..])]));
            })?;
            Samples::Rgb16(gate.plane(size, samples)?)
        }
        _ => {
            return Err(gate.malformed(format!("PNG: bit depth {depth:?} was not expanded")));
        }
    };
    // The checksums stand after the last row.
    reader.finish().map_err(damaged)?;
    let orientation = reader.info().exif_metadata.as_deref();
    Ok((
        decoded,
        orientation.map_or(exif::UPRIGHT, exif::orientation),
    ))
}
