//! Files for neighbouring tools hold the scene they were made of.

use captured::{
    export::{ExportError, Format, encoded},
    radiometry::transfer::srgb_encode,
    relight::{Lamp, Preparation, Prepared, RelightOptions},
    scene::{Material, Scene},
};
use drivers::{Distortion, Intrinsics, Plane};
use glam::Vec3;

const SIZE: (usize, usize) = (64, 48);

/// A wall with ripples that only its normals show, and a box before it; a corner is unknown.
fn scene() -> Scene {
    let (width, height) = SIZE;
    let camera = Intrinsics {
        width,
        height,
        fx: 60.0,
        fy: 60.0,
        cx: 31.5,
        cy: 23.5,
        distortion: Distortion::None {},
    };
    let unknown = |x: usize, y: usize| x < 8 && y < 8;
    Scene {
        camera,
        depth_metres: Plane::from_fn(width, height, |x, y| match (x, y) {
            _ if unknown(x, y) => f32::NAN,
            (30..44, 20..34) => 1.0,
            _ => 1.6,
        }),
        depth_sigma_metres: Plane::filled(width, height, 0.001),
        thickness_metres: Plane::filled(width, height, 0.2),
        normal: Plane::from_fn(width, height, |x, _| {
            Vec3::new(0.3 * (x as f32).sin(), 0.0, -1.0).normalize()
        }),
        albedo: Plane::from_fn(width, height, |x, y| {
            if unknown(x, y) {
                [f32::NAN; 3]
            } else {
                [0.5, 0.25, 0.1 + 0.01 * y as f32]
            }
        }),
        roughness: Plane::from_fn(width, height, |x, _| 0.3 + 0.01 * x as f32),
        confidence: Plane::filled(width, height, 0.8),
        scale_known: true,
        flash_lit: true,
        material: Material::Varying,
        shine: None,
    }
}

fn file(format: Format) -> Vec<u8> {
    let scene = scene();
    let prepared = Prepared::new(&scene, Preparation::default());
    encoded(&scene, &prepared, format).unwrap()
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

#[test]
fn gltf_is_a_mesh_in_metres_with_three_textures_that_hold_something() {
    let file = file(Format::Gltf);
    assert_eq!(
        (&file[..4], word(&file, 4), word(&file, 8)),
        (&b"glTF"[..], 2, file.len())
    );
    let length = word(&file, 12);
    let json: serde_json::Value = serde_json::from_slice(&file[20..20 + length]).unwrap();
    let buffer = &file[20 + length + 8..];
    assert_eq!(
        json["buffers"][0]["byteLength"].as_u64().unwrap() as usize,
        buffer.len()
    );
    let view = |number: &serde_json::Value| {
        let view = &json["bufferViews"][number.as_u64().unwrap() as usize];
        let at = view["byteOffset"].as_u64().unwrap() as usize;
        &buffer[at..at + view["byteLength"].as_u64().unwrap() as usize]
    };
    let accessor = |number: usize| &json["accessors"][number];
    let vertices = accessor(0)["count"].as_u64().unwrap() as usize;
    // All but the unknown corner.
    assert_eq!(vertices, SIZE.0 * SIZE.1 - 64);
    let positions = view(&accessor(0)["bufferView"]);
    let depths: Vec<f32> = (0..vertices)
        .map(|v| -float(positions, 12 * v + 8))
        .collect();
    assert!(
        depths
            .iter()
            .all(|z| (z - 1.6).abs() < 1e-6 || (z - 1.0).abs() < 1e-6)
    );
    // No triangle joins the box to the wall, and all are seen from the front.
    let corners = view(&accessor(4)["bufferView"]);
    for triangle in corners.chunks_exact(12) {
        let numbers = [0, 4, 8].map(|at| word(triangle, at));
        let [a, b, c] = numbers.map(|number| depths[number]);
        assert!(a == b && b == c, "{a} {b} {c}");
        let [a, b, c] = numbers.map(|number| {
            let at = |axis: usize| float(positions, 12 * number + 4 * axis);
            Vec3::new(at(0), at(1), at(2))
        });
        assert!((b - a).cross(c - a).z > 0.0);
    }
    for (number, texture) in json["images"].as_array().unwrap().iter().enumerate() {
        let picture = image::load_from_memory(view(&texture["bufferView"]))
            .unwrap()
            .to_rgb8();
        assert_eq!(picture.dimensions(), (SIZE.0 as u32, SIZE.1 as u32));
        let pixel = picture.get_pixel(50, 10).0;
        let byte = |value: f32| (255.0 * value).round() as u8;
        match number {
            0 => assert_eq!(
                pixel,
                [0.5, 0.25, 0.2].map(|value| byte(srgb_encode(value)))
            ),
            // The mesh has a vertex a pixel here, so its own normals say it all.
            1 => assert_eq!(pixel, [128, 128, 255]),
            _ => assert_eq!(pixel, [0, byte(0.8), 0]),
        }
    }
}

#[test]
fn ply_has_as_many_vertices_and_faces_as_it_says() {
    let file = file(Format::Ply);
    let end = b"end_header\n";
    let header = file
        .windows(end.len())
        .position(|window| window == end)
        .unwrap()
        + end.len();
    let text = std::str::from_utf8(&file[..header]).unwrap();
    let count = |what: &str| -> usize {
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix(&format!("element {what} ")));
        line.unwrap().parse().unwrap()
    };
    assert_eq!(
        file.len(),
        header + count("vertex") * 35 + count("face") * 13
    );
    // The last vertex is the lower right pixel: (32.5/60, −24.5/60, −1) × 1.6 m nearly, y up.
    let last = header + (count("vertex") - 1) * 35;
    for (axis, expected) in [1.6 * 31.5 / 60.0, -1.6 * 23.5 / 60.0, -1.6]
        .into_iter()
        .enumerate()
    {
        assert!((float(&file, last + 4 * axis) - expected).abs() < 1e-5);
    }
    assert!((float(&file, last + 27) - 0.93).abs() < 1e-5);
}

