//! The one plane that a depth map lies on, if it lies on one.

use drivers::Plane;
use glam::{DMat3, DVec3, Vec2, Vec3};

/// Samples that the fit is made of at most.
const SAMPLES: usize = 20_000;
/// Rounds of reweighting, after which outliers that are a fifth of the picture weigh nothing.
const ROUNDS: usize = 24;
/// Misfits of so many median misfits weigh a quarter (weights of Geman & McClure 1985).
const QUARTER_WEIGHT: f64 = 2.0;

/// A plane in front of the camera: 1/z = a·x/z + b·y/z + c, whatever the lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Flat(DVec3);

impl Flat {
    /// Fits depth (metres of z; NaN = unknown) over the `rays` of its pixels (x/z, y/z), robustly;
    /// `None` where fewer than three pixels not on a line are known.
    pub fn fit(metres: &Plane<f32>, rays: &Plane<Vec2>) -> Option<Self> {
        let stride = metres.len().div_ceil(SAMPLES).max(1);
        let samples: Vec<(DVec3, f64)> = metres
            .samples()
            .iter()
            .zip(rays.samples())
            .step_by(stride)
            .filter(|(z, _)| z.is_finite())
            .map(|(z, ray)| (ray.as_dvec2().extend(1.0), 1.0 / f64::from(*z)))
            .collect();
        Self::through(&samples)
    }

    /// The same of samples: rays (x/z, y/z, 1) and 1/z, 1/metres.
    pub fn through(samples: &[(DVec3, f64)]) -> Option<Self> {
        let mut weights = vec![1.0; samples.len()];
        let mut found = None;
        for _ in 0..ROUNDS {
            let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
            for ((ray, inverse), weight) in samples.iter().zip(&weights) {
                matrix += DMat3::from_cols(*ray * ray.x, *ray * ray.y, *ray) * *weight;
                right += *ray * *inverse * *weight;
            }
            let scale = matrix.z_axis.z;
            if matrix.determinant().abs() <= 1e-15 * scale.powi(3) {
                return None;
            }
            let plane = matrix.inverse() * right;
            let misfit = |(ray, inverse): &(DVec3, f64)| (plane.dot(*ray) - inverse).abs();
            let mut misfits: Vec<f64> = samples.iter().map(misfit).collect();
            let middle = misfits.len() / 2;
            let usual = *misfits.select_nth_unstable_by(middle, f64::total_cmp).1;
            let usual = QUARTER_WEIGHT * usual.max(1e-9);
            for (weight, sample) in weights.iter_mut().zip(samples) {
                *weight = (1.0 + (misfit(sample) / usual).powi(2)).powi(-2);
            }
            found = Some(Self(plane));
        }
        found.filter(|flat| flat.0.is_finite())
    }

    /// 1/z of the plane along a ray, 1/metres; not positive where the ray misses it.
    pub fn inverse_depth(self, ray: Vec2) -> f32 {
        self.along(ray.as_dvec2().extend(1.0)) as f32
    }

    /// The same for a ray (x/z, y/z, 1).
    pub fn along(self, ray: DVec3) -> f64 {
        self.0.dot(ray)
    }

    /// Its unit normal in camera axes, toward the camera.
    pub fn normal(self) -> Vec3 {
        -self.0.normalize().as_vec3()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays of a small pinhole.
    fn rays() -> Plane<Vec2> {
        Plane::from_fn(40, 30, |x, y| {
            Vec2::new(x as f32 - 19.5, y as f32 - 14.5) / 40.0
        })
    }

    #[test]
    fn a_slanted_plane_is_found_although_a_fifth_of_the_picture_stands_before_it() {
        // n·P = d with n = (0.6, 0, 0.8), d = 1.6: z = 1.6 / (0.6 x/z + 0.8).
        let rays = rays();
        let metres = Plane::from_fn(40, 30, |x, y| {
            let wall = 1.6 / (0.6 * rays[(x, y)].x + 0.8);
            if x < 8 { 0.7 * wall } else { wall }
        });
        let found = Flat::fit(&metres, &rays).unwrap();
        let normal = found.normal();
        assert!(normal.dot(Vec3::new(-0.6, 0.0, -0.8)) > 0.9999, "{normal}");
        assert!((found.inverse_depth(Vec2::ZERO) - 0.5).abs() < 1e-3);
    }

    #[test]
    fn too_few_samples_are_no_plane() {
        let rays = rays();
        let none = rays.map(|_| f32::NAN);
        assert_eq!(Flat::fit(&none, &rays), None);
        let line = Plane::from_fn(40, 30, |_, y| if y == 3 { 1.0 } else { f32::NAN });
        assert_eq!(Flat::fit(&line, &rays), None);
    }
}
