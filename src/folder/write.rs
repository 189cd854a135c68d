//! Shot → capture folder, as [`super::read`] reads it.

use super::FolderError;
use crate::{
    output::{Disk, EncodeError, Existing, FileSystem, Precision, Staging, exr, png},
    radiometry,
    shot::Shot,
};
use drivers::{
    ColorFrame, DepthCamera, Exposure, FlashLamp, Illumination, Pixels, Plane, Transfer,
    rig_file::{ColorTable, DepthTable, FlashTable, RigToml, millimetre},
};
use std::path::Path;

/// A photograph as a file: extension and bytes.
type Encoded = (&'static str, Vec<u8>);

/// Writes a shot as a capture folder at `dir`, which appears whole or not at all, and says in plain
/// words what of the shot a folder cannot hold (times, depth sigma, a second ambient frame).
///
/// Pictures keep their numbers where one curve and one pair of levels serve all of them; raw and
/// YUV pictures are stored as linear EXR. Depth is stored in metres, as float EXR.
///
/// # Errors
/// [`FolderError::Commit`] when `dir` exists, is not empty or cannot be written;
/// [`FolderError::Unwritable`] for pictures that cannot be decoded.
pub fn write(dir: &Path, shot: &Shot) -> Result<Vec<String>, FolderError> {
    write_on(&Disk, dir, shot)
}

/// [`write()`], with the files of a truth folder copied into `truth/`.
///
/// # Errors
/// As [`write()`]; [`FolderError::Io`] for a file of the truth that cannot be read.
pub fn write_with_truth(dir: &Path, shot: &Shot, truth: &Path) -> Result<Vec<String>, FolderError> {
    write_all(&Disk, dir, shot, Some(truth))
}

/// [`write()`] on a file system of choice.
///
/// # Errors
/// As [`write()`].
pub fn write_on(
    disk: &dyn FileSystem,
    dir: &Path,
    shot: &Shot,
) -> Result<Vec<String>, FolderError> {
    write_all(disk, dir, shot, None)
}

fn write_all(
    disk: &dyn FileSystem,
    dir: &Path,
    shot: &Shot,
    truth: Option<&Path>,
) -> Result<Vec<String>, FolderError> {
    let unwritable = |part: &str, problem: String| FolderError::Unwritable {
        path: dir.into(),
        problem: format!("{part} {problem}"),
        remedy: "keep the shot as a recording instead".into(),
    };
    let encoding = |part: &'static str| {
        move |error: EncodeError| unwritable(part, format!("cannot be encoded: {error}"))
    };
    let mut losses = vec!["A capture folder holds no times of exposure.".to_owned()];
    let ambient = shot
        .ambient
        .iter()
        .min_by_key(|frame| frame.at.distance(shot.flash.at));
    if shot.ambient.len() > 1 {
        losses.push("Only the ambient frame nearest in time to the flash frame was kept.".into());
    }
    if shot.depth.sigma.is_some() {
        losses.push("The depth camera's own sigma was dropped.".into());
    }

    let frames = std::iter::once(&shot.flash).chain(ambient);
    let as_is = frames.clone().all(|frame| {
        storable(frame)
            && frame.transfer == shot.flash.transfer
            && frame.black_level == shot.flash.black_level
            && frame.white_level == shot.flash.white_level
    });
    let mut photographs = Vec::new();
    for frame in frames {
        let stem = match frame.light {
            Illumination::Flash => "flash",
            Illumination::Ambient => "ambient",
        };
        let (extension, bytes) = if as_is {
            stored(frame).map_err(encoding(stem))?
        } else {
            let light = radiometry::linearise(frame)
                .map_err(|error| unwritable(stem, format!("cannot be decoded: {error}")))?;
            // Back to fractions of white, so that the exposure in capture.toml stays true.
            let factor = frame.exposure.factor();
            let relative = light.0.map(|rgb| rgb.map(|value| value * factor));
            (
                "exr",
                exr::rgb(&relative, Precision::Float).map_err(encoding(stem))?,
            )
        };
        photographs.push((format!("{stem}.{extension}"), bytes));
    }

    let text = ::toml::to_string(&table(shot, ambient, as_is))
        .map_err(|error| unwritable("capture.toml", format!("cannot be written: {error}")))?;
    let ours = |_: &str| false;
    let mut staging = Staging::begin(disk, dir, Existing::Refuse, ours)?;
    staging.put("capture.toml", text.as_bytes())?;
    for (name, bytes) in photographs {
        staging.put(&name, &bytes)?;
    }
    let float = |part: &'static str, plane: &Plane<f32>| {
        exr::gray(plane, Precision::Float).map_err(encoding(part))
    };
    staging.put("depth.exr", &float("depth", &shot.depth.metres)?)?;
    if let Some(amplitude) = &shot.depth.amplitude {
        staging.put("amplitude.exr", &float("amplitude", amplitude)?)?;
    }
    if let Some(mask) = &shot.mask {
        staging.put("mask.png", &png::mask(mask).map_err(encoding("mask"))?)?;
    }
    if let Some(truth) = truth {
        staging.folder("truth")?;
        super::import::put_truth(&mut staging, truth, "truth/")?;
    }
    staging.commit()?;
    Ok(losses)
}

