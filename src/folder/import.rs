//! Capture folder → recording, with the mask and the truth beside it.

use super::{Capture, FolderError, images, read};
use crate::output::{CommitError, Disk, Existing, FileSystem as _, StagedFile, Staging, png};
use drivers::{
    DeviceInfo, DriverError, Frame, Illumination, Pixels, Plane, Settings, recording::Writer,
};
use std::path::{Path, PathBuf};

/// Largest file of a truth folder that is copied.
const MAX_TRUTH_BYTES: u64 = 1 << 30;

/// What an import made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Imported {
    /// Files and folders made, the recording first.
    pub made: Vec<PathBuf>,
    /// What to know about them, in plain words.
    pub notes: Vec<String>,
}

/// Where a recording's mask lies: `NAME.mask.png` beside `NAME.mcap`.
pub fn mask_beside(recording: &Path) -> PathBuf {
    recording.with_extension("mask.png")
}

/// Where a recording's truth lies: `NAME.truth/` beside `NAME.mcap`.
pub fn truth_beside(recording: &Path) -> PathBuf {
    recording.with_extension("truth")
}

/// Reads the mask beside a recording; `None` where there is none. Non-zero = counts.
///
/// # Errors
/// [`FolderError::Image`] for a file that cannot be decoded or is not of the color grid's `size`.
pub fn read_mask_beside(
    recording: &Path,
    size: (usize, usize),
) -> Result<Option<Plane<bool>>, FolderError> {
    let path = mask_beside(recording);
    if path.symlink_metadata().is_err() {
        return Ok(None);
    }
    images::mask(&path, size).map(Some)
}

/// Turns a capture folder into a recording at `recording` (which must not exist), its mask and
/// truth beside it. The recording appears whole or not at all, and last.
///
/// A folder without ambient picture holds the flash alone; since replay proves a flash against an
/// ambient frame, one of no light at all is recorded, which subtracts to the same.
///
/// # Errors
/// What [`read`] says of the folder; [`FolderError::Recording`], [`FolderError::Commit`] and
/// [`FolderError::Io`] when the recording exists or cannot be written.
pub fn import(dir: &Path, recording: &Path) -> Result<Imported, FolderError> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |source| FolderError::Io { path, source }
    };
    let capture = read(dir)?;
    let staged = StagedFile::begin(recording)?;
    let mut notes = Vec::new();
    let mut made = vec![recording.to_path_buf()];
    let result = (|| {
        record(dir, &capture, staged.partial(), &mut notes).map_err(|error| match error {
            FolderError::Recording(DriverError::Io { source, .. }) => {
                CommitError::unwritten(recording, source).into()
            }
            other => other,
        })?;
        if let Some(mask) = &capture.shot.mask {
            let path = mask_beside(recording);
            let bytes = png::mask(mask).map_err(|error| FolderError::Unwritable {
                path: path.clone(),
                problem: error.to_string(),
                remedy: "leave the mask out".into(),
            })?;
            Disk.write_new(&path, &bytes).map_err(io(&path))?;
            notes.push("The mask lies beside the recording; keep the two together.".into());
            made.push(path);
        }
        if capture.truth.is_some() {
            let path = truth_beside(recording);
            copy_truth(&dir.join("truth"), &path)?;
            notes.push("The truth lies beside the recording; keep the two together.".into());
            made.push(path);
        }
        Ok(staged.commit()?)
    })();
    if let Err(error) = result {
        // Only what this call made is taken back; the recording is the last to appear.
        for path in &made[1..] {
            let _ = if path.is_dir() {
                std::fs::remove_dir_all(path)
            } else {
                std::fs::remove_file(path)
            };
        }
        return Err(error);
    }
    Ok(Imported { made, notes })
}

fn record(
    dir: &Path,
    capture: &Capture,
    partial: &Path,
    notes: &mut Vec<String>,
) -> Result<(), FolderError> {
    let shot = &capture.shot;
    let info = DeviceInfo {
        address: format!("folder:{}", capture.name),
        driver: "folder".into(),
        model: format!(
            "capture folder {}",
            dir.file_name().unwrap_or_default().to_string_lossy()
        ),
        finite: true,
    };
    let settings = Settings {
        exposure_seconds: Some(shot.flash.exposure.seconds),
        gain: Some(shot.flash.exposure.gain),
        ..Settings::default()
    };
    let mut ambient = shot.ambient.clone();
    if ambient.is_empty() {
        let (width, height) = shot.flash.pixels.size();
        let mut dark = shot.flash.clone();
        // The code of no light depends on the curve only through its zero, which all curves keep.
        dark.pixels = Pixels::RgbF32(Plane::filled(width, height, [shot.flash.black_level; 3]));
        dark.light = Illumination::Ambient;
        dark.at = super::AMBIENT_AT;
        dark.sequence = 0;
        notes.push("The folder has no ambient picture; one without light was recorded.".into());
        ambient.push(dark);
    }
    let mut writer = Writer::create(partial, &info, &shot.rig, &settings)?;
    for frame in ambient {
        writer.push(&Frame::Color(frame))?;
    }
    writer.push(&Frame::Color(shot.flash.clone()))?;
    writer.push(&Frame::Depth(shot.depth.clone()))?;
    writer.finish_bracket()?;
    writer.close()?;
    Ok(())
}

/// Copies the regular files of a truth folder.
fn copy_truth(from: &Path, to: &Path) -> Result<(), FolderError> {
    let mut staging = Staging::begin(&Disk, to, Existing::Refuse, |_| false)?;
    put_truth(&mut staging, from, "")?;
    Ok(staging.commit()?)
}

/// Puts the regular files of a truth folder into one being written, their names after `before`.
pub(super) fn put_truth(
    staging: &mut Staging<'_>,
    from: &Path,
    before: &str,
) -> Result<(), FolderError> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |source| FolderError::Io { path, source }
    };
    for name in Disk.list(from).map_err(io(from))?.unwrap_or_default() {
        let path = from.join(&name);
        let metadata = path.metadata().map_err(io(&path))?;
        if metadata.is_file() && metadata.len() <= MAX_TRUTH_BYTES {
            let bytes = std::fs::read(&path).map_err(io(&path))?;
            staging.put(&format!("{before}{name}"), &bytes)?;
        }
    }
    Ok(())
}
