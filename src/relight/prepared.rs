//! Everything a light needs, computed once per scene, and the answer for one lamp.

use super::lamp::Lamp;
use crate::{radiometry::LinearImage, scene::Scene};
use drivers::Plane;

/// Which cast shadows to compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shadows {
    /// None: only surfaces turned away are dark.
    None,
    /// Lit or not, nothing between.
    Hard,
    /// The probability of being lit, given the depth's sigma.
    #[default]
    Probabilistic,
}

/// Light that arrives after more than one bounce.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Indirect {
    /// None.
    None,
    /// One value for the whole picture, from what the lamp lights directly.
    #[default]
    Constant,
}

/// What to model beyond the direct light.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RelightOptions {
    /// Cast shadows.
    pub shadows: Shadows,
    /// Bounced light.
    pub indirect: Indirect,
}

/// The photograph under a new light.
#[derive(Debug, Clone)]
pub struct Relit {
    /// Scene-linear; a white Lambertian facing the lamp = 1.0; NaN = unknown.
    pub light: LinearImage,
    /// 0 = shadow, 1 = lit, between = probability; NaN = unknown.
    pub shadow: Plane<f32>,
    /// Fraction of pixels called lit although the path to the lamp leaves the frame while still
    /// inside the scene's range of depth: an occluder outside the picture cannot be excluded.
    pub unseen_path_fraction: f32,
}

/// A scene made ready for any number of lights.
#[derive(Debug, Clone)]
pub struct Prepared {
    scene: Scene,
}

impl Prepared {
    /// Computes once what every light needs.
    pub fn new(scene: &Scene) -> Self {
        Self { scene: scene.clone() }
    }

    /// The scene under one lamp.
    pub fn relight(&self, lamp: &Lamp, _options: RelightOptions) -> Relit {
        let (width, height) = self.scene.albedo.size();
        let light = Plane::from_fn(width, height, |x, y| {
            let n_dot_l = self.scene.normal[(x, y)].dot(lamp.toward()).max(0.0);
            let albedo = self.scene.albedo[(x, y)];
            std::array::from_fn(|c| albedo[c] * n_dot_l * lamp.color[c])
        });
        let shadow = Plane::filled(width, height, 1.0);
        Relit { light: LinearImage(light), shadow, unseen_path_fraction: 0.0 }
    }
}
