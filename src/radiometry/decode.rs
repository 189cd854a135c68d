//! Pixels of any layout → scene-linear light.

use super::levels::Levels;
use super::{LinearImage, RadiometryError, demosaic, jpeg};
use drivers::{ColorFrame, Pixels, Plane};
use rayon::prelude::*;
use std::borrow::Cow;
use yuv::{
    YuvBiPlanarImage, YuvConversionMode, YuvPackedImage, YuvRange, YuvStandardMatrix,
    yuv_nv12_to_rgb, yuyv422_to_rgb,
};

/// Distance of two 8-bit values, as a fraction of full scale.
pub(super) const STEP_8: f32 = 1.0 / 255.0;
/// Distance of two 16-bit values, as a fraction of full scale.
pub(super) const STEP_16: f32 = 1.0 / 65535.0;

/// Turns a frame into scene-linear light: black and white level applied, through the inverse of
/// the transfer curve, divided by `seconds · gain`.
///
/// A value at or above the white level (for 8-bit frames: from one code under it, where JPEG and
/// color conversion leave clipped values) in any channel makes the pixel NaN. A Bayer sample that
/// clips takes its eight neighbours with it, because their colors were interpolated from it.
///
/// Bayer frames: Malvar, He & Cutler (2004). YUYV and NV12: BT.601, limited range. Lens shading
/// is not known here and not corrected.
///
/// # Errors
/// [`RadiometryError::WrongLength`] when the bytes do not fill the rectangle,
/// [`RadiometryError::UnusableSize`] for an empty frame or a size the layout cannot have,
/// [`RadiometryError::OutOfRange`] and [`RadiometryError::BadResponse`] for impossible metadata,
/// [`RadiometryError::JpegSize`] and [`RadiometryError::Jpeg`] for a lying or damaged JPEG.
pub fn linearise(frame: &ColorFrame) -> Result<LinearImage, RadiometryError> {
    check_size(frame)?;
    match &frame.pixels {
        Pixels::Bayer { samples, pattern } => {
            let levels = Levels::of(frame, STEP_16)?;
            let mosaic = lit(samples, |raw: u16| {
                levels.relative_unless_clipped(f32::from(raw) * STEP_16)
            })?;
            demosaic::demosaic(&mosaic, *pattern, levels.factor)
        }
        Pixels::Yuyv { .. } | Pixels::Nv12 { .. } | Pixels::Mjpg { .. } | Pixels::Rgb8(_) => {
            let levels = Levels::of(frame, STEP_8)?;
            let curve = curve_8(&levels);
            let rgb = rgb8(frame)?;
            Ok(LinearImage(lit(&rgb, |rgb: [u8; 3]| {
                united(rgb.map(|code| curve[usize::from(code)]))
            })?))
        }
        Pixels::Rgb16(plane) => {
            let levels = Levels::of(frame, STEP_16)?;
            let curve = curve_16(&levels);
            Ok(LinearImage(lit(plane, |rgb: [u16; 3]| {
                united(rgb.map(|code| curve[usize::from(code)]))
            })?))
        }
        Pixels::RgbF32(plane) => {
            let levels = Levels::of(frame, 0.0)?;
            Ok(LinearImage(lit(plane, |rgb: [f32; 3]| {
                united(rgb.map(|value| levels.light(value)))
            })?))
        }
    }
}

/// Name of the layout, for errors.
pub(super) fn layout(pixels: &Pixels) -> &'static str {
    match pixels {
        Pixels::Bayer { .. } => "Bayer",
        Pixels::Yuyv { .. } => "YUYV",
        Pixels::Nv12 { .. } => "NV12",
        Pixels::Mjpg { .. } => "MJPG",
        Pixels::Rgb8(_) => "Rgb8",
        Pixels::Rgb16(_) => "Rgb16",
        Pixels::RgbF32(_) => "RgbF32",
    }
}

/// Refuses frames without a pixel.
pub(super) fn check_size(frame: &ColorFrame) -> Result<(), RadiometryError> {
    let (width, height) = frame.pixels.size();
    if width == 0 || height == 0 {
        return Err(unusable(frame, "it has no pixel; take another frame"));
    }
    Ok(())
}

