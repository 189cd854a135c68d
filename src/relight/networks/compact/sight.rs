//! What the network of surfaces is fed.

use super::{
    super::{
        Channels,
        grid::{nearest, resampled},
    },
    DEPTH_GAIN, GRID, doubt_of, finite,
};
use crate::{radiometry::LinearImage, registration::RegisteredDepth, scene::Scene};
use drivers::Plane;
use glam::{DVec2, Vec3};

/// Difference of registered and smoothed depth, as a share of depth, times this.
const RAW_GAIN: f32 = 30.0;
/// Where sums are cut: light of white, and the difference above.
const MOST: f32 = 2.0;

/// A scene in closed form and what it was worked out from, all on the working grid.
#[derive(Debug, Clone, Copy)]
pub struct Sight<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Light of the flash alone; NaN = unknown.
    pub light: &'a LinearImage,
    /// Depth as it was registered, and its amplitude.
    pub registered: &'a RegisteredDepth,
    /// Value in `light` of a white Lambertian patch facing the flash at one metre.
    pub intensity: f32,
}

impl Sight<'_> {
    /// Sixteen planes on the networks' grid, 0 where nothing is known. The scene's normal (x right,
    /// y up, z toward the camera), the root of its albedo (3), the root of the mean light over that of a white surface at
    /// the distance, cosine to the camera, roughness, depth, registered less smoothed depth, sigma of
    /// depth, confidence, amplitude × distance² (its median is 1/2; 0 without), whether there is an
    /// amplitude, whether a surface is known.
    pub fn given(&self) -> Channels {
        let scene = self.scene;
        let size = GRID.within(scene.albedo.size());
        let camera = scene.camera.scaled_to(size.0, size.1);
        let normal = resampled(&scene.normal, size);
        let albedo = resampled(&scene.albedo, size);
        let roughness = resampled(&scene.roughness, size);
        let confidence = resampled(&scene.confidence, size);
        let light = resampled(&self.light.0, size);
        let metres = nearest(&scene.depth_metres, size);
        let sigma = nearest(&scene.depth_sigma_metres, size);
        let raw = nearest(&self.registered.metres, size);
        let rays: Plane<Vec3> = Plane::from_fn(size.0, size.1, |x, y| {
            let ray = camera.ray(DVec2::new(x as f64, y as f64));
            ray.map_or(Vec3::NAN, |ray| ray.as_vec3())
        });
        let distance2 = |index: usize| {
            let point = metres.samples()[index] * rays.samples()[index];
            point.length_squared()
        };
        let amplitude = self.registered.amplitude.as_ref().map(|plane| {
            let plane = nearest(plane, size);
            let mut white: Vec<f32> = (plane.samples().iter().enumerate())
                .map(|(index, amplitude)| finite(amplitude * distance2(index)))
                .collect();
            let middle = median(white.iter().copied().filter(|value| *value > 0.0));
            let scale = middle.map_or(0.0, |middle| 0.5 / middle);
            white
                .iter_mut()
                .for_each(|v| *v = (*v * scale).clamp(0.0, MOST));
            white
        });
        let middle = median_depth(&metres);
        Channels::from_pixels(size, |index| {
            let (z, normal) = (metres.samples()[index], normal.samples()[index]);
            let albedo = albedo.samples()[index];
            if !(z.is_finite() && normal.is_finite() && albedo[0].is_finite()) {
                return [0.0; 16];
            }
            let [red, green, blue] = albedo.map(|value| finite(value.max(0.0).sqrt()));
            let level = light.samples()[index].iter().sum::<f32>() / 3.0;
            let white = level * distance2(index) / self.intensity.max(1e-6);
            let facing = -normal.dot(rays.samples()[index].normalize_or_zero());
            let raw = RAW_GAIN * (raw.samples()[index] - z) / z;
            [
                normal.x,
                -normal.y,
                -normal.z,
                red,
                green,
                blue,
                finite(white.clamp(0.0, MOST).sqrt()),
                finite(facing),
                finite(roughness.samples()[index]),
                finite(DEPTH_GAIN * (z / middle).ln()),
                finite(raw.clamp(-MOST, MOST)),
                doubt_of(sigma.samples()[index], z),
                finite(confidence.samples()[index]),
                amplitude.as_ref().map_or(0.0, |white| white[index]),
                f32::from(u8::from(amplitude.is_some())),
                1.0,
            ]
        })
    }
}

/// Unit vectors from what is seen to the camera (x right, y up, z toward the camera) on the networks' grid; 0 where the
/// lens has no ray.
pub fn toward_camera(scene: &Scene) -> Channels {
    let size = GRID.within(scene.albedo.size());
    let camera = scene.camera.scaled_to(size.0, size.1);
    Channels::from_pixels(size, |index| {
        let pixel = DVec2::new((index % size.0) as f64, (index / size.0) as f64);
        let ray = camera.ray(pixel).map_or(Vec3::ZERO, |ray| ray.as_vec3());
        let ray = ray.normalize_or_zero();
        [-ray.x, ray.y, ray.z]
    })
}

/// The upper of two middle values; `None` of nothing.
fn median(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut values: Vec<f32> = values.collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// The median of the known depths, 1 m where there is none.
pub(super) fn median_depth(metres: &Plane<f32>) -> f32 {
    let known = metres.samples().iter().copied();
    median(known.filter(|z| z.is_finite() && *z > 0.0)).unwrap_or(1.0)
}
