//! OpenEXR with every plane of a scene as a layer.

use super::{ExportError, mesh::person};
use crate::{
    output::{Precision, exr},
    scene::Scene,
};
use drivers::Plane;

/// In the order of the alphabet, as files have them.
const CHANNELS: [&str; 10] = [
    "albedo.B",
    "albedo.G",
    "albedo.R",
    "confidence.Y",
    "depth.Z",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "roughness.Y",
    "sigma.Z",
];

pub(super) fn encoded(scene: &Scene) -> Result<Vec<u8>, ExportError> {
    let (width, height) = scene.albedo.size();
    let planes = Plane::from_fn(width, height, |x, y| {
        let at = (x, y);
        let ([red, green, blue], normal) = (scene.albedo[at], person(scene.normal[at]));
        [
            blue,
            green,
            red,
            scene.confidence[at],
            scene.depth_metres[at],
            normal.x,
            normal.y,
            normal.z,
            scene.roughness[at],
            scene.depth_sigma_metres[at],
        ]
    });
    // Metres ask for whole floats.
    Ok(exr::layers(&planes, &CHANNELS, Precision::Float)?)
}
