//! Image files of a folder → planes: which file plays a part, and what its samples mean.

use super::{
    FolderError,
    decode::{Limits, Samples, decode_limited},
};
use crate::radiometry::transfer::srgb_decode;
use drivers::{Pixels, Plane};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Shortest vector that is still taken as a direction.
const MIN_NORMAL_LENGTH: f32 = 0.5;

/// The one file `stem.ext` that exists, for the extensions a part may have.
pub(super) fn find(
    dir: &Path,
    stem: &str,
    extensions: &[&str],
) -> Result<Option<PathBuf>, FolderError> {
    let mut found: Option<PathBuf> = None;
    for extension in extensions {
        let path = dir.join(format!("{stem}.{extension}"));
        match path.symlink_metadata() {
            Ok(_) => {}
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(source) => return Err(FolderError::Io { path, source }),
        }
        if let Some(other) = found {
            return Err(FolderError::Field {
                path: dir.into(),
                field: stem.into(),
                problem: format!(
                    "stands there twice, as {} and {}",
                    name(&other),
                    name(&path)
                ),
                remedy: "keep one of the two".into(),
            });
        }
        found = Some(path);
    }
    Ok(found)
}

/// As [`find`], for a part the folder cannot do without.
pub(super) fn need(
    dir: &Path,
    stem: &str,
    extensions: &[&str],
    what: &str,
) -> Result<PathBuf, FolderError> {
    find(dir, stem, extensions)?.ok_or_else(|| FolderError::Missing {
        path: dir.join(format!("{stem}.{}", extensions.join("|"))),
        remedy: format!("add {what}"),
    })
}

fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn wrong_kind(path: &Path, samples: &Samples, remedy: &str) -> FolderError {
    FolderError::Field {
        path: path.into(),
        field: "samples".into(),
        problem: format!("are {}", samples.describe()),
        remedy: remedy.into(),
    }
}

/// The samples of a picture that lies as it is stored. One that viewers turn is refused: nobody can
/// know whether the lens in `capture.toml` was measured before or after the turn.
fn samples(path: &Path, size: (usize, usize)) -> Result<Samples, FolderError> {
    let decoded = decode_limited(path, Some(size), Limits::default())?;
    if decoded.orientation != 1 {
        return Err(FolderError::Field {
            path: path.into(),
            field: "EXIF orientation".into(),
            problem: format!(
                "is {}: viewers turn or mirror the picture, but capture.toml speaks of its pixels as they are stored",
                decoded.orientation
            ),
            remedy: "save it upright with no such tag, and give the lens for that picture".into(),
        });
    }
    Ok(decoded.samples)
}

/// A photograph; gray is replicated, ±∞ becomes NaN = unknown.
pub(super) fn photograph(path: &Path, size: (usize, usize)) -> Result<Pixels, FolderError> {
    Ok(match samples(path, size)? {
        Samples::Gray8(plane) => Pixels::Rgb8(plane.map(|&value| [value; 3])),
        Samples::Gray16(plane) => Pixels::Rgb16(plane.map(|&value| [value; 3])),
        Samples::GrayF32(plane) => Pixels::RgbF32(plane.map(|&value| finite([value; 3]))),
        Samples::Rgb8(plane) => Pixels::Rgb8(plane),
        Samples::Rgb16(plane) => Pixels::Rgb16(plane),
        Samples::RgbF32(plane) => Pixels::RgbF32(plane.map(|&rgb| finite(rgb))),
    })
}

/// NaN in all three channels when one of them is no number.
pub(super) fn finite(rgb: [f32; 3]) -> [f32; 3] {
    if rgb.iter().all(|value| value.is_finite()) {
        rgb
    } else {
        [f32::NAN; 3]
    }
}

/// Distances in metres; 0, negative and no number become NaN = no answer.
pub(super) fn depth(
    path: &Path,
    size: (usize, usize),
    unit_metres: f64,
) -> Result<Plane<f32>, FolderError> {
    let answer = |metres: f32| {
        if metres.is_finite() && metres > 0.0 {
            metres
        } else {
            f32::NAN
        }
    };
    match samples(path, size)? {
        Samples::Gray16(plane) => {
            Ok(plane.map(|&value| answer((f64::from(value) * unit_metres) as f32)))
        }
        Samples::GrayF32(plane) => Ok(plane.map(|&value| answer(value))),
        other => Err(wrong_kind(
            path,
            &other,
            "save depth as a 16-bit gray PNG in depth_unit_metres, or a one-channel EXR in metres",
        )),
    }
}

