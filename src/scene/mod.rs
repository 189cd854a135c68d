//! Light + depth → surfaces: normals, albedo, roughness, thickness, each with a confidence.
//!
//! With the flash at the lens, flash-only light × distance² / cosine is nearly the albedo, and the
//! depth map is nearly the normals: everything here is closed form and linear in the pixels.

mod albedo;
mod confidence;
mod edges;
mod estimate;
mod fill;
mod connected;
mod flat;
mod grain;
mod karis;
mod lighting;
mod noise;
mod normals;
mod options;
mod rays;
mod regions;
mod rims;
mod roughness;
mod shape;
mod shine;
mod smooth;
mod surface;
mod thickness;
mod variation;
mod windows;

pub(crate) use connected::connected;
pub use estimate::estimate;
pub(crate) use flat::Flat;
pub use grain::variance_left;
pub use karis::{F0, ROUGHNESS_FLOOR, karis, karis_at_lens};
pub use options::{Material, SceneError, SceneOptions, Shape};
pub use shine::Shine;

use drivers::{Intrinsics, Plane};
use glam::Vec3;

/// What the photographed scene is made of, on the color grid (or a smaller working grid of the
/// same camera). All planes share one size.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Lens of the grid the planes lie on.
    pub camera: Intrinsics,
    /// Distance along z in metres, smoothed by its own sigma; NaN = unknown.
    pub depth_metres: Plane<f32>,
    /// Standard deviation of `depth_metres`, metres.
    pub depth_sigma_metres: Plane<f32>,
    /// How far the surface at this pixel reaches back along the ray, metres of z; > 0; +∞ allowed.
    pub thickness_metres: Plane<f32>,
    /// Unit normals in camera axes (x right, y down, z forward), facing the camera; NaN = unknown.
    pub normal: Plane<Vec3>,
    /// Diffuse albedo, linear red, green, blue in [0, 1] where the scale is known; NaN = unknown.
    pub albedo: Plane<[f32; 3]>,
    /// Karis roughness in (0, 1]; NaN = unknown.
    pub roughness: Plane<f32>,
    /// How far to trust a pixel, 0 (a guess) to 1.
    pub confidence: Plane<f32>,
    /// True when albedo is absolute; false when it is right up to one global scale.
    pub scale_known: bool,
    /// False when the photograph does not look lit from the lens: then its light was taken to be
    /// the same everywhere, its own shading stays in `albedo`, and `roughness` is a guess.
    pub flash_lit: bool,
    /// How freely its surfaces were let shine; `roughness` is 1 where they are matte.
    pub material: Material,
    /// What the photograph says for and against highlights, where it was asked
    /// ([`SceneOptions::weigh_materials`]).
    pub shine: Option<Shine>,
}
