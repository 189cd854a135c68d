//! `rig.toml`: what is known of a rig, in the words of `capture.toml` and without pictures.

use super::{
    FolderError, toml,
    write::{depth_table, flash_table},
};
use drivers::{
    Exposure, Rig, Transfer,
    rig_file::{ColorTable, DepthTable, RigToml},
};
use std::path::Path;

/// A rig that was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct RigFile {
    /// Its geometry and its flash.
    pub rig: Rig,
    /// To be subtracted from what the depth camera says, metres.
    pub depth_offset_metres: f64,
    /// How values of the color camera relate to light.
    pub transfer: Transfer,
    /// Value of no light, as a fraction of full scale.
    pub black_level: f32,
    /// Value at which the color camera clips, as a fraction of full scale.
    pub white_level: f32,
}

impl RigFile {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`FolderError`] naming the file and the field.
    pub fn read(path: &Path) -> Result<Self, FolderError> {
        let found = toml::declared(path)?;
        Ok(Self {
            rig: found.rig,
            depth_offset_metres: found.depth_offset_metres,
            transfer: found.transfer,
            black_level: found.black_level,
            white_level: found.white_level,
        })
    }

    /// The file's text; beside pictures of a shot it is a `capture.toml`.
    ///
    /// # Errors
    /// [`FolderError::Unwritable`] for a field that TOML cannot hold; `path` is for the message.
    pub fn text(&self, path: &Path) -> Result<String, FolderError> {
        let lens = self.rig.color;
        let table = RigToml {
            format: 1,
            color: ColorTable {
                width: lens.width,
                height: lens.height,
                fx: lens.fx,
                fy: lens.fy,
                cx: lens.cx,
                cy: lens.cy,
                distortion: lens.distortion,
                transfer: self.transfer.clone(),
                black_level: self.black_level,
                white_level: self.white_level,
                flash_exposure: None,
                ambient_exposure: None,
            },
            depth: self.rig.depth.map(|camera| DepthTable {
                offset_metres: self.depth_offset_metres,
                ..depth_table(&camera)
            }),
            flash: flash_table(&self.rig.flash, Exposure::UNIT),
        };
        ::toml::to_string(&table).map_err(|error| FolderError::Unwritable {
            path: path.to_owned(),
            problem: error.to_string(),
            remedy: "report this as a bug".to_owned(),
        })
    }
}
