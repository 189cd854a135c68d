//! The stage: light + depth → [`Scene`].

use super::{
    Scene, albedo,
    confidence::confidence,
    edges::edges,
    grain::shrunk,
    lighting::{UNKNOWN_LIGHT, UNTOLD_ROUGHNESS, evenly_lit, followed, may_be_flash},
    normals::{normals, normals_of_slopes},
    rays::rays,
    regions::regions,
    roughness::roughness,
    surface::{Surface, sigma_of_depth, surface},
    thickness::thickness,
};
use crate::{radiometry::FlashOnly, registration::RegisteredDepth};
use drivers::{Intrinsics, Plane, Rig};

use rayon::prelude::*;
use thiserror::Error;

/// What may be assumed about a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneOptions {
    /// Depth noise is taken this many times as large as found; 0 = do not smooth.
    pub smoothing: f32,
    /// Thickness of the thinnest surfaces, metres; > 0.
    pub least_thickness_metres: f32,
    /// Thickness of the thickest bodies that show an end, metres.
    pub most_thickness_metres: f32,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            smoothing: 1.0,
            least_thickness_metres: 0.03,
            most_thickness_metres: 0.5,
        }
    }
}

/// Why no scene could be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SceneError {
    /// Planes that do not share one size.
    #[error("{plane} is {}×{} but the flash light is {}×{}; bring both onto one grid", found.0, found.1, expected.0, expected.1)]
    SizeMismatch {
        /// Which plane.
        plane: &'static str,
        /// Its (width, height).
        found: (usize, usize),
        /// The flash light's (width, height).
        expected: (usize, usize),
    },
    /// A picture without pixels.
    #[error("the flash light has no pixels; give an image of at least 1×1")]
    Empty,
    /// The planes are no scaled version of the lens's grid.
    #[error("planes of {}×{} do not have the shape of the color lens's {}×{}; scale both axes alike", grid.0, grid.1, lens.0, lens.1)]
    Shape {
        /// (width, height) of the planes.
        grid: (usize, usize),
        /// (width, height) of the lens.
        lens: (usize, usize),
    },
    /// A number of the rig or the options outside its range.
    #[error("{field} is {value}; it must be {range}")]
    Range {
        /// Name of the field.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is possible.
        range: &'static str,
    },
}

/// Works out what the photographed scene is made of.
///
/// All planes share one size: the color lens's, or a smaller working grid of the same shape.
/// Smoothed depth, normals, albedo, roughness and thickness come back on that grid, in closed
/// form and in time linear in the pixels.
///
/// # Errors
/// [`SceneError::Empty`] and [`SceneError::SizeMismatch`] for planes that cannot be used together,
/// [`SceneError::Shape`] when they are no scaled version of `rig.color`, [`SceneError::Range`] for
/// a lens, flash or option that is out of range.
pub fn estimate(
    flash: &FlashOnly,
    depth: &RegisteredDepth,
    rig: &Rig,
    options: &SceneOptions,
) -> Result<Scene, SceneError> {
    check_sizes(flash, depth)?;
    check_ranges(rig, options)?;
    let (width, height) = flash.light.0.size();
    let camera = working_lens(&rig.color, width, height)?;
    let focal = (0.5 * (camera.fx + camera.fy)) as f32;
    let rays = rays(&camera);

    let known = positive(&depth.metres);
    let Surface {
        depth: surface,
        slope,
        normal_sigma,
    } = surface(&known, &depth.sigma_metres, rig, focal, options.smoothing);
    let depth_metres = surface.value.map(|w| 1.0 / w);
    let depth_sigma_metres = sigma_of_depth(&surface);
    let edges = edges(&surface, focal);
    let normal = match slope {
        Some(slope) => normals_of_slopes(&surface, &slope, &rays),
        None => normals(&surface, &edges, &rays),
    };

    let of_flash = |light: &Plane<[f32; 3]>, variance: &Plane<f32>| {
        albedo::reflections(light, variance, &depth_metres, &normal, &rays, &rig.flash)
    };
    let reflections = of_flash(&flash.light.0, &flash.variance);
    let regions = regions(&edges, &normal);
    let scale_known = rig.flash.intensity.is_some();
    // A stated intensity was measured: there is a flash.
    let flash_lit = scale_known || may_be_flash(followed(&flash.light.0, &reflections, &regions));
    // Grain goes from what becomes albedo; how highlights fall off is asked of the light as it is.
    let (light, variance) = shrunk(&flash.light.0, &flash.variance);
    let (mut reflections, mut matte) = if flash_lit {
        (reflections, of_flash(&light, &variance))
    } else {
        let even = |light, variance| evenly_lit(light, variance, &reflections);
        (
            even(&flash.light.0, &flash.variance),
            even(&light, &variance),
        )
    };
    if !scale_known {
        let scale = albedo::plausible_scale(&reflections);
        for plane in [&mut reflections, &mut matte] {
            plane.samples_mut().par_iter_mut().for_each(|r| {
                r.value = r.value.map(|v| v * scale);
                r.variance *= scale * scale;
            });
        }
    }
    let (roughness, albedo, trust) = if flash_lit {
        let roughness = roughness(&reflections, &normal_sigma, &regions);
        let albedo = albedo::albedo(&matte, &roughness, &normal_sigma);
        (roughness, albedo, 1.0)
    } else {
        // No normal enters an even light, and no highlight is taken out of it.
        let (rough, exact) = (known.map(|_| 1.0), known.map(|_| 0.0));
        let albedo = albedo::albedo(&matte, &rough, &exact);
        let roughness = known.map(|&z| if z.is_nan() { z } else { UNTOLD_ROUGHNESS });
        (roughness, albedo, UNKNOWN_LIGHT)
    };
    let thickness_metres = thickness(
        &depth_metres,
        &edges.firm(&surface),
        &rays,
        options.least_thickness_metres,
        options.most_thickness_metres,
    );
    let confidence = confidence(
        &reflections,
        &depth_metres,
        &depth_sigma_metres,
        &depth.measured,
    )
    .map(|c| trust * c);
    Ok(Scene {
        camera,
        depth_metres,
        depth_sigma_metres,
        thickness_metres,
        normal,
        albedo,
        roughness,
        confidence,
        scale_known,
        flash_lit,
    })
}

