//! The road a shot takes, every stage by name.
//!
//! The callers know the time; this room does not: it only says which stage begins.

mod development;
mod working_grid;

pub use development::Development;
pub use working_grid::reduced;

use crate::{
    radiometry::{self, FlashOnly, LinearImage, RadiometryError, SubtractOptions},
    registration::{self, RegisteredDepth, RegistrationError, RigMaps},
    relight::{Preparation, Prepared, enlarge::Mix},
    scene::{self, Scene, SceneError, SceneOptions},
    shot::Shot,
};
use drivers::Plane;
use thiserror::Error;
use working_grid::{reduction, working_rig};

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
    /// What the scene is made ready for.
    pub prepare: Preparation,
    /// Surfaces are worked out on at most this many pixels; larger photographs are reduced by a
    /// whole factor and their relit pictures enlarged again.
    pub working_pixels: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            subtract: SubtractOptions::default(),
            scene: SceneOptions::default(),
            prepare: Preparation::default(),
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
    develop_light(shot, flash_only, options, begins)
}

/// [`develop`] from the light of the flash alone on: `flash_only` is that of the shot.
///
/// # Errors
/// As [`develop`].
pub fn develop_light(
    shot: &Shot,
    flash_only: FlashOnly,
    options: &Options,
    begins: &mut dyn FnMut(Stage),
) -> Result<Development, DevelopError> {
    let Working {
        light,
        registered,
        scene,
        prepared,
    } = work_out(shot, &flash_only, options, begins)?;
    Ok(Development {
        flash_only,
        working_light: light,
        registered,
        scene,
        prepared,
    })
}

/// What is worked out on the working grid.
#[derive(Debug, Clone)]
pub struct Working {
    /// The light of the flash alone; `None` where the working grid is the photograph's own.
    pub light: Option<LinearImage>,
    /// Depth.
    pub registered: RegisteredDepth,
    /// Surfaces.
    pub scene: Scene,
    /// The scene made ready for lights.
    pub prepared: Prepared,
}

/// The stages after the first: depth, surfaces and what lights need, on at most
/// `options.working_pixels` pixels.
///
/// # Errors
/// As [`develop`].
pub fn work_out(
    shot: &Shot,
    flash_only: &FlashOnly,
    options: &Options,
    begins: &mut dyn FnMut(Stage),
) -> Result<Working, DevelopError> {
    let factor = reduction(flash_only.light.0.len(), options.working_pixels);
    let small = (factor > 1).then(|| reduced(flash_only, factor));

    begins(Stage::Registration);
    let (light, rig, depth) = match &small {
        None => (flash_only, shot.rig, None),
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
    let prepared = Prepared::new(&scene, options.prepare);
    Ok(Working {
        light: small.map(|small| small.light),
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
