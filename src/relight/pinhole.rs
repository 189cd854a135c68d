//! The same camera without its lens's distortion, where image lines are straight.

use super::visibility::STEEPEST_TANGENT;
use crate::scene::Scene;
use drivers::{Distortion, Intrinsics, Plane};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Where to look on the pinhole grid for every pixel of the bent one.
#[derive(Debug, Clone)]
pub(super) struct Straightened {
    /// The pinhole; same size and focal length as the bent camera.
    pub camera: Intrinsics,
    /// Depth, thickness and sigma on the pinhole grid; NaN depth = unknown.
    pub planes: [Plane<f32>; 3],
    /// Per pixel of the bent grid the index on the pinhole grid; `u32::MAX` = outside it.
    pub lookup: Plane<u32>,
}

/// `None` for a camera that is a pinhole already.
pub(super) fn straighten(scene: &Scene) -> Option<Straightened> {
    let bent = &scene.camera;
    if matches!(bent.distortion, Distortion::None {}) {
        return None;
    }
    let camera = Intrinsics {
        distortion: Distortion::None {},
        ..*bent
    };
    let (width, height) = camera.size();
    let inside = |pixel: DVec2| {
        let (x, y) = (pixel.x.round(), pixel.y.round());
        (x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64)
            .then_some(y as usize * width + x as usize)
    };
    // Where each pixel of the pinhole is seen through the bent lens.
    let seen: Vec<Option<DVec2>> = (0..width * height)
        .into_par_iter()
        .map(|index| {
            let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
            let ray = camera.ray(pixel)?;
            let seen = bent.project(ray)?;
            // A model that folds back puts far rays into the picture: believe only its inverse.
            let back = bent.ray(seen)?;
            ((back - ray).length() < 1e-3 && inside(seen).is_some()).then_some(seen)
        })
        .collect();
    let edge = STEEPEST_TANGENT / camera.fx.min(camera.fy) as f32;
    let metres = resample(&seen, camera.size(), f32::NAN, |at| {
        depth_at(scene, at, edge)
    });
    let nearest = |plane: &Plane<f32>| {
        resample(&seen, camera.size(), 0.0, |at| {
            inside(at).map_or(0.0, |index| plane.samples()[index])
        })
    };
    let lookup: Vec<u32> = (0..width * height)
        .into_par_iter()
        .map(|index| {
            let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
            bent.ray(pixel)
                .and_then(|ray| camera.project(DVec3::new(ray.x, ray.y, 1.0)))
                .and_then(inside)
                .map_or(u32::MAX, |index| index as u32)
        })
        .collect();
    Some(Straightened {
        camera,
        planes: [
            metres,
            nearest(&scene.thickness_metres),
            nearest(&scene.depth_sigma_metres),
        ],
        lookup: Plane::new(width, height, lookup).expect("one index per pixel"),
    })
}

fn resample(
    seen: &[Option<DVec2>],
    (width, height): (usize, usize),
    otherwise: f32,
    value: impl Fn(DVec2) -> f32 + Sync,
) -> Plane<f32> {
    let samples = seen
        .par_iter()
        .map(|at| at.map_or(otherwise, &value))
        .collect();
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// Depth between pixels: interpolated within one surface (nearest alone would turn a slanted wall
/// into stairs that shade themselves), never across an edge, which would invent a third surface.
fn depth_at(scene: &Scene, at: DVec2, edge: f32) -> f32 {
    let depth = &scene.depth_metres;
    let (width, height) = depth.size();
    let clamp = |value: f64, size: usize| value.clamp(0.0, (size - 1) as f64);
    let (x, y) = (clamp(at.x, width), clamp(at.y, height));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let nearest = depth[(x.round() as usize, y.round() as usize)];
    let corners = [
        depth[(x0, y0)],
        depth[(x1, y0)],
        depth[(x0, y1)],
        depth[(x1, y1)],
    ];
    if !corners.iter().all(|z| (z - nearest).abs() < edge * nearest) {
        return nearest;
    }
    // Inverse depth is linear in the picture of a plane.
    let [a, b, c, d] = corners.map(|z| 1.0 / z);
    1.0 / ((a + (b - a) * fx) * (1.0 - fy) + (c + (d - c) * fx) * fy)
}
