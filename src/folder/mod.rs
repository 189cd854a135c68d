//! The capture folder: the plain form a capture is read from and written to.

mod answers;
pub mod decode;
mod error;
mod images;
mod import;
mod rig;
mod toml;
mod truth;
mod write;

pub use answers::Answers;
pub use decode::{Decoded, ImageError, ImageKind, Limits, Samples, decode_limited};
pub use error::FolderError;
pub use import::{Imported, import, mask_beside, read_mask_beside, truth_beside};
pub use rig::RigFile;
pub use truth::{Truth, TruthLight, read_truth};
pub use write::{write, write_on, write_with_truth};

use crate::shot::Shot;
use drivers::{
    ColorFrame, DepthFrame, Exposure, Illumination, Timestamp,
    rig_file::{Declared, without_offset},
};
use std::path::Path;

/// Extensions a photograph may have.
const PHOTOGRAPH: &[&str] = &["png", "exr", "jpg", "jpeg"];
/// Extensions a plane of data may have.
const DATA: &[&str] = &["png", "exr"];
/// A folder has no clock: the ambient frame stands at the clock's zero, the rest just after.
const AMBIENT_AT: Timestamp = Timestamp::from_nanos(0);
const FLASH_AT: Timestamp = Timestamp::from_nanos(1);

/// One capture folder.
#[derive(Debug, Clone)]
pub struct Capture {
    /// The folder's own name.
    pub name: String,
    /// What was photographed.
    pub shot: Shot,
    /// What should come out, where the folder has a `truth/`.
    pub truth: Option<Truth>,
}

/// Reads a capture folder.
///
/// Absent exposures count as equal, one second at base gain; an absent `[depth]` table means depth
/// on the color grid, PNG in millimetres. `flash.intensity` is converted to unit exposure.
///
/// # Errors
/// [`FolderError::Missing`] for a required file, [`FolderError::Toml`] for an unknown, missing or
/// mistyped key, [`FolderError::Field`] for a value that cannot be, [`FolderError::Image`] for a
/// picture that cannot be decoded or has another size than declared.
pub fn read(dir: &Path) -> Result<Capture, FolderError> {
    let path = dir.join("capture.toml");
    if matches!(path.symlink_metadata(), Err(error) if error.kind() == std::io::ErrorKind::NotFound)
    {
        return Err(FolderError::Missing {
            path,
            remedy: "add the file that describes the cameras, or name a capture folder".into(),
        });
    }
    let declared = toml::declared(&path)?;
    let color = declared.rig.color.size();
    let depth_size = declared
        .rig
        .depth
        .map_or(color, |camera| camera.lens.size());

    let flash = images::need(dir, "flash", PHOTOGRAPH, "the photograph with the flash on")?;
    let depth = images::need(dir, "depth", DATA, "the depth map")?;
    let ambient = images::find(dir, "ambient", PHOTOGRAPH)?;
    let amplitude = images::find(dir, "amplitude", DATA)?;
    let mask = images::find(dir, "mask", &["png"])?;

    let flash = photograph(&declared, &flash, Illumination::Flash)?;
    let ambient = match ambient {
        Some(path) => vec![photograph(&declared, &path, Illumination::Ambient)?],
        None => Vec::new(),
    };
    let depth = DepthFrame {
        at: FLASH_AT,
        sequence: 0,
        metres: images::depth(&depth, depth_size, declared.depth_unit_metres)?
            .map(|metres| without_offset(*metres, declared.depth_offset_metres as f32)),
        amplitude: amplitude
            .map(|path| images::amplitude(&path, depth_size))
            .transpose()?,
        sigma: None,
    };
    let mask = mask.map(|path| images::mask(&path, color)).transpose()?;
    let truth = read_truth(&dir.join("truth"), color, declared.depth_unit_metres)?;
    Ok(Capture {
        name: name_of(dir),
        shot: Shot {
            flash,
            ambient,
            depth,
            rig: declared.rig,
            mask,
        },
        truth,
    })
}

fn photograph(
    declared: &Declared,
    path: &Path,
    light: Illumination,
) -> Result<ColorFrame, FolderError> {
    let (at, sequence, exposure): (Timestamp, u64, Exposure) = match light {
        Illumination::Ambient => (AMBIENT_AT, 0, declared.ambient_exposure),
        Illumination::Flash => (FLASH_AT, 1, declared.flash_exposure),
    };
    Ok(ColorFrame {
        at,
        sequence,
        light,
        exposure,
        pixels: images::photograph(path, declared.rig.color.size())?,
        transfer: declared.transfer.clone(),
        black_level: declared.black_level,
        white_level: declared.white_level,
    })
}

/// The folder's last name, also for `.` and for paths with a trailing slash.
fn name_of(dir: &Path) -> String {
    let known = dir.file_name().map(ToOwned::to_owned);
    let name = known.or_else(|| dir.canonicalize().ok()?.file_name().map(ToOwned::to_owned));
    name.map_or_else(
        || "capture".into(),
        |name| name.to_string_lossy().into_owned(),
    )
}
