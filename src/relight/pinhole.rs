//! The same camera without its lens's distortion, where image lines are straight.

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
    let camera = Intrinsics { distortion: Distortion::None {}, ..*bent };
    let (width, height) = camera.size();
    let inside = |pixel: DVec2| {
        let (x, y) = (pixel.x.round(), pixel.y.round());
        (x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64)
            .then_some(y as usize * width + x as usize)
    };
    // Nearest, never interpolated: a mean of two surfaces would be a third one that is not there.
    let source: Vec<Option<usize>> = (0..width * height)
        .into_par_iter()
        .map(|index| {
            let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
            let ray = camera.ray(pixel)?;
            let seen = bent.project(ray)?;
            // A model that folds back puts far rays into the picture: believe only its inverse.
            let back = bent.ray(seen)?;
            ((back - ray).length() < 1e-3).then(|| inside(seen)).flatten()
        })
        .collect();
    let resample = |plane: &Plane<f32>, otherwise: f32| {
        Plane::from_fn(width, height, |x, y| {
            source[y * width + x].map_or(otherwise, |index| plane.samples()[index])
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
            resample(&scene.depth_metres, f32::NAN),
            resample(&scene.thickness_metres, 0.0),
            resample(&scene.depth_sigma_metres, 0.0),
        ],
        lookup: Plane::new(width, height, lookup).expect("one index per pixel"),
    })
}
