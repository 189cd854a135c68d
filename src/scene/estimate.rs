//! The stage: light + depth → [`Scene`].

use super::{
    Scene, albedo,
    confidence::confidence,
    flat::Flat,
    grain::shrunk,
    lighting::{UNKNOWN_LIGHT, UNTOLD_ROUGHNESS, evenly_lit, followed, may_be_flash},
    options::{Material, SceneError, SceneOptions, Shape, check_ranges},
    rays::rays,
    regions::regions,
    roughness::{evidence, roughness},
    shape::{self, Shaped},
    shine::shine,
    surface::sigma_of_depth,
    thickness::thickness,
};
use crate::{radiometry::FlashOnly, registration::RegisteredDepth};
use drivers::{Intrinsics, Plane, Rig};
use rayon::prelude::*;

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

    // Grain goes from what becomes albedo and guides the depth; how highlights fall off is asked of the light
    // as it is.
    let (light, variance) = shrunk(&flash.light.0, &flash.variance);
    let known = positive(&depth.metres);
    let flat = match options.shape {
        Shape::Plane => Flat::fit(&known, &rays),
        Shape::Measured => None,
    };
    let shaped = match flat {
        Some(flat) => shape::flat(flat, &rays),
        None => shape::measured(
            &known,
            &depth.sigma_metres,
            &light,
            rig,
            focal,
            options.smoothing,
            &rays,
        ),
    };
    let Shaped {
        surface,
        edges,
        normal,
        normal_sigma,
    } = shaped;
    let depth_metres = surface.value.map(|w| 1.0 / w);
    let depth_sigma_metres = sigma_of_depth(&surface);
    let known = match flat {
        Some(_) => depth_metres.clone(),
        None => known,
    };

    let of_flash = |light: &Plane<[f32; 3]>, variance: &Plane<f32>| {
        albedo::reflections(light, variance, &depth_metres, &normal, &rays, &rig.flash)
    };
    let reflections = of_flash(&flash.light.0, &flash.variance);
    let scale_known = rig.flash.intensity.is_some();
    let asked = options.material != Material::Matte;
    let regions = (asked || !scale_known).then(|| regions(&edges, &normal));
    // A stated intensity was measured: there is a flash.
    let flash_lit = match &regions {
        Some(regions) if !scale_known => {
            may_be_flash(followed(&flash.light.0, &reflections, regions))
        }
        _ => true,
    };
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
    let everywhere = |roughness: f32| known.map(|&z| if z.is_nan() { z } else { roughness });
    let (roughness, albedo, trust) = match &regions {
        _ if !flash_lit => {
            // No normal enters an even light, and no highlight is taken out of it.
            let albedo = albedo::albedo(&matte, None, &known.map(|_| 0.0));
            let roughness = if asked { UNTOLD_ROUGHNESS } else { 1.0 };
            (everywhere(roughness), albedo, UNKNOWN_LIGHT)
        }
        Some(regions) if asked => {
            let alike = options.material == Material::OneRoughness;
            let roughness = roughness(&reflections, &normal_sigma, regions, alike);
            let albedo = albedo::albedo(&matte, Some(&roughness), &normal_sigma);
            (roughness, albedo, 1.0)
        }
        _ => {
            let albedo = albedo::albedo(&matte, None, &normal_sigma);
            (everywhere(1.0), albedo, 1.0)
        }
    };
    let shine = (regions
        .as_ref()
        .filter(|_| options.weigh_materials && flash_lit))
    .map(|regions| shine(&evidence(&reflections, &normal_sigma, regions)));
    let thickness_metres = match flat {
        Some(_) => depth_metres.map(|_| f32::INFINITY),
        None => thickness(
            &depth_metres,
            &edges.firm(&surface),
            &rays,
            options.least_thickness_metres,
            options.most_thickness_metres,
        ),
    };
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
        material: options.material,
        shine,
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
