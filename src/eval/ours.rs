//! Row 8: our own model, with every term or with those that a shot needs.

use super::methods::{
    Answer, AnswerTime, Method, MethodError, Study, Subject, SurfaceAnswer, of_scene,
};
use super::roster::{OURS_AUTO, OURS_BIC, OURS_EVERYTHING, OURS_ONE_STANDARD_ERROR};
use crate::develop;
use crate::parsimony::{CostModel, Criterion, Glance, Model, Plan, Rule, Shadow, Terms, Workload};
use crate::radiometry::FlashOnly;
use crate::relight::{
    Lamp,
    networks::{Network, NetworkRecord, compact::Compact},
};
use serde::{Deserialize, Serialize};
use std::rc::Rc;
use std::time::Instant;

/// How the terms are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// All of them.
    Everything,
    /// By a criterion.
    By(Criterion),
}

impl Choice {
    /// Every way that stands in the table.
    pub const ALL: [Self; 4] = [
        Self::Everything,
        Self::By(Criterion::Visible),
        Self::By(Criterion::Predicted(Rule::OneStandardError)),
        Self::By(Criterion::Predicted(Rule::Bic)),
    ];

    /// The row's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Everything => OURS_EVERYTHING,
            Self::By(Criterion::Visible) => OURS_AUTO,
            Self::By(Criterion::Predicted(Rule::OneStandardError)) => OURS_ONE_STANDARD_ERROR,
            Self::By(Criterion::Predicted(Rule::Bic)) => OURS_BIC,
        }
    }
}

/// Our model.
pub struct Ours {
    /// How its terms are chosen.
    pub choice: Choice,
    /// What terms cost here.
    pub costs: CostModel,
    /// The compact networks; without them closed forms are the most there is.
    pub networks: Option<Rc<Compact>>,
    /// How shots are developed.
    pub develop: develop::Options,
}

/// The terms that a capture was modelled with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Chosen {
    /// The terms.
    pub terms: Terms,
    /// By how much a side of the photograph's grid was shrunk.
    pub factor: usize,
    /// What leaving the others out was expected to change, root mean square, linear light, white = 1;
    /// `None` where nothing was looked at.
    pub expected_change: Option<f32>,
    /// Whether depth that the photograph contradicts was left out.
    pub depth_left_out: bool,
    /// Share of the photograph that answers were mixed with, [0, 0.9].
    pub hedge: f32,
    /// Choosing, milliseconds.
    pub choosing_ms: f64,
    /// Developing with the terms from the flash's light on, milliseconds.
    pub developing_ms: f64,
}

impl Method for Ours {
    fn row(&self) -> u8 {
        8
    }

    fn name(&self) -> &str {
        self.choice.name()
    }

    fn networks(&self) -> Option<Vec<NetworkRecord>> {
        let networks = self.networks.as_ref();
        Some(networks.map_or_else(Vec::new, |compact| compact.records().into()))
    }

    fn study<'a>(&'a self, subject: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
        let shot = &subject.capture.shot;
        let flash_only = subject.development.flash_only.clone();
        let work = work_of(&flash_only, &self.develop);
        let failed = |error: develop::DevelopError| MethodError::Silent(error.to_string());
        let began = Instant::now();
        let networks = self.networks.as_deref();
        let (glance, criterion) = match self.choice {
            Choice::Everything => (Glance::nothing_known(), Criterion::Visible),
            Choice::By(criterion) => {
                let glance = Glance::at(shot, &flash_only, &self.develop).map_err(failed)?;
                (glance, criterion)
            }
        };
        let known = networks.is_some();
        let plan = Plan::sufficient(&glance, criterion, &self.costs, work, known);
        let choosing = began.elapsed();
        let began = Instant::now();
        let build = match self.choice {
            Choice::Everything | Choice::By(Criterion::Visible) => Model::careful,
            _ => Model::new,
        };
        let model = build(shot, flash_only, &plan, &glance, &self.develop, &mut |_| ());
        let mut model = model.map_err(failed)?;
        let networks = networks.filter(|_| plan.terms.shadow == Shadow::Network);
        if let Some(networks) = networks {
            let surfaces = glance
                .asks_for_surfaces()
                .then(|| networks.surfaces.as_ref());
            model = model.refined(shot, surfaces)?;
        }
        let chosen = Chosen {
            terms: plan.terms,
            factor: plan.factor,
            expected_change: plan.change.is_finite().then_some(plan.change),
            depth_left_out: model.depth_left_out,
            hedge: model.hedge(),
            choosing_ms: 1e3 * choosing.as_secs_f64(),
            developing_ms: 1e3 * began.elapsed().as_secs_f64(),
        };
        Ok(Box::new(OurStudy {
            model,
            chosen,
            light: networks.map(|compact| compact.light.as_ref()),
        }))
    }
}

fn work_of(flash_only: &FlashOnly, develop: &develop::Options) -> Workload {
    Workload {
        pixels: flash_only.light.0.len(),
        working_pixels: develop.working_pixels,
        // As if a person asked for a handful.
        lamps: 4,
    }
}

struct OurStudy<'a> {
    model: Model,
    chosen: Chosen,
    light: Option<&'a dyn Network>,
}

impl Study for OurStudy<'_> {
    fn surfaces(&self) -> SurfaceAnswer<'_> {
        of_scene(&self.model.development)
    }

    fn terms(&self) -> Option<Chosen> {
        Some(self.chosen)
    }

    fn relight(&mut self, _: usize, lamp: &Lamp) -> Result<Option<Answer>, MethodError> {
        let relit = self.model.relight(lamp, self.light)?;
        Ok(Some(Answer {
            light: relit.light.0,
            shadow: Some(relit.shadow),
            time: AnswerTime::Call,
        }))
    }
}