/// Light of every 8-bit code; NaN when clipped.
pub(super) fn curve_8(levels: &Levels) -> Vec<f32> {
    (0..=u8::MAX)
        .map(|code| levels.light(f32::from(code) * STEP_8))
        .collect()
}

/// Light of every 16-bit code; NaN when clipped.
pub(super) fn curve_16(levels: &Levels) -> Vec<f32> {
    (0..=u16::MAX)
        .into_par_iter()
        .map(|code| levels.light(f32::from(code) * STEP_16))
        .collect()
}

/// A pixel with one unknown channel is unknown.
fn united(rgb: [f32; 3]) -> [f32; 3] {
    let fate = (rgb[0] + rgb[1] + rgb[2]) * 0.0;
    rgb.map(|channel| channel + fate)
}

/// `plane` with every sample passed through `light`, rows in parallel.
fn lit<T, U>(
    plane: &Plane<T>,
    light: impl Fn(T) -> U + Sync + Send,
) -> Result<Plane<U>, RadiometryError>
where
    T: Copy + Sync + Send,
    U: Send,
{
    let (width, height) = plane.size();
    let samples: Vec<U> = plane
        .samples()
        .par_iter()
        .map(|&sample| light(sample))
        .collect();
    let found = samples.len();
    Plane::new(width, height, samples).map_err(|mismatch| RadiometryError::WrongLength {
        layout: "linear",
        width,
        height,
        expected: mismatch.expected,
        found,
    })
}

/// The 8-bit red, green, blue of any 8-bit layout.
pub(super) fn rgb8(frame: &ColorFrame) -> Result<Cow<'_, Plane<[u8; 3]>>, RadiometryError> {
    let (width, height) = frame.pixels.size();
    let flat = match &frame.pixels {
        Pixels::Rgb8(plane) => return Ok(Cow::Borrowed(plane)),
        Pixels::Yuyv { bytes, .. } => yuyv(frame, width, height, bytes)?,
        Pixels::Nv12 { bytes, .. } => nv12(frame, width, height, bytes)?,
        Pixels::Mjpg { bytes, .. } => jpeg::decode(bytes, width, height)?,
        other => {
            return Err(RadiometryError::Layout {
                layout: layout(other),
            });
        }
    };
    let (pixels, rest) = flat.as_chunks::<3>();
    debug_assert!(rest.is_empty());
    Plane::new(width, height, pixels.to_vec())
        .map(Cow::Owned)
        .map_err(|mismatch| RadiometryError::WrongLength {
            layout: layout(&frame.pixels),
            width,
            height,
            expected: mismatch.expected,
            found: mismatch.found,
        })
}

fn yuyv(
    frame: &ColorFrame,
    width: usize,
    height: usize,
    bytes: &[u8],
) -> Result<Vec<u8>, RadiometryError> {
    if !width.is_multiple_of(2) {
        return Err(unusable(frame, "YUYV needs an even width"));
    }
    let (wide, high) = sides(frame)?;
    check_length(frame, (width * 2).saturating_mul(height), bytes.len())?;
    let image = YuvPackedImage {
        yuy: bytes,
        yuy_stride: wide * 2,
        width: wide,
        height: high,
    };
    let mut rgb = vec![0; width * height * 3];
    yuyv422_to_rgb(
        &image,
        &mut rgb,
        wide * 3,
        YuvRange::Limited,
        YuvStandardMatrix::Bt601,
    )
    .map_err(|_| unusable(frame, "the color conversion refused it"))?;
    Ok(rgb)
}

fn nv12(
    frame: &ColorFrame,
    width: usize,
    height: usize,
    bytes: &[u8],
) -> Result<Vec<u8>, RadiometryError> {
    if !width.is_multiple_of(2) || !height.is_multiple_of(2) {
        return Err(unusable(frame, "NV12 needs even sides"));
    }
    let (wide, high) = sides(frame)?;
    let luma = width.saturating_mul(height);
    check_length(frame, luma.saturating_add(luma / 2), bytes.len())?;
    let (y_plane, uv_plane) = bytes.split_at(luma);
    let image = YuvBiPlanarImage {
        y_plane,
        y_stride: wide,
        uv_plane,
        uv_stride: wide,
        width: wide,
        height: high,
    };
    let mut rgb = vec![0; luma * 3];
    yuv_nv12_to_rgb(
        &image,
        &mut rgb,
        wide * 3,
        YuvRange::Limited,
        YuvStandardMatrix::Bt601,
        YuvConversionMode::Balanced,
    )
    .map_err(|_| unusable(frame, "the color conversion refused it"))?;
    Ok(rgb)
}

