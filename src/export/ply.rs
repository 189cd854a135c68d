//! Binary PLY, little-endian.

use super::{ExportError, mesh::Mesh};
use crate::{radiometry::transfer::srgb_encode, scene::Scene};

/// Vertices of the mesh: that of a photograph's working grid.
const MOST_VERTICES: usize = 2_100_000;

pub(super) fn encoded(scene: &Scene) -> Result<Vec<u8>, ExportError> {
    let mesh = Mesh::of(scene, MOST_VERTICES);
    if mesh.positions.is_empty() {
        return Err(ExportError::Nothing);
    }
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\ncomment metres; x right, y up, z toward the camera; colors are sRGB albedo\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         property float roughness\nproperty float confidence\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    let vertices = mesh.positions.iter().zip(&mesh.normals).zip(&mesh.pixels);
    for ((position, normal), pixel) in vertices {
        for value in position.to_array().into_iter().chain(normal.to_array()) {
            file.extend(value.to_le_bytes());
        }
        let albedo = scene.albedo[*pixel];
        file.extend(albedo.map(|value| (255.0 * srgb_encode(value.clamp(0.0, 1.0))).round() as u8));
        for value in [scene.roughness[*pixel], scene.confidence[*pixel]] {
            file.extend(value.to_le_bytes());
        }
    }
    for triangle in &mesh.triangles {
        file.push(3);
        file.extend(triangle.iter().flat_map(|number| number.to_le_bytes()));
    }
    Ok(file)
}
