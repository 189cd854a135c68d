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
use drivers::{DepthFrame, Plane, Rig};
use std::borrow::Cow;
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
    begins(Stage::Registration);
    let grid = Grid::of(shot, flash_only, options.working_pixels)?;
    begins(Stage::Scene);
    let scene = grid.scene(shot, &options.scene)?;
    begins(Stage::Prepare);
    let prepared = Prepared::new(&scene, options.prepare);
    Ok(Working {
        light: match grid.light {
            Cow::Borrowed(_) => None,
            Cow::Owned(small) => Some(small.light),
        },
        registered: grid.registered,
        scene,
        prepared,
    })
}

/// Light and depth on one grid, from which surfaces are worked out.
#[derive(Debug, Clone)]
pub struct Grid<'a> {
    /// The light of the flash alone.
    pub light: Cow<'a, FlashOnly>,
    /// Depth.
    pub registered: RegisteredDepth,
    rig: Rig,
}

impl<'a> Grid<'a> {
    /// At most `pixels` pixels of a shot, `flash_only` being its light.
    ///
    /// # Errors
    /// [`DevelopError::Registration`] of depth that cannot be brought there.
    pub fn of(shot: &Shot, flash_only: &'a FlashOnly, pixels: usize) -> Result<Self, DevelopError> {
        let factor = reduction(flash_only.light.0.len(), pixels);
        if factor > 1 {
            return Self::reduced(shot, flash_only, factor);
        }
        Self::laid(Cow::Borrowed(flash_only), shot.rig, &shot.depth)
    }

    /// The same shot on a grid whose sides are `factor` times as coarse.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn coarser(&self, shot: &Shot, factor: usize) -> Result<Self, DevelopError> {
        Self::reduced(shot, &self.light, factor)
    }

    fn reduced(shot: &Shot, light: &FlashOnly, factor: usize) -> Result<Self, DevelopError> {
        let small = reduced(light, factor);
        let (rig, depth) = working_rig(shot, small.light.0.size());
        let depth = depth.as_ref().unwrap_or(&shot.depth);
        Self::laid(Cow::Owned(small), rig, depth)
    }

    fn laid(light: Cow<'a, FlashOnly>, rig: Rig, depth: &DepthFrame) -> Result<Self, DevelopError> {
        let maps = RigMaps::new(&rig)?;
        let registered = registration::register(depth, &maps, Some(&light.light))?;
        Ok(Self {
            light,
            registered,
            rig,
        })
    }

    /// The surfaces on this grid.
    ///
    /// # Errors
    /// [`DevelopError::Scene`] of light and depth of which no surfaces can be made.
    pub fn scene(&self, shot: &Shot, options: &SceneOptions) -> Result<Scene, DevelopError> {
        let mut scene = scene::estimate(&self.light, &self.registered, &self.rig, options)?;
        if let Some(mask) = &shot.mask {
            leave_out(&mut scene, mask);
        }
        Ok(scene)
    }
}

/// Makes surfaces outside the mask unknown. Their depth stays: what does not count as picture
/// still casts a shadow.
fn leave_out(scene: &mut Scene, mask: &Plane<bool>) {
    let (width, height) = scene.albedo.size();
    for y in 0..height {
        let row = mask.row(y * mask.height() / height);
        for (x, albedo) in scene.albedo.row_mut(y).iter_mut().enumerate() {
            if !row[x * mask.width() / width] {
                *albedo = <[f32; 3]>::UNKNOWN;
            }
        }
    }
}
