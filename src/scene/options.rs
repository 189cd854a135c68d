//! What may be assumed about a scene, and what is wrong with what was given.

use drivers::Rig;
use serde::{Deserialize, Serialize};
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
    /// How freely surfaces may be shaped.
    pub shape: Shape,
    /// How freely surfaces may shine.
    pub material: Material,
    /// Also asks the photograph how freely surfaces need to shine ([`super::Shine`]).
    pub weigh_materials: bool,
}

/// How freely surfaces may be shaped: nested models, the simplest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// The whole picture shows one plane; what the depth says beside it is noise.
    Plane,
    /// As the depth says.
    #[default]
    Measured,
}

/// How freely surfaces may shine: nested models, the simplest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Material {
    /// Not at all: no highlight is looked for, none is shaded.
    Matte,
    /// All alike: one roughness for the whole picture.
    OneRoughness,
    /// Every piece of surface by its own roughness.
    #[default]
    Varying,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            smoothing: 1.0,
            least_thickness_metres: 0.03,
            most_thickness_metres: 0.5,
            shape: Shape::default(),
            material: Material::default(),
            weigh_materials: false,
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

/// Numbers of the rig and the options that no scene can be made with.
pub(super) fn check_ranges(rig: &Rig, options: &SceneOptions) -> Result<(), SceneError> {
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
