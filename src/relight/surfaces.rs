//! The scene's planes laid out for shading, and the rays of its camera.

use super::shading::SurfaceRow;
use crate::scene::Scene;
use drivers::{Distortion, Intrinsics};
use glam::DVec2;
use rayon::prelude::*;

/// One plane per component, row order; unknown pixels have NaN albedo and a harmless rest.
#[derive(Debug, Clone)]
pub(super) struct Surfaces {
    width: usize,
    normal: [Vec<f32>; 3],
    albedo: [Vec<f32>; 3],
    roughness: Vec<f32>,
    /// Share of the hemisphere that the scene itself blocks.
    obscurance: Vec<f32>,
    rays: Rays,
}

/// x/z and y/z of the ray through every pixel.
#[derive(Debug, Clone)]
enum Rays {
    /// Of a pinhole: one number per column and one per row.
    Pinhole { columns: Vec<f32>, rows: Vec<f32> },
    /// Of a bent lens: two planes.
    Bent { x: Vec<f32>, y: Vec<f32> },
}

impl Rays {
    fn new(camera: &Intrinsics) -> Self {
        if matches!(camera.distortion, Distortion::None {}) {
            let columns = (0..camera.width).map(|x| ((x as f64 - camera.cx) / camera.fx) as f32);
            let rows = (0..camera.height).map(|y| ((y as f64 - camera.cy) / camera.fy) as f32);
            return Self::Pinhole {
                columns: columns.collect(),
                rows: rows.collect(),
            };
        }
        let (x, y) = (0..camera.width * camera.height)
            .into_par_iter()
            .map(|index| {
                let (x, y) = (index % camera.width, index / camera.width);
                // Outside the lens's useful circle nothing is known; any ray does.
                let ray = camera
                    .ray(DVec2::new(x as f64, y as f64))
                    .unwrap_or_default();
                (ray.x as f32, ray.y as f32)
            })
            .unzip();
        Self::Bent { x, y }
    }
}

impl Surfaces {
    pub(super) fn new(scene: &Scene, obscurance: Vec<f32>) -> Self {
        let known = |index: usize| {
            let albedo = scene.albedo.samples()[index];
            scene.normal.samples()[index].is_finite() && albedo.iter().all(|a| a.is_finite())
        };
        let plane = |value: &(dyn Fn(usize) -> f32 + Sync), otherwise: f32| {
            (0..scene.albedo.len())
                .into_par_iter()
                .map(|index| {
                    if known(index) {
                        value(index)
                    } else {
                        otherwise
                    }
                })
                .collect::<Vec<f32>>()
        };
        let normal = |axis: usize, otherwise: f32| {
            plane(&|index| scene.normal.samples()[index][axis], otherwise)
        };
        let albedo =
            |channel: usize| plane(&|index| scene.albedo.samples()[index][channel], f32::NAN);
        Self {
            width: scene.albedo.width(),
            normal: [normal(0, 0.0), normal(1, 0.0), normal(2, -1.0)],
            albedo: [albedo(0), albedo(1), albedo(2)],
            roughness: plane(
                &|index| {
                    let roughness = scene.roughness.samples()[index];
                    if roughness.is_finite() {
                        roughness
                    } else {
                        1.0
                    }
                },
                1.0,
            ),
            obscurance,
            rays: Rays::new(&scene.camera),
        }
    }

    /// Albedo, one plane a channel; NaN = unknown.
    pub(super) fn albedo(&self) -> &[Vec<f32>; 3] {
        &self.albedo
    }

    /// Share of the hemisphere that the scene itself blocks, pixel by pixel.
    pub(super) fn obscurance(&self) -> &[f32] {
        &self.obscurance
    }

    pub(super) fn block_evenly(&mut self, share: f32) {
        self.obscurance.fill(share);
    }

    /// Row `y`; `level` is scratch of the row's length.
    pub(super) fn row<'a>(&'a self, y: usize, level: &'a mut [f32]) -> SurfaceRow<'a> {
        let range = y * self.width..(y + 1) * self.width;
        let (ray_x, ray_y) = match &self.rays {
            Rays::Pinhole { columns, rows } => {
                level.fill(rows[y]);
                (columns.as_slice(), &*level)
            }
            Rays::Bent { x, y } => (&x[range.clone()], &y[range.clone()]),
        };
        SurfaceRow {
            normal: self.normal.each_ref().map(|plane| &plane[range.clone()]),
            albedo: self.albedo.each_ref().map(|plane| &plane[range.clone()]),
            roughness: &self.roughness[range.clone()],
            obscurance: &self.obscurance[range.clone()],
            ray_x,
            ray_y,
        }
    }
}