#[test]
fn every_plane_is_a_layer_of_the_exr() {
    use exr::prelude::*;
    let file = file(Format::Layers);
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers();
    let image = image
        .all_attributes()
        .from_buffered(std::io::Cursor::new(file))
        .unwrap();
    let channels = &image.layer_data[0].channel_data.list;
    let names: Vec<String> = channels
        .iter()
        .map(|channel| channel.name.to_string())
        .collect();
    assert_eq!(
        names,
        [
            "albedo.B",
            "albedo.G",
            "albedo.R",
            "confidence.Y",
            "depth.Z",
            "normal.X",
            "normal.Y",
            "normal.Z",
            "roughness.Y",
            "sigma.Z"
        ]
    );
    let at = 10 * SIZE.0 + 50;
    let value = |name: &str| {
        let channel = channels
            .iter()
            .find(|channel| channel.name.to_string() == name)
            .unwrap();
        channel.sample_data.value_by_flat_index(at).to_f32()
    };
    assert!((value("albedo.G") - 0.25).abs() < 1e-6 && (value("depth.Z") - 1.6).abs() < 1e-6);
    assert!(value("normal.Z") > 0.9 && (value("confidence.Y") - 0.8).abs() < 1e-6);
}

#[test]
fn a_polynomial_texture_map_shows_what_relighting_shows() {
    let file = file(Format::Ptm);
    let mut lines = file.splitn(7, |byte| *byte == b'\n');
    let mut text = || std::str::from_utf8(lines.next().unwrap()).unwrap();
    assert_eq!(
        [text(), text(), text(), text()],
        ["PTM_1.2", "PTM_FORMAT_LRGB", "64", "48"]
    );
    let numbers =
        |line: &str| -> Vec<f32> { line.split(' ').map(|n| n.parse().unwrap()).collect() };
    let (scales, biases) = (numbers(text()), numbers(text()));
    let data = lines.next().unwrap();
    let pixels = SIZE.0 * SIZE.1;
    assert_eq!(data.len(), 9 * pixels);
    let prepared = Prepared::new(&scene(), Preparation::default());
    let lamp = Lamp::from_person([0.4, 0.3, 0.87]).unwrap();
    let [u, v, _] = lamp.person_direction();
    let relit = prepared.relight(&lamp, RelightOptions::default()).light.0;
    let mut apart = 0.0;
    let mut count = 0.0;
    for y in 0..SIZE.1 {
        for x in 0..SIZE.0 {
            let index = (SIZE.1 - 1 - y) * SIZE.0 + x;
            let terms = [u * u, v * v, u * v, u, v, 1.0];
            let brightness: f32 = (0..6)
                .map(|k| (f32::from(data[6 * index + k]) - biases[k]) * scales[k] * terms[k])
                .sum();
            let shown = brightness * f32::from(data[6 * pixels + 3 * index]) / 255.0;
            let light = relit[(x, y)][0];
            if light.is_finite() {
                apart += (shown - 255.0 * srgb_encode(light.clamp(0.0, 1.0))).abs();
                count += 1.0;
            }
        }
    }
    // Six terms blur shadows; the rest follows the lamp.
    assert!(apart / count < 16.0, "{}", apart / count);
}

#[test]
fn nothing_known_is_no_file() {
    let mut scene = scene();
    scene.albedo = scene.albedo.map(|_| [f32::NAN; 3]);
    let prepared = Prepared::new(&scene, Preparation::default());
    for format in [Format::Gltf, Format::Ply, Format::Layers, Format::Ptm] {
        let error = encoded(&scene, &prepared, format).unwrap_err();
        assert!(matches!(error, ExportError::Nothing), "{error}");
    }
}
