//! Row 9: what can be had of a shot whose flash photograph is not looked at.

use super::methods::{
    Answer, AnswerTime, Method, MethodError, Photograph, Study, Subject, SurfaceAnswer, of_scene,
};
use crate::develop::{self, Development, develop};
use crate::infrared::lit_by_infrared;
use crate::radiometry::linearise;
use crate::relight::{Lamp, RelightOptions};

/// The room's photograph, whatever the lamp.
#[derive(Debug, Clone, Copy)]
pub struct RoomPhotograph;

impl Method for RoomPhotograph {
    fn row(&self) -> u8 {
        9
    }

    fn name(&self) -> &str {
        "no flash: the room's photograph as it is"
    }

    fn scale_is_free(&self) -> bool {
        true
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let room = subject.capture.shot.ambient.first();
        let room = room.ok_or_else(|| {
            MethodError::Silent("there is no photograph without flash".to_owned())
        })?;
        let light = linearise(room).map_err(|error| MethodError::Failed(error.to_string()))?;
        Ok(Box::new(Photograph(light.0)))
    }
}

/// The closed form with the depth camera's infrared light in the flash's place.
#[derive(Debug, Clone, Copy, Default)]
pub struct Infrared {
    /// How shots are developed.
    pub develop: develop::Options,
}

impl Method for Infrared {
    fn row(&self) -> u8 {
        9
    }

    fn name(&self) -> &str {
        "no flash: infrared in its place, closed form"
    }

    fn scale_is_free(&self) -> bool {
        true
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let silent = |error: &dyn std::error::Error| MethodError::Silent(error.to_string());
        let shot = lit_by_infrared(&subject.capture.shot).map_err(|error| silent(&error))?;
        let development =
            develop(&shot, &self.develop, &mut |_| ()).map_err(|error| silent(&error))?;
        Ok(Box::new(InfraredStudy(development)))
    }
}

struct InfraredStudy(Development);

impl Study for InfraredStudy {
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        of_scene(&self.0)
    }

    fn relight(&mut self, _: usize, lamp: &Lamp) -> Result<Option<Answer>, MethodError> {
        let relit = self.0.prepared.relight(lamp, RelightOptions::default());
        let relit = self.0.finish(relit);
        Ok(Some(Answer {
            light: relit.light.0,
            shadow: Some(relit.shadow),
            time: AnswerTime::Call,
        }))
    }
}
