//! Rows that were answered elsewhere, by a script or another program, and joined as folders.

use super::methods::{
    Answer, AnswerTime, DepthGiven, Method, MethodError, Study, Subject, SurfaceAnswer,
};
use crate::folder::Answers;
use crate::relight::{Lamp, networks::NetworkRecord};
use drivers::Plane;
use glam::Vec3;
use std::{borrow::Cow, path::PathBuf};

/// A row whose answers lie in a folder with one sub-folder per capture, of the capture's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ForeignRow {
    /// Its number.
    pub number: u8,
    /// What it is called.
    pub name: String,
    /// Answers to captures as they are.
    pub clean: Option<PathBuf>,
    /// Answers to captures with noise on their depth.
    pub noisy: Option<PathBuf>,
}

impl Method for ForeignRow {
    fn row(&self) -> u8 {
        self.number
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn networks(&self) -> Option<Vec<NetworkRecord>> {
        None
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let (folder, option) = match subject.depth {
            DepthGiven::Clean => (&self.clean, "--answers"),
            DepthGiven::Noisy => (&self.noisy, "--noisy-answers"),
            DepthGiven::Spoiled => {
                let reason = "answered elsewhere, and not for captures made worse".to_owned();
                return Err(MethodError::Silent(reason));
            }
        };
        let Some(folder) = folder else {
            let reason = format!("no answers given ({option} {}=DIR)", self.number);
            return Err(MethodError::Silent(reason));
        };
        let folder = folder.join(&subject.capture.name);
        let size = subject.capture.shot.flash.pixels.size();
        let truth = subject.capture.truth.as_ref();
        let lights = truth.map_or(0, |truth| truth.lights.len());
        let Some(answers) = Answers::read(&folder, size, lights)? else {
            let reason = format!("{}: there is no such folder", folder.display());
            return Err(MethodError::Silent(reason));
        };
        Ok(Box::new(ForeignStudy {
            albedo: answers.albedo()?.map(|albedo| albedo.0),
            normal: answers.normal()?,
            roughness: answers.roughness()?,
            answers,
        }))
    }
}

struct ForeignStudy {
    answers: Answers,
    albedo: Option<Plane<[f32; 3]>>,
    normal: Option<Plane<Vec3>>,
    roughness: Option<Plane<f32>>,
}

impl Study for ForeignStudy {
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        SurfaceAnswer {
            albedo: self.albedo.as_ref().map(Cow::Borrowed),
            normal: self.normal.as_ref().map(Cow::Borrowed),
            roughness: self.roughness.as_ref().map(Cow::Borrowed),
        }
    }

    fn relight(&mut self, light: usize, _: &Lamp) -> Result<Option<Answer>, MethodError> {
        let Some(relit) = self.answers.relit(light)? else {
            return Ok(None);
        };
        Ok(Some(Answer {
            light: relit.0,
            shadow: self.answers.shadow(light)?,
            time: AnswerTime::Elsewhere(self.answers.milliseconds(light)),
        }))
    }
}
