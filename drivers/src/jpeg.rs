//! Pictures as cameras compress them.

use crate::plane::Plane;

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
