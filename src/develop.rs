//! The road a shot takes, every stage by name.
//!
//! The callers know the time; this room does not: it only says which stage begins.

mod development;

pub use development::Development;

use crate::{
    radiometry::{self, FlashOnly, LinearImage, RadiometryError, SubtractOptions},
    registration::{self, RegistrationError, RigMaps},
    relight::{Prepared, enlarge::Mix},
    scene::{self, Scene, SceneError, SceneOptions},
    shot::Shot,
};
use drivers::{DepthFrame, Plane, Rig};
use rayon::prelude::*;
use thiserror::Error;

/// The stages of [`develop`], in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Pixels to light, flash − ambient.
    Radiometry,
    /// Depth to the color grid.
    Registration,
    /// Light and depth to surfaces.
    Scene,
    /// What every light needs.
    Prepare,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; 4] = [
        Self::Radiometry,
        Self::Registration,
        Self::Scene,
        Self::Prepare,
    ];

    /// What it does, for a progress line.
    pub fn description(self) -> &'static str {
        match self {
            Self::Radiometry => "subtracting the room's light",
            Self::Registration => "bringing depth onto the photograph",
            Self::Scene => "working out surfaces",
            Self::Prepare => "preparing shadows",
        }
    }
}

/// How a shot is developed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Subtraction.
    pub subtract: SubtractOptions,
    /// Surfaces.
    pub scene: SceneOptions,
    /// Surfaces are worked out on at most this many pixels; larger photographs are reduced by a
    /// whole factor and their relit pictures enlarged again.
    pub working_pixels: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            subtract: SubtractOptions::default(),
            scene: SceneOptions::default(),
            // A little over 1080p: finer than any ToF camera by an order of magnitude.
            working_pixels: 2_100_000,
        }
    }
}

/// Why a shot could not be developed.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "one per stage")]
pub enum DevelopError {
    #[error(transparent)]
    Radiometry(#[from] RadiometryError),
    #[error(transparent)]
    Registration(#[from] RegistrationError),
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Takes a shot all the way to a scene that lights can be set into. `begins` is told each stage
/// as it starts.
///
/// # Errors
/// [`DevelopError`] of the stage that could not answer.
pub fn develop(
    shot: &Shot,
    options: &Options,
    begins: &mut dyn FnMut(Stage),
) -> Result<Development, DevelopError> {
    begins(Stage::Radiometry);
    let flash_only = radiometry::subtract(&shot.flash, &shot.ambient, &options.subtract)?;
    let factor = reduction(flash_only.light.0.len(), options.working_pixels);
    let reduced = (factor > 1).then(|| reduce(&flash_only, factor));

    begins(Stage::Registration);
    let (light, rig, depth) = match &reduced {
        None => (&flash_only, shot.rig, None),
        Some(light) => {
            let (rig, depth) = working_rig(shot, light.light.0.size());
            (light, rig, depth)
        }
    };
    let maps = RigMaps::new(&rig)?;
    let depth = depth.as_ref().unwrap_or(&shot.depth);
    let registered = registration::register(depth, &maps, Some(&light.light))?;

    begins(Stage::Scene);
    let mut scene = scene::estimate(light, &registered, &rig, &options.scene)?;
    if let Some(mask) = &shot.mask {
        leave_out(&mut scene, mask);
    }

    begins(Stage::Prepare);
    let prepared = Prepared::new(&scene);
    let working_light = reduced.map(|reduced| reduced.light);
    Ok(Development {
        flash_only,
        working_light,
        registered,
        scene,
        prepared,
    })
}

/// Makes surfaces outside the mask unknown. Their depth stays: what does not count as picture
/// still casts a shadow.
fn leave_out(scene: &mut Scene, mask: &Plane<bool>) {
    let (width, height) = scene.albedo.size();
    for y in 0..height {
        let row = mask.row(y * mask.height() / height);
        for (x, albedo) in scene.albedo.row_mut(y).iter_mut().enumerate() {
            if !row[x * mask.width() / width] {
                *albedo = <[f32; 3]>::unknown();
            }
        }
    }
}

/// The whole factor by which both sides shrink.
fn reduction(pixels: usize, working_pixels: usize) -> usize {
    let mut factor = 1;
    while pixels / (factor * factor) > working_pixels.max(1) {
        factor += 1;
    }
    factor
}

/// Means over squares of `factor` pixels; unknown pixels do not take part.
fn reduce(light: &FlashOnly, factor: usize) -> FlashOnly {
    let area = (factor * factor) as f32;
    FlashOnly {
        light: LinearImage(mean(&light.light.0, factor)),
        // The mean of n independent samples varies n times less.
        variance: mean(&light.variance, factor).map(|variance| variance / area),
        report: light.report.clone(),
    }
}

fn mean<T: Mix>(plane: &Plane<T>, factor: usize) -> Plane<T> {
    let (width, height) = (
        (plane.width() / factor).max(1),
        (plane.height() / factor).max(1),
    );
    let samples = (0..width * height)
        .into_par_iter()
        .map_init(Vec::new, |known, index| {
            let (left, top) = (index % width * factor, index / width * factor);
            known.clear();
            for y in top..(top + factor).min(plane.height()) {
                let row = plane.row(y);
                let end = (left + factor).min(row.len());
                known.extend(
                    row[left..end]
                        .iter()
                        .filter(|s| s.is_known())
                        .map(|s| (1.0, *s)),
                );
            }
            let share = 1.0 / known.len() as f32;
            known.iter_mut().for_each(|(weight, _)| *weight = share);
            // More than half unknown: a mean of the rest would be of something else.
            if 2 * known.len() < factor * factor {
                T::unknown()
            } else {
                T::mix(known)
            }
        })
        .collect();
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// The rig on a reduced grid; depth that lay on the color grid is thinned out with it.
fn working_rig(shot: &Shot, (width, height): (usize, usize)) -> (Rig, Option<DepthFrame>) {
    let mut rig = shot.rig;
    rig.color = rig.color.scaled_to(width, height);
    if rig.depth.is_some() {
        return (rig, None);
    }
    let thin = |plane: &Plane<f32>| {
        Plane::from_fn(width, height, |x, y| {
            let at = |index: usize, small: usize, large: usize| {
                ((2 * index + 1) * large / (2 * small)).min(large - 1)
            };
            plane[(at(x, width, plane.width()), at(y, height, plane.height()))]
        })
    };
    let depth = DepthFrame {
        metres: thin(&shot.depth.metres),
        amplitude: shot.depth.amplitude.as_ref().map(thin),
        sigma: shot.depth.sigma.as_ref().map(thin),
        ..shot.depth
    };
    (rig, Some(depth))
}
