//! The one-bounce picture that SynthesisNet starts from.

use super::{Channels, feed::BRIGHTEST};
use crate::relight::{
    Emitter, Origin,
    shading::{ShaderLamp, SurfaceRow, shade_row},
};
use drivers::Intrinsics;
use glam::DVec2;

/// What a scene is made of, as the networks say it: albedo (3 channels), unit normals (3; x right,
/// y up, z toward the camera) and Karis' roughness (1).
#[derive(Debug, Clone, Copy)]
pub(super) struct Surfaces<'a> {
    pub albedo: &'a Channels,
    pub normal: &'a Channels,
    pub roughness: &'a Channels,
}

/// Karis' model under a white lamp, without shadow, in [0, 2]; `toward` in camera axes.
pub(super) fn one_bounce(
    surfaces: Surfaces<'_>,
    camera: &Intrinsics,
    toward: [f32; 3],
) -> Channels {
    let size = surfaces.albedo.size;
    let lamp = ShaderLamp {
        emitter: Emitter {
            origin: Origin::Distant(toward.into()),
            facing: None,
            color: [1.0; 3],
        },
        indirect: [0.0; 3],
        shines: true,
    };
    // Of all the rows at once: the shader knows no neighbours.
    let turned = |axis: usize, sign: f32| -> Vec<f32> {
        let channel = surfaces.normal.channel(axis).iter();
        channel.map(|value| sign * value).collect()
    };
    let (ny, nz) = (turned(1, -1.0), turned(2, -1.0));
    let rays: Vec<[f32; 2]> = (0..size.0 * size.1)
        .map(|index| {
            let pixel = DVec2::new((index % size.0) as f64, (index / size.0) as f64);
            let ray = camera.ray(pixel).unwrap_or_default();
            [ray.x as f32, ray.y as f32]
        })
        .collect();
    let [ray_x, ray_y] = [0, 1].map(|axis| rays.iter().map(|ray| ray[axis]).collect::<Vec<f32>>());
    let nothing = vec![0.0; rays.len()];
    let row = SurfaceRow {
        normal: [surfaces.normal.channel(0), &ny, &nz],
        albedo: [0, 1, 2].map(|channel| surfaces.albedo.channel(channel)),
        roughness: surfaces.roughness.channel(0),
        obscurance: &nothing,
        ray_x: &ray_x,
        ray_y: &ray_y,
        metres: &[],
    };
    let mut lit = vec![1.0; rays.len()];
    let mut light = vec![[0.0; 3]; rays.len()];
    shade_row(&row, &lamp, &mut lit, &mut light);
    Channels::from_pixels(size, |i| light[i].map(|value| value.clamp(0.0, BRIGHTEST)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::Distortion;

    #[test]
    fn shading_head_on_is_the_formula_worked_out_by_hand() {
        let plane = |values: [f32; 3]| Channels::from_pixels((3, 3), |_| values);
        let camera = Intrinsics {
            width: 3,
            height: 3,
            fx: 100.0,
            fy: 100.0,
            cx: 1.0,
            cy: 1.0,
            distortion: Distortion::None {},
        };
        let normal = plane([0.0, 0.0, 1.0]);
        let roughness = Channels::from_pixels((3, 3), |_| [0.5]);
        let surfaces = Surfaces {
            albedo: &plane([0.4, 0.2, -0.1]),
            normal: &normal,
            roughness: &roughness,
        };
        // All cosines 1: albedo + F / (4 α²) with α = r² and F = 0.05 + 0.95 · 2^(−12.53789).
        let shine = (0.05 + 0.95 * (-12.53789f64).exp2()) / (4.0 * 0.0625);
        let found = one_bounce(surfaces, &camera, [0.0, 0.0, -1.0]);
        for (channel, albedo) in [0.4, 0.2, -0.1].into_iter().enumerate() {
            let middle = f64::from(found.channel(channel)[4]);
            assert!((middle - albedo - shine).abs() < 1e-4, "{middle}");
        }
        let behind = one_bounce(surfaces, &camera, [0.6, 0.0, 0.8]);
        assert!(behind.samples.iter().all(|v| *v == 0.0));
    }
}
