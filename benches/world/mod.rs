//! The scene the benchmarks run on: balls and a box before a slanted wall, as a camera sees it.

use captured::{
    scene::{Material, Scene},
    shot::Shot,
};
use drivers::{
    ColorFrame, DepthCamera, DepthFrame, Distortion, Exposure, FlashLamp, Illumination, Intrinsics,
    Pixels, Plane, Rig, RigidTransform, Timestamp, Transfer,
};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

fn lens(width: usize, height: usize, distortion: Distortion) -> Intrinsics {
    Intrinsics {
        width,
        height,
        fx: width as f64 * 0.85,
        fy: width as f64 * 0.85,
        cx: (width as f64 - 1.0) / 2.0,
        cy: (height as f64 - 1.0) / 2.0,
        distortion,
    }
}

/// Depth in metres and unit normal (camera axes) where a ray meets the world.
fn hit(ray: Vec3) -> (f32, Vec3) {
    let wall = Vec3::new(0.2, -0.3, -1.0).normalize();
    let mut z = wall.dot(Vec3::new(0.0, 0.0, 1.8)) / wall.dot(ray);
    let mut normal = wall;
    let balls = [
        (Vec3::new(0.1, 0.05, 1.4), 0.16f32),
        (Vec3::new(-0.3, -0.2, 1.2), 0.1),
        (Vec3::new(-0.05, -0.25, 1.6), 0.2),
        (Vec3::new(0.35, 0.3, 1.3), 0.07),
        (Vec3::new(-0.4, 0.3, 1.5), 0.14),
    ];
    for (centre, radius) in balls {
        let (a, b) = (ray.length_squared(), ray.dot(centre));
        let discriminant = b * b - a * (centre.length_squared() - radius * radius);
        let near = (b - discriminant.max(0.0).sqrt()) / a;
        if discriminant > 0.0 && near < z {
            z = near;
            normal = (ray * near - centre) / radius;
        }
    }
    let at = ray * 1.25;
    if (at.x - 0.25).abs() < 0.09 && (at.y + 0.2).abs() < 0.12 && z > 1.25 {
        (z, normal) = (1.25, -Vec3::Z);
    }
    (z, normal)
}

fn ray(lens: &Intrinsics, x: usize, y: usize) -> Vec3 {
    let ray = lens
        .ray(glam::DVec2::new(x as f64, y as f64))
        .unwrap_or(DVec3::Z);
    ray.as_vec3()
}

fn albedo(x: usize, y: usize, width: usize) -> [f32; 3] {
    let side = (width / 24).max(1);
    if (x / side + y / side).is_multiple_of(2) {
        [0.7, 0.5, 0.3]
    } else {
        [0.3, 0.4, 0.6]
    }
}

/// The world as a finished scene with a little depth noise to compare against.
pub fn scene(width: usize, height: usize) -> Scene {
    let camera = lens(width, height, Distortion::None {});
    let seen = Plane::from_fn(width, height, |x, y| hit(ray(&camera, x, y)));
    Scene {
        camera,
        depth_metres: seen.map(|(z, _)| *z),
        depth_sigma_metres: Plane::filled(width, height, 0.001),
        thickness_metres: Plane::filled(width, height, 0.2),
        normal: seen.map(|(_, normal)| *normal),
        albedo: Plane::from_fn(width, height, |x, y| albedo(x, y, width)),
        roughness: Plane::filled(width, height, 0.4),
        confidence: Plane::filled(width, height, 1.0),
        scale_known: true,
        flash_lit: true,
        material: Material::Varying,
        shine: None,
    }
}

/// A sky that is brighter above, with a soft sun.
pub fn sky() -> Plane<[f32; 3]> {
    Plane::from_fn(256, 128, |x, y| {
        let up = 1.0 - y as f32 / 127.0;
        let sun = if x < 40 && (20..40).contains(&y) {
            4.0
        } else {
            0.0
        };
        [0.3 + up + sun, 0.3 + up + sun, 0.3 + 1.3 * up + 0.8 * sun]
    })
}

