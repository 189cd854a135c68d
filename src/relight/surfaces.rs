//! The scene's planes laid out for shading, and the rays of its camera.

use super::shading::SurfaceRow;
use crate::scene::Scene;
use drivers::{Distortion, Intrinsics};
use glam::{DVec2, Vec3};
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
    /// z; NaN = unknown.
    metres: Vec<f32>,
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

    fn reduced(&self, width: usize, middles: &Middles) -> Self {
        match self {
            Self::Pinhole { columns, rows } => Self::Pinhole {
                columns: middles.columns.iter().map(|&x| columns[x]).collect(),
                rows: middles.rows.iter().map(|&y| rows[y]).collect(),
            },
            Self::Bent { x, y } => Self::Bent {
                x: middles.of(width, x),
                y: middles.of(width, y),
            },
        }
    }
}

/// The pixel in the middle of every square of so many.
pub(super) struct Middles {
    columns: Vec<usize>,
    rows: Vec<usize>,
}

impl Middles {
    pub(super) fn new((width, height): (usize, usize), factor: usize) -> Self {
        let middles = |size: usize| {
            let middle = move |start: usize| (start + (factor - 1) / 2).min(size - 1);
            (0..size).step_by(factor).map(middle).collect()
        };
        Self {
            columns: middles(width),
            rows: middles(height),
        }
    }

    /// These pixels of a plane so wide.
    pub(super) fn of<T: Copy>(&self, width: usize, plane: &[T]) -> Vec<T> {
        let rows = self.rows.iter();
        rows.flat_map(|y| self.columns.iter().map(move |x| plane[y * width + x]))
            .collect()
    }
}

/// Standard deviation of the slope of a surface whose depth is wholly in doubt. Of 0.05, 0.1, 0.2, 0.3 and 0.5 the best with
/// surfaces that the network corrected, on the rendered validation scenes under the paper's noise and true shadows: relit light
/// 0.225, 0.220, 0.213, 0.205, 0.206 and 0.213e-2 from none to most; with exact depth there is no doubt, and nothing changes.
const DOUBTFUL_SLOPE: f32 = 0.2;
/// Share of depth that is so small a standard deviation that normals are hardly in doubt.
const SURE: f32 = 1e-3;

/// The roughness that a pixel shines with: its own, and that of normals nobody knows exactly. What is expected of a
/// highlight whose normal is in doubt is a wider, fainter one (Toksvig, "Mipmapping normal maps", 2005; as a sum of
/// variances of slopes: Olano & Baker, "LEAN mapping", I3D 2010). 1 where the scene knows none.
fn shaded_roughness(scene: &Scene, index: usize) -> f32 {
    let roughness = scene.roughness.samples()[index];
    if !roughness.is_finite() {
        return 1.0;
    }
    let sigma = scene.depth_sigma_metres.samples()[index] / scene.depth_metres.samples()[index];
    if sigma.is_nan() || sigma <= 0.0 {
        return roughness;
    }
    let doubt = (2.0 * (sigma / SURE).ln_1p()).min(1.0);
    // α = roughness², and α²/2 is the variance of slopes.
    let slope = DOUBTFUL_SLOPE * doubt;
    (roughness.powi(4) + 2.0 * slope * slope)
        .powf(0.25)
        .min(1.0)
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
            roughness: plane(&|index| shaded_roughness(scene, index), 1.0),
            obscurance,
            metres: scene.depth_metres.samples().to_vec(),
            rays: Rays::new(&scene.camera),
        }
    }

    /// The same, each square of pixels taken from the one in its middle.
    pub(super) fn reduced(&self, middles: &Middles) -> Self {
        let few = |plane: &Vec<f32>| middles.of(self.width, plane);
        Self {
            width: middles.columns.len(),
            normal: self.normal.each_ref().map(few),
            albedo: self.albedo.each_ref().map(few),
            roughness: few(&self.roughness),
            obscurance: few(&self.obscurance),
            metres: few(&self.metres),
            rays: self.rays.reduced(self.width, middles),
        }
    }

    /// The middle of what is known, camera axes, metres.
    pub(super) fn middle(&self) -> Vec3 {
        let mut level = vec![0.0; self.width];
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        // A few thousand pixels say it.
        for y in (0..self.metres.len() / self.width.max(1)).step_by(8) {
            let row = self.row(y, &mut level);
            for x in (0..self.width).step_by(8) {
                let z = row.metres[x];
                if z.is_finite() && row.albedo[0][x].is_finite() {
                    sum += z * Vec3::new(row.ray_x[x], row.ray_y[x], 1.0);
                    count += 1.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { Vec3::Z }
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
            metres: &self.metres[range],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use drivers::Plane;
    use glam::Vec3;

    fn scene(sigma_metres: f32, roughness: f32) -> Scene {
        Scene {
            camera: Intrinsics {
                width: 1,
                height: 1,
                fx: 1.0,
                fy: 1.0,
                cx: 0.0,
                cy: 0.0,
                distortion: Distortion::None {},
            },
            depth_metres: Plane::filled(1, 1, 2.0),
            depth_sigma_metres: Plane::filled(1, 1, sigma_metres),
            thickness_metres: Plane::filled(1, 1, 0.1),
            normal: Plane::filled(1, 1, Vec3::NEG_Z),
            albedo: Plane::filled(1, 1, [0.5; 3]),
            roughness: Plane::filled(1, 1, roughness),
            confidence: Plane::filled(1, 1, 1.0),
            scale_known: true,
            flash_lit: true,
            material: Material::Varying,
            shine: None,
        }
    }

    #[test]
    fn highlights_spread_as_far_as_their_normals_are_in_doubt_and_no_further() {
        let shines = |sigma, roughness| shaded_roughness(&scene(sigma, roughness), 0);
        assert_eq!(shines(0.0, 0.3), 0.3);
        assert_eq!(shines(f32::NAN, 0.3), 0.3);
        assert_eq!(shines(0.01, f32::NAN), 1.0);
        let spread = [0.0, 1e-4, 1e-3, 0.1].map(|sigma| shines(sigma, 0.3));
        assert!(spread.is_sorted() && spread[3] > spread[1], "{spread:?}");
        // What is rough as it is hardly gets rougher, and nothing gets rougher than rough.
        assert!(shines(0.1, 0.9) - 0.9 < 0.05 && shines(0.1, 1.0) <= 1.0);
    }
}