/// One channel of data that no tone curve was ever applied to: full scale 1, or as written in EXR.
pub(super) fn data(path: &Path, size: (usize, usize)) -> Result<Plane<f32>, FolderError> {
    match samples(path, size)? {
        Samples::Gray8(plane) => Ok(plane.map(|&value| f32::from(value) / 255.0)),
        Samples::Gray16(plane) => Ok(plane.map(|&value| f32::from(value) / 65535.0)),
        Samples::GrayF32(plane) => {
            Ok(plane.map(|&value| if value.is_finite() { value } else { f32::NAN }))
        }
        Samples::Rgb8(plane) if plane.samples().iter().all(|[r, g, b]| r == g && g == b) => {
            Ok(plane.map(|rgb| f32::from(rgb[0]) / 255.0))
        }
        Samples::Rgb16(plane) if plane.samples().iter().all(|[r, g, b]| r == g && g == b) => {
            Ok(plane.map(|rgb| f32::from(rgb[0]) / 65535.0))
        }
        other => Err(wrong_kind(path, &other, "save it with one gray channel")),
    }
}

/// ToF amplitude in the device's own units (PNG numbers as they stand); negative = no answer.
pub(super) fn amplitude(path: &Path, size: (usize, usize)) -> Result<Plane<f32>, FolderError> {
    match samples(path, size)? {
        Samples::Gray8(plane) => Ok(plane.map(|&value| f32::from(value))),
        Samples::Gray16(plane) => Ok(plane.map(|&value| f32::from(value))),
        Samples::GrayF32(plane) => Ok(plane.map(|&v| {
            if v.is_finite() && v >= 0.0 {
                v
            } else {
                f32::NAN
            }
        })),
        other => Err(wrong_kind(
            path,
            &other,
            "save the amplitude with one gray channel",
        )),
    }
}

/// Non-zero = counts.
pub(super) fn mask(path: &Path, size: (usize, usize)) -> Result<Plane<bool>, FolderError> {
    Ok(match samples(path, size)? {
        Samples::Gray8(plane) => plane.map(|&value| value != 0),
        Samples::Gray16(plane) => plane.map(|&value| value != 0),
        Samples::GrayF32(plane) => plane.map(|&value| value > 0.0),
        Samples::Rgb8(plane) => plane.map(|rgb| *rgb != [0; 3]),
        Samples::Rgb16(plane) => plane.map(|rgb| *rgb != [0; 3]),
        Samples::RgbF32(plane) => plane.map(|rgb| rgb.iter().any(|&value| value > 0.0)),
    })
}

/// A truth picture in linear light: 8-bit is sRGB, everything else linear already.
pub(super) fn linear(path: &Path, size: (usize, usize)) -> Result<Plane<[f32; 3]>, FolderError> {
    let eight: [f32; 256] = std::array::from_fn(|value| srgb_decode(value as f32 / 255.0));
    let sixteen = |value: u16| f32::from(value) / 65535.0;
    Ok(match samples(path, size)? {
        Samples::Gray8(plane) => plane.map(|&value| [eight[usize::from(value)]; 3]),
        Samples::Gray16(plane) => plane.map(|&value| [sixteen(value); 3]),
        Samples::GrayF32(plane) => plane.map(|&value| finite([value; 3])),
        Samples::Rgb8(plane) => plane.map(|rgb| rgb.map(|value| eight[usize::from(value)])),
        Samples::Rgb16(plane) => plane.map(|rgb| rgb.map(sixteen)),
        Samples::RgbF32(plane) => plane.map(|&rgb| finite(rgb)),
    })
}

/// Unit normals in camera axes (x right, y down, z forward) of a file with x right, y up, z toward
/// the camera; what is no direction becomes NaN = unknown.
pub(super) fn normals(path: &Path, size: (usize, usize)) -> Result<Plane<Vec3>, FolderError> {
    Ok(vectors(path, size)?.map(|&[x, y, z]| {
        let normal = Vec3::new(x, -y, -z);
        let length = normal.length();
        if length.is_finite() && length >= MIN_NORMAL_LENGTH {
            normal / length
        } else {
            Vec3::NAN
        }
    }))
}

/// Three components in [−1, 1]: as written in EXR, (n+1)/2 in PNG.
fn vectors(path: &Path, size: (usize, usize)) -> Result<Plane<[f32; 3]>, FolderError> {
    match samples(path, size)? {
        Samples::Rgb8(plane) => Ok(plane.map(|rgb| rgb.map(|v| f32::from(v) / 255.0 * 2.0 - 1.0))),
        Samples::Rgb16(plane) => {
            Ok(plane.map(|rgb| rgb.map(|v| f32::from(v) / 65535.0 * 2.0 - 1.0)))
        }
        Samples::RgbF32(plane) => Ok(plane),
        other => Err(wrong_kind(
            path,
            &other,
            "save normals with three channels: x, y, z",
        )),
    }
}