/// True for pictures a folder holds number by number.
fn storable(frame: &ColorFrame) -> bool {
    match &frame.pixels {
        Pixels::Rgb8(_) | Pixels::Rgb16(_) | Pixels::RgbF32(_) | Pixels::Mjpg { .. } => true,
        Pixels::Bayer { .. } | Pixels::Yuyv { .. } | Pixels::Nv12 { .. } => false,
    }
}

fn stored(frame: &ColorFrame) -> Result<Encoded, EncodeError> {
    match &frame.pixels {
        Pixels::Rgb8(plane) => Ok(("png", png::rgb8(plane)?)),
        Pixels::Rgb16(plane) => Ok(("png", png::rgb16(plane)?)),
        Pixels::RgbF32(plane) => Ok(("exr", exr::rgb(plane, Precision::Float)?)),
        Pixels::Mjpg { bytes, .. } => Ok(("jpg", bytes.clone())),
        Pixels::Bayer { .. } | Pixels::Yuyv { .. } | Pixels::Nv12 { .. } => {
            Err(EncodeError::Exr("raw samples are no picture yet".into()))
        }
    }
}

fn table(shot: &Shot, ambient: Option<&ColorFrame>, as_is: bool) -> RigToml {
    let (lens, flash) = (shot.rig.color, &shot.flash);
    RigToml {
        format: 1,
        color: ColorTable {
            width: lens.width,
            height: lens.height,
            fx: lens.fx,
            fy: lens.fy,
            cx: lens.cx,
            cy: lens.cy,
            distortion: lens.distortion,
            transfer: if as_is {
                flash.transfer.clone()
            } else {
                Transfer::Linear
            },
            black_level: if as_is { flash.black_level } else { 0.0 },
            white_level: if as_is { flash.white_level } else { 1.0 },
            flash_exposure: Some(flash.exposure),
            ambient_exposure: ambient.map(|frame| frame.exposure),
        },
        depth: shot.rig.depth.as_ref().map(depth_table),
        flash: flash_table(&shot.rig.flash, flash.exposure),
    }
}

/// The depth camera, its distances as they should be.
pub(super) fn depth_table(camera: &DepthCamera) -> DepthTable {
    DepthTable {
        width: camera.lens.width,
        height: camera.lens.height,
        fx: camera.lens.fx,
        fy: camera.lens.fy,
        cx: camera.lens.cx,
        cy: camera.lens.cy,
        distortion: camera.lens.distortion,
        depth_unit_metres: millimetre(),
        rotation: camera.to_color.rotation.transpose().to_cols_array_2d(),
        translation_metres: camera.to_color.translation_metres.to_array(),
        offset_metres: 0.0,
    }
}

/// The flash, in the values of a photograph of this exposure.
pub(super) fn flash_table(flash: &FlashLamp, exposure: Exposure) -> FlashTable {
    FlashTable {
        position_metres: flash.position_metres.to_array(),
        intensity: flash.intensity.map(|value| value * exposure.factor()),
        beam: flash.beam,
    }
}
