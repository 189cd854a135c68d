//! The rows that stand in every table: ways to answer "the same photograph under this lamp".

use crate::develop::Development;
use crate::relight::{Lamp, RelightOptions};
use drivers::Plane;

/// What a method answers with, on the working grid of the scene or on that of the photograph.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Linear light, a white Lambertian facing the lamp = 1.0; NaN = no answer.
    pub light: Plane<[f32; 3]>,
    /// 0 = shadow, 1 = lit; NaN = no answer.
    pub shadow: Plane<f32>,
}

/// One way to relight a developed shot.
pub trait Method {
    /// Its number in every table; a number is never given to another method.
    fn row(&self) -> u8;

    /// What it is called in tables.
    fn name(&self) -> &str;

    /// True when its light is never absolute, so that the best global scale is always its due.
    fn scale_is_free(&self) -> bool {
        false
    }

    /// The photograph under one lamp; its time is what the cost column shows.
    fn relight(&self, development: &Development, lamp: &Lamp) -> Answer;
}

/// Row 1: the flash photograph, whatever the lamp.
#[derive(Debug, Clone, Copy)]
pub struct DoNothing;

impl Method for DoNothing {
    fn row(&self) -> u8 {
        1
    }

    fn name(&self) -> &str {
        "do nothing"
    }

    fn scale_is_free(&self) -> bool {
        true
    }

    fn relight(&self, development: &Development, _: &Lamp) -> Answer {
        let light = development.flash_only.light.0.clone();
        let shadow = light.map(|_| 1.0);
        Answer { light, shadow }
    }
}

/// Row 2: albedo × n·l of the same scene; only what is turned away is dark.
#[derive(Debug, Clone, Copy)]
pub struct Matte;

impl Method for Matte {
    fn row(&self) -> u8 {
        2
    }

    fn name(&self) -> &str {
        "matte, no shadow"
    }

    fn relight(&self, development: &Development, lamp: &Lamp) -> Answer {
        let scene = &development.scene;
        let cosine = scene.normal.map(|normal| normal.dot(lamp.toward()));
        let (width, height) = scene.albedo.size();
        let light = Plane::from_fn(width, height, |x, y| {
            // `f32::max` would turn an unknown normal into black.
            let facing = cosine[(x, y)];
            let facing = if facing < 0.0 { 0.0 } else { facing };
            let albedo = scene.albedo[(x, y)];
            std::array::from_fn(|channel| albedo[channel] * facing * lamp.color[channel])
        });
        let shadow = cosine.map(|cosine| {
            if cosine.is_nan() {
                f32::NAN
            } else if *cosine > 0.0 {
                1.0
            } else {
                0.0
            }
        });
        Answer { light, shadow }
    }
}

/// Row 3: swept shadows and one-bounce shading, no network.
#[derive(Debug, Clone, Copy, Default)]
pub struct ClosedForm {
    /// What to model beyond the direct light.
    pub options: RelightOptions,
}

impl Method for ClosedForm {
    fn row(&self) -> u8 {
        3
    }

    fn name(&self) -> &str {
        "closed form: swept shadows, one bounce"
    }

    fn relight(&self, development: &Development, lamp: &Lamp) -> Answer {
        let relit = development.finish(development.prepared.relight(lamp, self.options));
        Answer {
            light: relit.light.0,
            shadow: relit.shadow,
        }
    }
}

/// Rows that nothing in this project answers yet: number, name, reason.
pub(super) const MISSING: [(u8, &str, &str); 5] = [
    (4, "the paper's three networks", "not trained yet"),
    (5, "the paper's networks without depth", "not trained yet"),
    (
        6,
        "OSS: five lights in, one network",
        "not trained yet; captures have one flash light",
    ),
    (
        7,
        "reconstruction: mesh, path-traced",
        "no meshing and path tracing here yet",
    ),
    (
        8,
        "ours, each tier and adaptive",
        "no tier beyond the closed form yet",
    ),
];
