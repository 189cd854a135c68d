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
