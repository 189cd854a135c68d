//! Where surfaces are and how they face: as measured, or on one plane.

use super::{
    edges::{Edges, edges},
    flat::Flat,
    normals::{normals, normals_of_slopes},
    smooth::InverseDepth,
    surface::{Surface, surface},
};
use drivers::{Plane, Rig};
use glam::{Vec2, Vec3};

/// Where surfaces are and how they face.
pub(super) struct Shaped {
    pub surface: InverseDepth,
    pub edges: Edges,
    pub normal: Plane<Vec3>,
    /// Standard deviation of a normal's angle, radians.
    pub normal_sigma: Plane<f32>,
}

/// As the depth says, and under much noise `light`, the photograph's, too. `focal` is that of the grid, in pixels; `smoothing` multiplies the noise found.
pub(super) fn measured(
    metres: &Plane<f32>,
    sigma_metres: &Plane<f32>,
    light: &Plane<[f32; 3]>,
    rig: &Rig,
    focal: f32,
    smoothing: f32,
    rays: &Plane<Vec2>,
) -> Shaped {
    let Surface {
        depth,
        slope,
        normal_sigma,
    } = surface(metres, sigma_metres, light, rig, focal, smoothing);
    let edges = edges(&depth, focal);
    let normal = match slope {
        Some(slope) => normals_of_slopes(&depth, &slope, rays),
        None => normals(&depth, &edges, rays),
    };
    Shaped {
        surface: depth,
        edges,
        normal,
        normal_sigma,
    }
}

/// One plane, everywhere; a hole in its depth is no hole in it.
pub(super) fn flat(flat: Flat, rays: &Plane<Vec2>) -> Shaped {
    let inverse = |ray: &Vec2| {
        let inverse = flat.inverse_depth(*ray);
        if inverse > 0.0 { inverse } else { f32::NAN }
    };
    let value = rays.map(inverse);
    // Never exactly certain: zero variance would make every comparison a division by zero.
    let variance = value.map(|w| (1e-6 * w) * (1e-6 * w));
    Shaped {
        edges: Edges::none(rays.size()),
        normal: value.map(|w| if w.is_nan() { Vec3::NAN } else { flat.normal() }),
        normal_sigma: value.map(|w| w * 0.0),
        surface: InverseDepth { value, variance },
    }
}