/// Longest side that the color conversion's 32-bit strides can hold.
const SIDE_AT_MOST: u32 = 1 << 20;

fn sides(frame: &ColorFrame) -> Result<(u32, u32), RadiometryError> {
    let (width, height) = frame.pixels.size();
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width), Ok(height)) if width <= SIDE_AT_MOST && height <= SIDE_AT_MOST => {
            Ok((width, height))
        }
        _ => Err(unusable(
            frame,
            "sides over 1048576 pixels are not supported",
        )),
    }
}

fn check_length(frame: &ColorFrame, expected: usize, found: usize) -> Result<(), RadiometryError> {
    if expected == found {
        return Ok(());
    }
    let (width, height) = frame.pixels.size();
    let layout = layout(&frame.pixels);
    Err(RadiometryError::WrongLength {
        layout,
        width,
        height,
        expected,
        found,
    })
}

fn unusable(frame: &ColorFrame, problem: &'static str) -> RadiometryError {
    let (width, height) = frame.pixels.size();
    RadiometryError::UnusableSize {
        layout: layout(&frame.pixels),
        width,
        height,
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{RadiometryError, linearise, transfer};
    use drivers::{
        BayerPattern, ColorFrame, Exposure, Illumination, Pixels, Plane, Timestamp, Transfer,
    };
    use proptest::prelude::*;

    fn frame(pixels: Pixels) -> ColorFrame {
        ColorFrame {
            at: Timestamp::from_nanos(0),
            sequence: 0,
            light: Illumination::Flash,
            exposure: Exposure::UNIT,
            pixels,
            transfer: Transfer::Linear,
            black_level: 0.0,
            white_level: 1.0,
        }
    }

    fn mosaic(
        width: usize,
        height: usize,
        pattern: BayerPattern,
        light: impl Fn(usize, usize) -> [f32; 3] + Sync,
    ) -> Pixels {
        let colors = match pattern {
            BayerPattern::Rggb => [[0, 1], [1, 2]],
            BayerPattern::Grbg => [[1, 0], [2, 1]],
            BayerPattern::Gbrg => [[1, 2], [0, 1]],
            BayerPattern::Bggr => [[2, 1], [1, 0]],
        };
        let samples = Plane::from_fn(width, height, |x, y| {
            (light(x, y)[colors[y % 2][x % 2]] * 65535.0).round() as u16
        });
        Pixels::Bayer { samples, pattern }
    }

    const PATTERNS: [BayerPattern; 4] = [
        BayerPattern::Rggb,
        BayerPattern::Grbg,
        BayerPattern::Gbrg,
        BayerPattern::Bggr,
    ];

    fn near(found: [f32; 3], expected: [f32; 3], tolerance: f32) -> bool {
        found
            .iter()
            .zip(expected)
            .all(|(found, expected)| (found - expected).abs() <= tolerance)
    }

    #[test]
    fn a_mosaic_of_one_color_is_that_color_everywhere() {
        for pattern in PATTERNS {
            let color = [0.2, 0.5, 0.3];
            let light = linearise(&frame(mosaic(9, 7, pattern, |_, _| color))).unwrap();
            assert!(
                light.0.samples().iter().all(|&rgb| near(rgb, color, 2e-5)),
                "{pattern:?}"
            );
        }
    }

    #[test]
    fn a_grey_gradient_survives_the_mosaic_away_from_the_edge() {
        let ramp = |x: usize, y: usize| [0.1 + 0.02 * x as f32 + 0.01 * y as f32; 3];
        for pattern in PATTERNS {
            let light = linearise(&frame(mosaic(20, 16, pattern, ramp))).unwrap();
            for y in 2..14 {
                for x in 2..18 {
                    assert!(
                        near(light.0[(x, y)], ramp(x, y), 2e-5),
                        "{pattern:?} at {x}, {y}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_clipped_sample_takes_its_eight_neighbours_and_nothing_else() {
        for pattern in PATTERNS {
            let spot = |x, y| {
                if (x, y) == (6, 5) {
                    [1.0; 3]
                } else {
                    [0.25; 3]
                }
            };
            let light = linearise(&frame(mosaic(14, 12, pattern, spot))).unwrap();
            for y in 0..12usize {
                for x in 0..14usize {
                    let lost = x.abs_diff(6) <= 1 && y.abs_diff(5) <= 1;
                    let rgb = light.0[(x, y)];
                    assert_eq!(rgb.iter().all(|channel| channel.is_nan()), lost, "{x}, {y}");
                    assert!(
                        lost || near(rgb, [0.25; 3], 2e-5),
                        "{pattern:?} at {x}, {y}: {rgb:?}"
                    );
                }
            }
        }
    }

    proptest! {
        #[test]
        fn nan_never_leaves_its_pixel(x in 0usize..8, y in 0usize..6, channel in 0usize..3) {
            let mut plane = Plane::filled(8, 6, [0.5f32; 3]);
            plane[(x, y)][channel] = f32::NAN;
            let light = linearise(&frame(Pixels::RgbF32(plane))).unwrap();
            for row in 0..6 {
                for column in 0..8 {
                    let rgb = light.0[(column, row)];
                    let here = (column, row) == (x, y);
                    prop_assert!(rgb.iter().all(|channel| channel.is_nan() == here));
                }
            }
        }

        #[test]
        fn levels_curve_and_exposure_are_undone(
            light in 0.0f32..0.97,
            black in 0.0f32..0.2,
            white in 0.6f32..1.0,
            seconds in 0.001f32..10.0,
            gain in 1.0f32..16.0,
        ) {
            let mut stored = frame(Pixels::Rgb16(Plane::filled(1, 1, [0; 3])));
            stored.transfer = Transfer::Srgb;
            (stored.black_level, stored.white_level) = (black, white);
            stored.exposure = Exposure { seconds, gain };
            let value = black + (white - black) * transfer::srgb_encode(light);
            stored.pixels =
                Pixels::Rgb16(Plane::filled(1, 1, [(value * 65535.0).round() as u16; 3]));
            let found = linearise(&stored).unwrap().0[(0, 0)][0] * seconds * gain;
            // Half a 16-bit step through the steepest part of the curve, over the least span.
            prop_assert!((found - light).abs() < 6e-5, "{found} is not {light}");
        }

        #[test]
        fn any_bytes_give_light_or_an_error(
            bytes in proptest::collection::vec(any::<u8>(), 0..64),
            width in 0usize..7,
            height in 0usize..7,
        ) {
            for pixels in [
                Pixels::Yuyv { width, height, bytes: bytes.clone() },
                Pixels::Nv12 { width, height, bytes: bytes.clone() },
                Pixels::Mjpg { width, height, bytes: bytes.clone() },
            ] {
                if let Ok(light) = linearise(&frame(pixels)) {
                    prop_assert_eq!(light.0.size(), (width, height));
                }
            }
        }
    }

    /// BT.601 limited range: Y = 16 is black, 235 white; expected values worked out by hand from
    /// the standard's matrix (1.164, 1.596, 0.392, 0.813, 2.017).
    #[test]
    fn yuv_layouts_follow_bt_601() {
        struct Case(&'static str, [u8; 3], [f32; 3]);
        for Case(name, [y, u, v], rgb) in [
            Case("black", [16, 128, 128], [0.0, 0.0, 0.0]),
            Case("grey", [126, 128, 128], [0.502, 0.502, 0.502]),
            Case("dark red", [59, 106, 197], [0.628, 0.010, 0.022]),
        ] {
            let yuyv = Pixels::Yuyv {
                width: 4,
                height: 2,
                bytes: [y, u, y, v].repeat(4),
            };
            let mut planes = vec![y; 8];
            planes.extend([u, v, u, v]);
            let nv12 = Pixels::Nv12 {
                width: 4,
                height: 2,
                bytes: planes,
            };
            for pixels in [yuyv, nv12] {
                let light = linearise(&frame(pixels)).unwrap();
                let found = light.0[(1, 1)];
                assert!(near(found, rgb, 0.008), "{name}: {found:?}, not {rgb:?}");
            }
        }
    }

    #[test]
    fn wrong_lengths_and_sizes_are_named() {
        let short = Pixels::Yuyv {
            width: 4,
            height: 2,
            bytes: vec![0; 15],
        };
        assert!(matches!(
            linearise(&frame(short)),
            Err(RadiometryError::WrongLength {
                expected: 16,
                found: 15,
                ..
            })
        ));
        let odd = Pixels::Nv12 {
            width: 3,
            height: 2,
            bytes: vec![0; 9],
        };
        assert!(matches!(
            linearise(&frame(odd)),
            Err(RadiometryError::UnusableSize { .. })
        ));
        let empty = Pixels::Rgb8(Plane::filled(0, 0, [0; 3]));
        assert!(matches!(
            linearise(&frame(empty)),
            Err(RadiometryError::UnusableSize { .. })
        ));
        let huge = Pixels::Yuyv {
            width: usize::MAX - 1,
            height: usize::MAX,
            bytes: vec![],
        };
        assert!(linearise(&frame(huge)).is_err());
        let tiny = Pixels::Bayer {
            samples: Plane::filled(2, 2, 0),
            pattern: BayerPattern::Rggb,
        };
        assert!(matches!(
            linearise(&frame(tiny)),
            Err(RadiometryError::UnusableSize { .. })
        ));
    }

    #[test]
    fn impossible_metadata_is_named() {
        let good = frame(Pixels::Rgb8(Plane::filled(1, 1, [9; 3])));
        for (field, value) in [
            ("black_level", 1.5),
            ("white_level", 0.0),
            ("exposure seconds", -1.0),
        ] {
            let mut bad = good.clone();
            match field {
                "black_level" => bad.black_level = value,
                "white_level" => bad.white_level = value,
                _ => bad.exposure.seconds = value,
            }
            let error = linearise(&bad).unwrap_err().to_string();
            assert!(error.contains(field), "{error}");
        }
    }

    fn jpeg(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let grey = image::RgbImage::from_pixel(width, height, image::Rgb([128; 3]));
        image::codecs::jpeg::JpegEncoder::new(&mut bytes)
            .encode_image(&grey)
            .unwrap();
        bytes
    }

    #[test]
    fn a_jpeg_is_light_when_its_header_agrees() {
        let picture = Pixels::Mjpg {
            width: 20,
            height: 12,
            bytes: jpeg(20, 12),
        };
        let light = linearise(&frame(picture)).unwrap();
        assert_eq!(light.0.size(), (20, 12));
        assert!(near(light.0[(7, 7)], [128.0 / 255.0; 3], 0.01));
    }

    /// A header that claims 65500×65500 asks for 12.9 GB; it must be refused unread.
    #[test]
    fn a_jpeg_that_lies_about_its_size_is_refused_before_decoding() {
        let mut bytes = jpeg(16, 16);
        let frame_header = bytes
            .windows(2)
            .position(|pair| pair == [0xff, 0xc0])
            .unwrap();
        bytes[frame_header + 5..frame_header + 9].copy_from_slice(&[0xff, 0xdc, 0xff, 0xdc]);
        let lying = Pixels::Mjpg {
            width: 16,
            height: 16,
            bytes,
        };
        assert!(matches!(
            linearise(&frame(lying)),
            Err(RadiometryError::JpegSize {
                found_width: 65500,
                found_height: 65500,
                ..
            })
        ));
        let mut bytes = jpeg(16, 16);
        bytes.truncate(bytes.len() / 3);
        let cut = Pixels::Mjpg {
            width: 16,
            height: 16,
            bytes,
        };
        assert!(matches!(
            linearise(&frame(cut)),
            Err(RadiometryError::Jpeg { .. })
        ));
    }
}