fn check_sizes(flash: &FlashOnly, depth: &RegisteredDepth) -> Result<(), SceneError> {
    let expected = flash.light.0.size();
    if flash.light.0.is_empty() {
        return Err(SceneError::Empty);
    }
    let planes = [
        ("the variance of the flash light", flash.variance.size()),
        ("the depth", depth.metres.size()),
        ("the depth's sigma", depth.sigma_metres.size()),
        ("the mask of measured depth", depth.measured.size()),
    ];
    for (plane, found) in planes {
        if found != expected {
            return Err(SceneError::SizeMismatch {
                plane,
                found,
                expected,
            });
        }
    }
    Ok(())
}

fn check_ranges(rig: &Rig, options: &SceneOptions) -> Result<(), SceneError> {
    let positive = "finite and above 0";
    let least = f64::from(options.least_thickness_metres);
    let smoothing = f64::from(options.smoothing);
    let most = f64::from(options.most_thickness_metres);
    let reach = rig.flash.position_metres.length();
    let intensity = rig.flash.intensity.map_or(1.0, f64::from);
    let usable = |value: f64| value.is_finite() && value > 0.0;
    let checks = [
        ("color.fx", rig.color.fx, usable(rig.color.fx), positive),
        ("color.fy", rig.color.fy, usable(rig.color.fy), positive),
        ("color.cx", rig.color.cx, rig.color.cx.is_finite(), "finite"),
        ("color.cy", rig.color.cy, rig.color.cy.is_finite(), "finite"),
        (
            "the length of flash.position_metres",
            reach,
            reach.is_finite(),
            "finite",
        ),
        ("flash.intensity", intensity, usable(intensity), positive),
        ("least_thickness_metres", least, usable(least), positive),
        (
            "most_thickness_metres",
            most,
            most >= least,
            "at least least_thickness_metres",
        ),
        (
            "smoothing",
            smoothing,
            smoothing.is_finite() && smoothing >= 0.0,
            "finite and not negative",
        ),
    ];
    match checks.into_iter().find(|&(_, _, holds, _)| !holds) {
        Some((field, value, _, range)) => Err(SceneError::Range {
            field,
            value,
            range,
        }),
        None => Ok(()),
    }
}

/// The color lens on a grid of `width`×`height`.
fn working_lens(lens: &Intrinsics, width: usize, height: usize) -> Result<Intrinsics, SceneError> {
    // A whole number of pixels may be off by one on each axis.
    let exact = width as f64 * lens.height as f64 / lens.width as f64;
    let slack = 1.0 + lens.height as f64 / lens.width as f64;
    if lens.width == 0 || lens.height == 0 || (exact - height as f64).abs() > slack {
        return Err(SceneError::Shape {
            grid: (width, height),
            lens: lens.size(),
        });
    }
    Ok(if lens.size() == (width, height) {
        *lens
    } else {
        lens.scaled_to(width, height)
    })
}

/// Depth that can stand in front of a camera; NaN for the rest.
fn positive(metres: &Plane<f32>) -> Plane<f32> {
    metres.map(|&z| {
        if z > 0.0 && z.is_finite() {
            z
        } else {
            f32::NAN
        }
    })
}
