//! A developed scene in the files of neighbouring tools: glTF, PLY, OpenEXR with layers, PTM.
//!
//! Positions and normals are in metres and in people's axes: x right, y up, z toward the camera, the camera
//! at the origin.

mod gltf;
mod layers;
mod mesh;
mod ply;
mod ptm;

use crate::{output::EncodeError, relight::Prepared, scene::Scene};
use std::str::FromStr;
use thiserror::Error;

/// What a scene is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Binary glTF 2.0 (Khronos 2021): a mesh of the front that was seen, with textures of albedo, normals and
    /// roughness.
    Gltf,
    /// Binary PLY (Stanford): the mesh at the depth's own detail, with normals, colors, roughness and confidence.
    Ply,
    /// OpenEXR: albedo, normal, roughness, depth, sigma and confidence as layers of one file.
    Layers,
    /// Polynomial texture map (Malzbender, Gelb, Wolters 2001), LRGB: relit under many lamps, for RTI viewers.
    Ptm,
}

impl FromStr for Format {
    type Err = String;

    /// By a file name's extension.
    fn from_str(extension: &str) -> Result<Self, String> {
        match extension.to_ascii_lowercase().as_str() {
            "glb" => Ok(Self::Gltf),
            "ply" => Ok(Self::Ply),
            "exr" => Ok(Self::Layers),
            "ptm" => Ok(Self::Ptm),
            _ => Err("it must end in .glb, .ply, .exr or .ptm".to_owned()),
        }
    }
}

/// Why there is no file.
#[derive(Debug, Error)]
pub enum ExportError {
    /// Nothing to write.
    #[error("no surface of the scene is known; take the shot again")]
    Nothing,
    /// A picture in it could not be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

/// The bytes of a file; `prepared` is `scene` made ready for lamps.
///
/// # Errors
/// [`ExportError`] for a scene of which nothing is known.
pub fn encoded(scene: &Scene, prepared: &Prepared, format: Format) -> Result<Vec<u8>, ExportError> {
    if scene
        .albedo
        .samples()
        .iter()
        .all(|albedo| albedo[0].is_nan())
    {
        return Err(ExportError::Nothing);
    }
    match format {
        Format::Gltf => gltf::encoded(scene),
        Format::Ply => ply::encoded(scene),
        Format::Layers => layers::encoded(scene),
        Format::Ptm => Ok(ptm::encoded(prepared)),
    }
}
