//! One JPEG picture inside a frame, decoded only after its header agrees with the frame.

use super::RadiometryError;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Scans a progressive JPEG may have; each one costs a pass over all blocks.
const SCANS_AT_MOST: usize = 64;

/// Decodes to `3 · width · height` bytes of red, green, blue. Nothing of the picture's size is
/// allocated before the header's size equals the declared one.
///
/// # Errors
/// [`RadiometryError::JpegSize`] when header and frame disagree, [`RadiometryError::Jpeg`] for
/// anything the decoder refuses.
pub(super) fn decode(
    bytes: &[u8],
    width: usize,
    height: usize,
) -> Result<Vec<u8>, RadiometryError> {
    let options = DecoderOptions::new_safe()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_max_scans(SCANS_AT_MOST)
        .set_strict_mode(true)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let refused = |error: &dyn std::fmt::Debug| RadiometryError::Jpeg {
        problem: format!("{error:?}"),
    };
    let mut header = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    header.decode_headers().map_err(|error| refused(&error))?;
    let Some((found_width, found_height)) = header.dimensions() else {
        return Err(RadiometryError::Jpeg {
            problem: "no frame header".into(),
        });
    };
    if (found_width, found_height) != (width, height) {
        return Err(RadiometryError::JpegSize {
            width,
            height,
            found_width,
            found_height,
        });
    }
    let rgb = header.decode().map_err(|error| refused(&error))?;
    let expected = width * height * 3;
    if rgb.len() != expected {
        return Err(RadiometryError::WrongLength {
            layout: "decoded JPEG",
            width,
            height,
            expected,
            found: rgb.len(),
        });
    }
    Ok(rgb)
}
