//! Binary glTF 2.0: one mesh, three textures.

use super::{
    ExportError,
    mesh::{Mesh, person},
};
use crate::{output::png, radiometry::transfer::srgb_encode, scene::Scene};
use drivers::Plane;
use glam::Vec3;
use serde_json::{Value, json};

/// Vertices of the mesh; finer detail is in the textures.
const MOST_VERTICES: usize = 65_536;
/// Component types of accessors.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
/// Targets of buffer views.
const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;

/// One binary buffer and what lies where in it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
}

impl Buffer {
    /// Adds a view, aligned to four bytes; returns its number.
    fn add(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend(bytes);
        self.views.push(view);
        self.views.len() - 1
    }
}

pub(super) fn encoded(scene: &Scene) -> Result<Vec<u8>, ExportError> {
    let mesh = Mesh::of(scene, MOST_VERTICES);
    if mesh.triangles.is_empty() {
        return Err(ExportError::Nothing);
    }
    let (width, height) = scene.albedo.size();
    let floats = |values: &mut dyn Iterator<Item = f32>| -> Vec<u8> {
        values.flat_map(f32::to_le_bytes).collect()
    };
    let vectors = |vectors: &[Vec3]| floats(&mut vectors.iter().flat_map(|v| v.to_array()));
    let tangents = mesh.normals.iter().flat_map(|normal| {
        let Vec3 { x, y, z } = tangent(*normal);
        [x, y, z, 1.0]
    });
    let places = mesh.pixels.iter().flat_map(|(x, y)| {
        [
            (*x as f32 + 0.5) / width as f32,
            (*y as f32 + 0.5) / height as f32,
        ]
    });
    let mut buffer = Buffer::default();
    let views = [
        buffer.add(&vectors(&mesh.positions), Some(ARRAY_BUFFER)),
        buffer.add(&vectors(&mesh.normals), Some(ARRAY_BUFFER)),
        buffer.add(&floats(&mut tangents.into_iter()), Some(ARRAY_BUFFER)),
        buffer.add(&floats(&mut places.into_iter()), Some(ARRAY_BUFFER)),
    ];
    let corners = mesh.triangles.iter().flatten();
    let corners: Vec<u8> = corners.flat_map(|number| number.to_le_bytes()).collect();
    let corners = buffer.add(&corners, Some(ELEMENT_ARRAY_BUFFER));
    let pictures = textures(scene, &mesh);
    let images: Vec<Value> = pictures
        .iter()
        .map(|picture| {
            let view = buffer.add(&png::rgb8(picture)?, None);
            Ok(json!({ "bufferView": view, "mimeType": "image/png" }))
        })
        .collect::<Result<_, ExportError>>()?;
    let (least, most) = mesh.positions.iter().fold(
        (Vec3::INFINITY, Vec3::NEG_INFINITY),
        |(least, most), position| (least.min(*position), most.max(*position)),
    );
    let accessor = |view: usize, kind: u32, count: usize, shape: &str| json!({ "bufferView": view, "componentType": kind, "count": count, "type": shape });
    let vertices = mesh.positions.len();
    let mut accessors = vec![
        accessor(views[0], FLOAT, vertices, "VEC3"),
        accessor(views[1], FLOAT, vertices, "VEC3"),
        accessor(views[2], FLOAT, vertices, "VEC4"),
        accessor(views[3], FLOAT, vertices, "VEC2"),
        accessor(corners, UNSIGNED_INT, 3 * mesh.triangles.len(), "SCALAR"),
    ];
    accessors[0]["min"] = json!(least.to_array());
    accessors[0]["max"] = json!(most.to_array());
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("captured ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "front" }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3 },
            "indices": 4,
            "material": 0,
        }] }],
        "materials": [{
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": 0 },
                "metallicRoughnessTexture": { "index": 2 },
            },
            "normalTexture": { "index": 1 },
        }],
        "textures": [{ "source": 0, "sampler": 0 }, { "source": 1, "sampler": 0 }, { "source": 2, "sampler": 0 }],
        "samplers": [{ "wrapS": 33_071, "wrapT": 33_071 }],
        "images": images,
        "accessors": accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    Ok(container(&document.to_string(), buffer.bytes))
}

/// The direction in which the texture's first coordinate grows, along the surface.
fn tangent(normal: Vec3) -> Vec3 {
    let along = Vec3::X - normal * normal.x;
    along.try_normalize().unwrap_or(Vec3::Y)
}

/// Albedo (sRGB), normals in the frame of the mesh, and roughness (green; not metallic).
fn textures(scene: &Scene, mesh: &Mesh) -> [Plane<[u8; 3]>; 3] {
    let (width, height) = scene.albedo.size();
    let byte = |value: f32| (255.0 * value.clamp(0.0, 1.0)).round() as u8;
    let albedo = scene
        .albedo
        .map(|albedo| albedo.map(|value| byte(srgb_encode(value.max(0.0)))));
    let normal = Plane::from_fn(width, height, |x, y| {
        let own = person(scene.normal[(x, y)]);
        let frame = mesh.normal_at((x, y)).filter(|_| own.is_finite());
        let local = frame.map_or(Vec3::Z, |around| {
            let along = tangent(around);
            Vec3::new(
                own.dot(along),
                own.dot(around.cross(along)),
                own.dot(around),
            )
        });
        local.to_array().map(|value| byte(0.5 + 0.5 * value))
    });
    let roughness = scene
        .roughness
        .map(|value| [0, byte(if value.is_nan() { 1.0 } else { *value }), 0]);
    [albedo, normal, roughness]
}

/// Header, JSON, buffer, each padded to four bytes.
fn container(json: &str, mut buffer: Vec<u8>) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let whole = 12 + 8 + json.len() + 8 + buffer.len();
    let mut file = Vec::with_capacity(whole);
    file.extend(b"glTF");
    for (length, kind, content) in [
        (json.len(), b"JSON", json),
        (buffer.len(), b"BIN\0", buffer),
    ] {
        if kind == b"JSON" {
            file.extend(2u32.to_le_bytes());
            file.extend((whole as u32).to_le_bytes());
        }
        file.extend((length as u32).to_le_bytes());
        file.extend(kind);
        file.extend(content);
    }
    file
}
