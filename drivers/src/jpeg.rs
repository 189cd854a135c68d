//! Pictures as cameras compress them.

use crate::plane::Plane;
use zune_jpeg::{
    JpegDecoder,
    zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
};

/// Scans a progressive JPEG may have; each one costs a pass over all blocks.
const MOST_SCANS: usize = 64;

/// The picture as baseline JPEG of a `quality` in 1..=100.
///
/// Writing to memory fails only for sides above 65,535 pixels, which admission refuses, as it does
/// the empty file that is then the answer.
pub fn jpeg(picture: &Plane<[u8; 3]>, quality: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let (width, height) = picture.size();
    let written = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, quality).encode(
        picture.samples().as_flattened(),
        width as u32,
        height as u32,
        image::ExtendedColorType::Rgb8,
    );
    if written.is_err() {
        file.clear();
    }
    file
}

/// Luma of a JPEG picture that a camera sent, in row order; `None` for one of another size than
/// `width` × `height`, of which nothing is decoded, and for one that cannot be decoded.
pub fn luma_of_jpeg(file: &[u8], width: usize, height: usize) -> Option<Vec<u8>> {
    let options = DecoderOptions::default()
        .set_max_width(width)
        .set_max_height(height)
        .jpeg_set_max_scans(MOST_SCANS)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    decoder.decode_headers().ok()?;
    if decoder.dimensions() != Some((width, height)) {
        return None;
    }
    let luma = decoder.decode().ok()?;
    (luma.len() == width * height).then_some(luma)
}

/// Width and height in a JPEG picture's frame header, without decoding anything.
///
/// # Errors
/// A sentence that says what is missing or wrong.
#[cfg(target_os = "linux")]
pub(crate) fn size_of_jpeg(file: &[u8]) -> Result<(usize, usize), String> {
    let mut rest = file
        .strip_prefix(&[0xff, 0xd8])
        .ok_or("no JPEG: it does not begin with a start-of-image marker")?;
    loop {
        // Any number of fill bytes may stand before a marker (ITU-T T.81, B.1.1.2).
        let start = rest.iter().take_while(|byte| **byte == 0xff).count();
        let (marker, after) = match rest.get(start..) {
            Some([marker, after @ ..]) if start > 0 => (*marker, after),
            _ => return Err("a JPEG without a frame header".into()),
        };
        let length = match after {
            [high, low, ..] => usize::from(u16::from_be_bytes([*high, *low])),
            _ => return Err("a JPEG that ends in a header".into()),
        };
        let segment = after
            .get(2..length)
            .ok_or("a JPEG that ends within a segment")?;
        match marker {
            // Start of frame, of every coding process; 0xc4, 0xc8 and 0xcc are something else.
            0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => {
                return match segment {
                    [_, h1, h0, w1, w0, ..] => Ok((
                        u16::from_be_bytes([*w1, *w0]).into(),
                        u16::from_be_bytes([*h1, *h0]).into(),
                    )),
                    _ => Err("a JPEG with a short frame header".into()),
                };
            }
            // Scan or end of image before any frame header.
            0xd9 | 0xda => return Err("a JPEG without a frame header".into()),
            _ => rest = &after[length..],
        }
    }
}
