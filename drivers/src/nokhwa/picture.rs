//! What a webcam's buffer holds. nokhwa hands over whole buffers and tells neither how much of one was
//! filled nor how long its rows are.

use crate::{frame::Pixels, plane::Plane};
use ::nokhwa::{Buffer, utils::FrameFormat};

/// Systems make buffers in whole pages, so this much may follow a picture; more is padding of its rows,
/// and rows whose length is not told cannot be read.
const PAGE: usize = 4096;

/// A buffer's bytes as what they are.
///
/// # Errors
/// A sentence for one that does not hold a picture of its size.
pub(super) fn pixels(buffer: &Buffer) -> Result<Pixels, String> {
    let size = buffer.resolution();
    let (width, height) = (size.width() as usize, size.height() as usize);
    let bytes = buffer.buffer();
    let filled = |needed: usize| match bytes.get(..needed) {
        Some(picture) if bytes.len() - needed < PAGE => Ok(picture),
        _ => Err(format!(
            "{} of {width}×{height} has {} bytes, not {needed}",
            buffer.source_frame_format(),
            bytes.len()
        )),
    };
    Ok(match buffer.source_frame_format() {
        FrameFormat::YUYV => Pixels::Yuyv {
            width,
            height,
            bytes: filled(2 * width * height)?.to_vec(),
        },
        FrameFormat::NV12 => Pixels::Nv12 {
            width,
            height,
            bytes: filled(width * height * 3 / 2)?.to_vec(),
        },
        FrameFormat::MJPEG => Pixels::Mjpg {
            width,
            height,
            bytes: jpeg_alone(bytes)?.to_vec(),
        },
        FrameFormat::RAWRGB => {
            let samples = filled(3 * width * height)?.as_chunks::<3>().0.to_vec();
            Pixels::Rgb8(Plane::new(width, height, samples).map_err(|error| error.to_string())?)
        }
        other => return Err(format!("{other} was not asked for")),
    })
}

/// A JPEG without what follows it: the rest of the buffer, perhaps of an earlier picture. Segments are
/// stepped over by their lengths, and within a scan every marker but that of the end begins with a byte
/// that the encoder escapes (ITU-T T.81, B.1.1).
fn jpeg_alone(bytes: &[u8]) -> Result<&[u8], String> {
    let mut at = match bytes {
        [0xff, 0xd8, ..] => 2,
        _ => return Err("no JPEG: it does not begin with a start-of-image marker".into()),
    };
    while let Some([0xff, marker]) = bytes.get(at..at + 2) {
        at += match marker {
            0xd9 => return Ok(&bytes[..at + 2]),
            // Fill bytes, and markers without a segment.
            0xff => 1,
            0x01 | 0xd0..=0xd7 => 2,
            _ => match bytes.get(at + 2..at + 4) {
                Some(length) => 2 + usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => break,
            },
        };
        if *marker == 0xda {
            let scan = bytes.get(at..).unwrap_or_default();
            let end = scan
                .windows(2)
                .position(|pair| pair[0] == 0xff && !matches!(pair[1], 0 | 0xd0..=0xd7));
            at += end.unwrap_or(scan.len());
        }
    }
    Err("a JPEG without an end".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jpeg::jpeg;
    use ::nokhwa::utils::Resolution;

    fn buffer(format: FrameFormat, bytes: &[u8]) -> Buffer {
        Buffer::new(Resolution::new(4, 2), bytes, format)
    }

    #[test]
    fn every_format_becomes_the_pixels_it_is_and_the_rest_of_a_page_is_left_out() {
        for (format, bytes, good) in [
            (FrameFormat::YUYV, 16, true),
            (FrameFormat::YUYV, 4096, true),
            (FrameFormat::YUYV, 16 + 4096, false),
            (FrameFormat::NV12, 12, true),
            (FrameFormat::NV12, 11, false),
            (FrameFormat::RAWRGB, 24, true),
            (FrameFormat::RAWRGB, 21, false),
            (FrameFormat::MJPEG, 5, false),
            (FrameFormat::GRAY, 8, false),
        ] {
            let found = pixels(&buffer(format, &vec![7; bytes]));
            assert_eq!(found.is_ok(), good, "{format} of {bytes} bytes: {found:?}");
            if let Ok(found) = found {
                assert_eq!(found.size(), (4, 2));
            }
        }
    }

    #[test]
    fn a_jpeg_ends_where_it_ends() {
        let picture = Plane::from_fn(64, 48, |x, y| [(x * 3) as u8, (y * 5) as u8, (x ^ y) as u8]);
        let file = jpeg(&picture, 90);
        let mut buffer_bytes = file.clone();
        // What an earlier, longer picture left.
        buffer_bytes.extend([1, 2, 0xff, 0xd9, 3]);
        assert_eq!(jpeg_alone(&buffer_bytes), Ok(file.as_slice()));
        for cut in 0..file.len() {
            assert!(jpeg_alone(&file[..cut]).is_err(), "{cut}");
        }
        let Ok(Pixels::Mjpg { bytes, .. }) = pixels(&buffer(FrameFormat::MJPEG, &buffer_bytes))
        else {
            panic!("a JPEG");
        };
        assert_eq!(bytes, file);
    }
}
