//! The terms of a scene's model, nested from "none" to "everything".

use crate::{
    develop::Options,
    relight::{Blocked, Preparation},
    scene::{Material, Shape},
};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Where surfaces are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Geometry {
    /// On one plane.
    Plane,
    /// As the depth says, on a coarser grid.
    Smooth,
    /// As the depth says.
    Full,
}

/// Which shadows are cast.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shadow {
    /// None: only what is turned away from a lamp is dark.
    None,
    /// Those of the depth's own slabs.
    Swept,
    /// The same; a compact network corrects them and bounced light, and another the surfaces as far as their depth is in
    /// doubt.
    Network,
}

/// Light that arrives after a bounce.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bounced {
    /// None.
    None,
    /// As if every surface saw the same share of the others.
    Constant,
    /// By what each surface sees of the others.
    Predicted,
}

/// One choice of all terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Terms {
    /// Where surfaces are.
    pub geometry: Geometry,
    /// How surfaces shine.
    pub material: Material,
    /// Which shadows are cast.
    pub shadow: Shadow,
    /// Light that arrives after a bounce.
    pub indirect: Bounced,
}

impl Terms {
    /// All of them.
    pub const EVERYTHING: Self = Self {
        geometry: Geometry::Full,
        material: Material::Varying,
        shadow: Shadow::Network,
        indirect: Bounced::Predicted,
    };

    /// All that need no network.
    pub const CLOSED: Self = Self {
        shadow: Shadow::Swept,
        ..Self::EVERYTHING
    };

    /// The fewest: a matte plane.
    pub const FEWEST: Self = Self {
        geometry: Geometry::Plane,
        material: Material::Matte,
        shadow: Shadow::None,
        indirect: Bounced::None,
    };

    /// How a shot is developed with these terms. `blocked` is the mean share of the hemisphere that the
    /// scene blocks, [0, 1].
    pub fn options(self, base: &Options, blocked: f32) -> Options {
        let mut options = *base;
        options.scene.material = self.material;
        options.scene.shape = match self.geometry {
            Geometry::Plane => Shape::Plane,
            Geometry::Smooth | Geometry::Full => Shape::Measured,
        };
        options.prepare = Preparation {
            shadows: self.shadow != Shadow::None,
            blocked: match self.indirect {
                Bounced::None => Blocked::Nothing,
                Bounced::Constant => Blocked::Evenly(blocked),
                Bounced::Predicted => Blocked::Swept,
            },
        };
        options
    }
}

impl fmt::Display for Terms {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let geometry = match self.geometry {
            Geometry::Plane => "one plane",
            Geometry::Smooth => "smooth surfaces",
            Geometry::Full => "full geometry",
        };
        let material = match self.material {
            Material::Matte => "matte",
            Material::OneRoughness => "one roughness",
            Material::Varying => "varying roughness",
        };
        let shadow = match self.shadow {
            Shadow::None => "no cast shadow",
            Shadow::Swept => "swept shadows",
            Shadow::Network => "swept shadows, light and doubtful surfaces corrected by networks",
        };
        let indirect = match self.indirect {
            Bounced::None => "no bounced light",
            Bounced::Constant => "even bounced light",
            Bounced::Predicted => "bounced light by what is near",
        };
        write!(f, "{geometry}, {material}, {shadow}, {indirect}")
    }
}
