//! Rows 4 and 5: networks as methods. What runs them is not known here.

use super::methods::{Answer, AnswerTime, Method, MethodError, Study, Subject, SurfaceAnswer};
use super::roster::{PAPER_CLEAN, PAPER_ENV, PAPER_NOISY, SIPS};
use crate::radiometry::{LinearImage, linearise};
use crate::relight::networks::{
    Decomposed, Feed, Network, NetworkError, NetworkRecord, Paper, Variant, resampled,
};
use crate::relight::{Lamp, Relit, enlarge::Mix};
use drivers::Plane;
use std::borrow::Cow;

impl From<NetworkError> for MethodError {
    fn from(error: NetworkError) -> Self {
        Self::Failed(error.to_string())
    }
}

/// Row 4: all three networks of one variant.
pub struct ThreeNetworks(pub Paper);

impl Method for ThreeNetworks {
    fn row(&self) -> u8 {
        4
    }

    fn name(&self) -> &str {
        match self.0.variant {
            Variant::Clean => PAPER_CLEAN,
            Variant::Noisy => PAPER_NOISY,
        }
    }

    fn networks(&self) -> Option<Vec<NetworkRecord>> {
        Some(self.0.records().into())
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let feed = subject
            .development
            .feed(&subject.capture.shot, self.0.variant);
        let surfaces = self.0.decompose(&feed)?;
        Ok(Box::new(NetworkStudy {
            subject,
            feed,
            surfaces,
            light: Light::ByNetworks(&self.0),
        }))
    }
}

/// Row 4, Env: surfaces alone, of the photograph with the room's light left in; flash, near, mask →
/// albedo, normal, roughness.
pub struct WithRoomLight(pub Box<dyn Network>);

impl Method for WithRoomLight {
    fn row(&self) -> u8 {
        4
    }

    fn name(&self) -> &str {
        PAPER_ENV
    }

    fn networks(&self) -> Option<Vec<NetworkRecord>> {
        Some(vec![self.0.record()])
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let (shot, development) = (&subject.capture.shot, subject.development);
        let photograph = linearise(&shot.flash).map_err(|e| MethodError::Failed(e.to_string()))?;
        let working = LinearImage(resampled(&photograph.0, development.scene.albedo.size()));
        let feed = development.feed_light(shot, Variant::Clean, &working);
        let given = [
            ("flash", &feed.flash),
            ("near", &feed.near),
            ("mask", &feed.mask),
        ];
        let surfaces = Decomposed::ask(self.0.as_ref(), &given)?;
        Ok(Box::new(NetworkStudy {
            subject,
            feed,
            surfaces,
            light: Light::Unasked,
        }))
    }
}

/// Row 5: surfaces from the flash photograph alone, then closed-form shading without cast shadows.
pub struct WithoutDepth(pub Box<dyn Network>);

impl Method for WithoutDepth {
    fn row(&self) -> u8 {
        5
    }

    fn name(&self) -> &str {
        SIPS
    }

    fn networks(&self) -> Option<Vec<NetworkRecord>> {
        Some(vec![self.0.record()])
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let feed = subject
            .development
            .feed(&subject.capture.shot, Variant::Clean);
        let surfaces = Decomposed::ask(self.0.as_ref(), &[("flash", &feed.flash)])?;
        Ok(Box::new(NetworkStudy {
            subject,
            feed,
            surfaces,
            light: Light::Shaded,
        }))
    }
}

/// Where relit pictures come from.
enum Light<'a> {
    ByNetworks(&'a Paper),
    Shaded,
    Unasked,
}

struct NetworkStudy<'a> {
    subject: Subject<'a>,
    feed: Feed,
    surfaces: Decomposed,
    light: Light<'a>,
}

impl NetworkStudy<'_> {
    /// No answer where no surface is known: networks speak of the empty background too.
    fn known<T: Mix>(&self, mut plane: Plane<T>) -> Plane<T> {
        let known = self.feed.mask.channel(0);
        for (sample, known) in plane.samples_mut().iter_mut().zip(known) {
            if *known == 0.0 {
                *sample = T::UNKNOWN;
            }
        }
        plane
    }

    fn finished(&self, relit: Relit) -> Relit {
        self.subject.development.finish_fed(&self.feed, relit)
    }
}

impl Study for NetworkStudy<'_> {
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        SurfaceAnswer {
            albedo: Some(Cow::Owned(self.known(self.surfaces.albedo()))),
            normal: Some(Cow::Owned(self.known(self.surfaces.normal()))),
            roughness: Some(Cow::Owned(self.known(self.surfaces.roughness()))),
        }
    }

    fn relight(&mut self, _: usize, lamp: &Lamp) -> Result<Option<Answer>, MethodError> {
        let (feed, surfaces) = (&self.feed, &self.surfaces);
        let (relit, casts) = match self.light {
            Light::ByNetworks(paper) => (paper.relight(feed, surfaces, lamp)?, true),
            Light::Shaded => (surfaces.shaded(&feed.camera, lamp), false),
            Light::Unasked => return Ok(None),
        };
        let relit = self.finished(Relit {
            light: LinearImage(self.known(relit.light.0)),
            shadow: self.known(relit.shadow),
            ..relit
        });
        Ok(Some(Answer {
            light: relit.light.0,
            shadow: casts.then_some(relit.shadow),
            time: AnswerTime::Call,
        }))
    }
}