/// Is the way to the lamp clear, by 64 equal steps from each pixel along the image of the ray of
/// light to the frame's edge, nearest sample, same slabs: the usual screen-space march.
pub fn march_64(scene: &Scene, toward: Vec3) -> Vec<bool> {
    let camera = &scene.camera;
    let (width, height) = camera.size();
    let (fx, fy) = (camera.fx as f32, camera.fy as f32);
    let (cx, cy) = (camera.cx as f32, camera.cy as f32);
    let depth = scene.depth_metres.samples();
    let thickness = scene.thickness_metres.samples();
    (0..width * height)
        .into_par_iter()
        .with_min_len(4 * width)
        .map(|index| {
            let (x, y) = ((index % width) as f32, (index / width) as f32);
            let z = depth[index];
            let start = Vec3::new((x - cx) / fx * z, (y - cy) / fy * z, z);
            // Far enough that the image of the ray has left the frame, or has passed the lens.
            let reach = if toward.z < 0.0 {
                -0.95 * z / toward.z
            } else {
                4.0
            };
            let end = start + toward * reach.min(4.0);
            let (ex, ey) = (cx + fx * end.x / end.z, cy + fy * end.y / end.z);
            let (dx, dy) = (ex - x, ey - y);
            let limit = |at: f32, step: f32, size: f32| {
                if step > 0.0 {
                    (size - 1.0 - at) / step
                } else if step < 0.0 {
                    -at / step
                } else {
                    f32::INFINITY
                }
            };
            let share = limit(x, dx, width as f32)
                .min(limit(y, dy, height as f32))
                .min(1.0);
            for step in 1..=64 {
                let t = share * step as f32 / 64.0;
                let (px, py) = (x + dx * t, y + dy * t);
                // 1/z is linear along the image of a line.
                let ray_z = 1.0 / (1.0 / start.z + (1.0 / end.z - 1.0 / start.z) * t);
                let at = (py + 0.5) as usize * width + (px + 0.5) as usize;
                let behind = ray_z - depth[at.min(depth.len() - 1)];
                if behind > 0.004 && behind < thickness[at.min(depth.len() - 1)] {
                    return false;
                }
            }
            true
        })
        .collect()
}

/// A depth frame of the world and the rig that took it.
pub fn depth_frame(
    width: usize,
    height: usize,
    color_width: usize,
    color_height: usize,
) -> (Rig, DepthFrame) {
    let distortion = Distortion::BrownConrady {
        k1: 0.05,
        k2: -0.02,
        p1: 1e-4,
        p2: -1e-4,
        k3: 0.0,
    };
    let depth = lens(width, height, distortion);
    let to_color = RigidTransform {
        translation_metres: DVec3::new(-0.032, -0.002, 0.004),
        ..RigidTransform::IDENTITY
    };
    let rig = Rig {
        color: lens(color_width, color_height, distortion),
        depth: Some(DepthCamera {
            lens: depth,
            to_color,
        }),
        flash: FlashLamp {
            position_metres: DVec3::ZERO,
            intensity: Some(0.5),
            beam: drivers::Beam::default(),
        },
    };
    let metres = Plane::from_fn(width, height, |x, y| {
        // A hash stands in for noise: 1 mm.
        let noise = ((x * 7919 + y * 104_729) % 1009) as f32 / 1009.0 - 0.5;
        hit(ray(&depth, x, y)).0 + 0.002 * noise
    });
    let frame = DepthFrame {
        at: Timestamp::from_nanos(1),
        sequence: 0,
        amplitude: None,
        sigma: None,
        metres,
    };
    (rig, frame)
}

fn photograph(light: Illumination, pixels: Plane<[u8; 3]>) -> ColorFrame {
    ColorFrame {
        at: Timestamp::from_nanos(1),
        sequence: 0,
        light,
        exposure: Exposure::UNIT,
        pixels: Pixels::Rgb8(pixels),
        transfer: Transfer::Srgb,
        black_level: 0.0,
        white_level: 1.0,
    }
}

/// A flash and an ambient photograph of the same size, 8 bit.
pub fn photographs(width: usize, height: usize) -> (ColorFrame, ColorFrame) {
    let level = |x: usize, y: usize| ((x * 7 + y * 13) % 97) as u8;
    let flash = Plane::from_fn(width, height, |x, y| {
        [90 + level(x, y), 80 + level(y, x), 100]
    });
    let ambient = Plane::from_fn(width, height, |x, y| [40 + level(x, y) / 3, 40, 30]);
    (
        photograph(Illumination::Flash, flash),
        photograph(Illumination::Ambient, ambient),
    )
}

/// A whole shot of the world: photographs of the given size and a depth frame of 640×576.
pub fn large_shot(width: usize, height: usize) -> Shot {
    let (rig, depth) = depth_frame(640, 576, width, height);
    let mut pixels = vec![[0u8; 3]; width * height];
    pixels
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let ray = ray(&rig.color, x, y);
                let (z, normal) = hit(ray);
                let distance = ray.length() * z;
                let cosine = normal.dot(-ray.normalize()).max(0.0);
                let albedo = albedo(x, y, width);
                *pixel = albedo.map(|a| {
                    let light = 0.5 * a * cosine / (distance * distance) + 0.02;
                    (captured::radiometry::transfer::srgb_encode(light.min(1.0)) * 255.0) as u8
                });
            }
        });
    let flash = Plane::new(width, height, pixels).expect("one sample per pixel");
    let ambient = Plane::filled(width, height, [38u8; 3]);
    Shot {
        flash: photograph(Illumination::Flash, flash),
        ambient: vec![photograph(Illumination::Ambient, ambient)],
        depth,
        rig,
        mask: None,
    }
}
