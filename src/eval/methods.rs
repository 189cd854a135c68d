//! Ways to answer "the same photograph under this lamp", and the three that stand in every table.

use super::ours::Chosen;
use crate::develop::Development;
use crate::folder::{Capture, FolderError};
use crate::radiometry::photograph;
use crate::relight::{Lamp, RelightOptions, networks::NetworkRecord};
use drivers::Plane;
use glam::Vec3;
use serde::Serialize;
use std::borrow::Cow;
use thiserror::Error;

/// Which depth a method was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthGiven {
    /// As the capture has it.
    Clean,
    /// With noise on it.
    Noisy,
    /// Made worse in one of the ways of [`crate::corruption`], or about to be: a trial of which no
    /// answers made elsewhere exist.
    Spoiled,
}

/// What a method is asked about: one capture, developed.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Name and shot as they are developed, noise on the depth and all.
    pub capture: &'a Capture,
    /// The capture on its way through [`crate::develop`].
    pub development: &'a Development,
    /// Which depth is in both.
    pub depth: DepthGiven,
}

/// One way to relight.
pub trait Method {
    /// Its number in every table, 1 to 99.
    fn row(&self) -> u8;

    /// What it is called in tables; rows of one number differ in it.
    fn name(&self) -> &str;

    /// True when its light is never absolute, so that the best global scale is always its due.
    fn scale_is_free(&self) -> bool {
        false
    }

    /// The networks that it may ask; `None` where nobody knows.
    fn networks(&self) -> Option<Vec<NetworkRecord>> {
        Some(Vec::new())
    }

    /// Everything that is done once per capture, before any lamp is known.
    ///
    /// # Errors
    /// [`MethodError::Silent`] when it has no answer for this capture, which is counted; any other
    /// ends the evaluation.
    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError>;
}

/// One method's understanding of one capture.
pub trait Study {
    /// What it takes the scene to be made of; empty where it does not ask.
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        SurfaceAnswer::default()
    }

    /// The terms it models the capture with, where it chose them.
    fn terms(&self) -> Option<Chosen> {
        None
    }

    /// The photograph under light number `light` of the truth, which is `lamp`; `None` without an
    /// answer. Its time is what the cost column shows.
    ///
    /// # Errors
    /// [`MethodError`] when the answer could not be worked out; ends the evaluation.
    fn relight(&mut self, light: usize, lamp: &Lamp) -> Result<Option<Answer>, MethodError>;
}

/// Surfaces on the working grid of the scene, that of the photograph, or any other over the same
/// picture.
#[derive(Debug, Clone, Default)]
pub struct SurfaceAnswer<'a> {
    /// Diffuse albedo, linear, in [0, 1]; NaN = no answer.
    pub albedo: Option<Cow<'a, Plane<[f32; 3]>>>,
    /// Unit normals in camera axes (x right, y down, z forward); NaN = no answer.
    pub normal: Option<Cow<'a, Plane<Vec3>>>,
    /// Karis roughness in (0, 1]; NaN = no answer.
    pub roughness: Option<Cow<'a, Plane<f32>>>,
}

/// A relit photograph, on any grid over the same picture.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Linear light, a white Lambertian facing the lamp = 1.0; NaN = no answer.
    pub light: Plane<[f32; 3]>,
    /// 0 = shadow, 1 = lit; NaN = no answer. `None` where the method knows no shadow apart.
    pub shadow: Option<Plane<f32>>,
    /// How long it took.
    pub time: AnswerTime,
}

/// Who knows how long an answer took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AnswerTime {
    /// Whoever asked: the answer was worked out in the call.
    Call,
    /// Milliseconds, measured elsewhere; `None` = nobody.
    Elsewhere(Option<f64>),
}

/// Why a method does not answer.
#[derive(Debug, Error)]
pub enum MethodError {
    /// It has nothing to say about this capture: the reason.
    #[error("{0}")]
    Silent(String),
    /// An answer made elsewhere cannot be read.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// It failed: what, and what to do.
    #[error("{0}")]
    Failed(String),
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

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let frame = &subject.capture.shot.flash;
        let whole = photograph(&subject.development.flash_only, frame);
        let whole = whole.map_err(|error| MethodError::Failed(error.to_string()))?;
        Ok(Box::new(Photograph(whole.0)))
    }
}

/// One picture, whatever the lamp.
pub(super) struct Photograph(pub Plane<[f32; 3]>);

impl Study for Photograph {
    fn relight(&mut self, _: usize, _: &Lamp) -> Result<Option<Answer>, MethodError> {
        let light = self.0.clone();
        let shadow = Some(light.map(|_| 1.0));
        Ok(Some(Answer {
            light,
            shadow,
            time: AnswerTime::Call,
        }))
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

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        Ok(Box::new(MatteStudy(subject.development)))
    }
}

struct MatteStudy<'a>(&'a Development);

impl Study for MatteStudy<'_> {
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        of_scene(self.0)
    }

    fn relight(&mut self, _: usize, lamp: &Lamp) -> Result<Option<Answer>, MethodError> {
        let scene = &self.0.scene;
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
        Ok(Some(Answer {
            light,
            shadow: Some(shadow),
            time: AnswerTime::Call,
        }))
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

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        Ok(Box::new(ClosedStudy {
            development: subject.development,
            options: self.options,
        }))
    }
}

struct ClosedStudy<'a> {
    development: &'a Development,
    options: RelightOptions,
}

impl Study for ClosedStudy<'_> {
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        of_scene(self.development)
    }

    fn relight(&mut self, _: usize, lamp: &Lamp) -> Result<Option<Answer>, MethodError> {
        let Self {
            development,
            options,
        } = self;
        let relit = development.finish(development.prepared.relight(lamp, *options));
        Ok(Some(Answer {
            light: relit.light.0,
            shadow: Some(relit.shadow),
            time: AnswerTime::Call,
        }))
    }
}

/// The surfaces of the developed scene.
pub(super) fn of_scene(development: &Development) -> SurfaceAnswer<'_> {
    let scene = &development.scene;
    SurfaceAnswer {
        albedo: Some(Cow::Borrowed(&scene.albedo)),
        normal: Some(Cow::Borrowed(&scene.normal)),
        roughness: Some(Cow::Borrowed(&scene.roughness)),
    }
}
