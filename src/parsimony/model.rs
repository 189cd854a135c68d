//! A shot modelled with chosen terms, ready for lamps.

use super::{
    fallback::{self, SURE, hedged, unwrapped, without},
    glance::Glance,
    plan::Plan,
    terms::Terms,
};
use crate::{
    develop::{DevelopError, Development, Options, Stage, develop_light},
    radiometry::{FlashOnly, LinearImage, photograph},
    relight::{
        Emitter, RelightOptions, Relit,
        networks::{Network, NetworkError, compact::Correction},
        summed,
    },
    shot::Shot,
    verdict::{Verdict, contradicted, judge},
};
use std::borrow::Cow;

/// Rounds in which depth is left out: behind what goes, more may show.
const MOST_ROUNDS: usize = 3;

/// What distances beyond the camera's range are called.
const PHASE_WRAP: &str = "phase-wrap";
/// Share of that finding that may be left when they are brought back.
const UNWRAPPED: f32 = 0.3;

/// Share of the picture that may become unknown when depth is left out.
const MOST_UNKNOWN: f32 = 0.2;

/// Share of the working grid whose depth is unknown.
fn unknown(development: &Development) -> f32 {
    let metres = &development.scene.depth_metres;
    let unknown = metres.samples().iter().filter(|metres| metres.is_nan());
    unknown.count() as f32 / metres.len().max(1) as f32
}

/// A shot modelled with chosen terms.
#[derive(Debug, Clone)]
pub struct Model {
    /// The shot, understood.
    pub development: Development,
    /// The terms.
    pub terms: Terms,
    /// What the shot says about itself; only of a careful model.
    pub verdict: Option<Verdict>,
    /// Whether depth that the photograph contradicts was left out.
    pub depth_left_out: bool,
    /// The photograph and how answers lean on it, where they do.
    leaning: Option<(LinearImage, f32)>,
    /// What a network corrects its light by, where the model was refined.
    correction: Option<Box<Correction>>,
}

impl Model {
    /// Develops a shot as planned. `flash_only` is its light; `glance` what a look at it found.
    ///
    /// # Errors
    /// [`DevelopError`] of the stage that could not answer.
    pub fn new(
        shot: &Shot,
        flash_only: FlashOnly,
        plan: &Plan,
        glance: &Glance,
        base: &Options,
        begins: &mut dyn FnMut(Stage),
    ) -> Result<Self, DevelopError> {
        let options = plan.options(base, flash_only.light.0.len(), glance.blocked);
        let development = develop_light(shot, flash_only, &options, begins)?;
        Ok(Self {
            verdict: None,
            depth_left_out: false,
            leaning: None,
            development,
            terms: plan.terms,
            correction: None,
        })
    }

    /// The same, but what the shot's own evidence says would do harm is left out: distances beyond the
    /// camera's range are brought back where that explains the light, depth that the
    /// photograph contradicts is filled from its surroundings, and where nothing is sure answers are
    /// mixed with the photograph.
    ///
    /// # Errors
    /// [`DevelopError`] of the stage that could not answer.
    pub fn careful(
        shot: &Shot,
        flash_only: FlashOnly,
        plan: &Plan,
        glance: &Glance,
        base: &Options,
        begins: &mut dyn FnMut(Stage),
    ) -> Result<Self, DevelopError> {
        let mut model = Self::new(shot, flash_only, plan, glance, base, begins)?;
        let mut verdict = judge(shot, &model.development);
        let mut hedge = fallback::hedge(&verdict);
        let mut wrong = verdict.contradicted.take();
        let mut filled = Cow::Borrowed(shot);
        let wraps = verdict.score(PHASE_WRAP);
        if let Some(wrapped) = verdict.wrapped.take().filter(|_| wraps > SURE) {
            let again = unwrapped(shot, &model.development, &wrapped);
            let flash_only = model.development.flash_only.clone();
            let other = Self::new(&again, flash_only, plan, glance, base, begins)?;
            let found = judge(&again, &other.development);
            // What was found of the shot as it came stays said; what follows from it does not.
            if found.score(PHASE_WRAP) < UNWRAPPED * wraps {
                hedge = fallback::hedge(&found);
                verdict.confidence = found.confidence;
                wrong = found.contradicted;
                model = other;
                filled = Cow::Owned(again);
            }
        }
        let most_unknown = MOST_UNKNOWN + unknown(&model.development);
        for _ in 0..MOST_ROUNDS {
            let Some(pixels) = wrong else { break };
            let without = without(&filled, &model.development, &pixels);
            let flash_only = model.development.flash_only.clone();
            let other = Self::new(&without, flash_only, plan, glance, base, begins)?;
            // Holes that nothing around them fills answer less than wrong depth does.
            if unknown(&other.development) > most_unknown {
                break;
            }
            model = other;
            filled = Cow::Owned(without);
            model.depth_left_out = true;
            wrong = contradicted(&filled, &model.development);
        }
        if model.depth_left_out {
            // What was filled need not be doubted any more.
            hedge = fallback::hedge(&judge(&filled, &model.development));
        }
        if let Some(hedge) = hedge {
            let flash_only = &model.development.flash_only;
            model.leaning = Some((photograph(flash_only, &shot.flash)?, hedge));
        }
        model.verdict = Some(verdict);
        Ok(model)
    }

    /// The same with its surfaces corrected by the compact network `surfaces`, or as they are without one;
    /// [`Self::relight`] is then to be given the compact network of light. `shot` is the one that was developed.
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn refined(
        mut self,
        shot: &Shot,
        surfaces: Option<&dyn Network>,
    ) -> Result<Self, NetworkError> {
        let development = &mut self.development;
        if let Some(surfaces) = surfaces {
            development.refine(shot, surfaces)?;
        }
        let correction = Correction::of(&development.scene, &development.prepared);
        self.correction = Some(Box::new(correction));
        Ok(self)
    }

    /// Share of the photograph that answers are mixed with, [0, 0.9].
    pub fn hedge(&self) -> f32 {
        self.leaning.as_ref().map_or(0.0, |(_, share)| *share)
    }

    /// The photograph under a lamp, distant or near, at its own size. Without a `network` swept shadows stay as they are;
    /// it is the compact one of light, for a model that was [refined](Self::refined).
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn relight(
        &self,
        lamp: impl Into<Emitter>,
        network: Option<&dyn Network>,
    ) -> Result<Relit, NetworkError> {
        self.relight_all(&[lamp.into()], network)
    }

    /// The photograph under several lamps at once, such as those that stand for a large one; otherwise as
    /// [`Self::relight`]. Of no lamp it is dark.
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn relight_all(
        &self,
        lamps: &[Emitter],
        network: Option<&dyn Network>,
    ) -> Result<Relit, NetworkError> {
        let mut lit = self.relight_each(&[lamps], network, &mut |_| ())?;
        Ok(lit.pop().expect("one of one light"))
    }

    /// The photograph under one light after another, each as [`Self::relight_all`] has it and together sooner: where a network
    /// corrects them, the next lamp is swept meanwhile. `begins` hears the number of each light.
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn relight_each(
        &self,
        lights: &[impl AsRef<[Emitter]>],
        network: Option<&dyn Network>,
        begins: &mut dyn FnMut(usize),
    ) -> Result<Vec<Relit>, NetworkError> {
        let prepared = &self.development.prepared;
        let lamps: Vec<Emitter> = lights.iter().flat_map(AsRef::as_ref).copied().collect();
        let mut relit: Box<dyn Iterator<Item = Result<Relit, NetworkError>>> =
            match (&self.correction, network) {
                (Some(correction), Some(network)) => {
                    Box::new(correction.relit(prepared, &lamps, network))
                }
                _ => {
                    let swept = |lamp| prepared.relight(lamp, RelightOptions::default());
                    Box::new(lamps.iter().map(move |lamp| Ok(swept(*lamp))))
                }
            };
        let mut all = Vec::with_capacity(lights.len());
        for (index, light) in lights.iter().enumerate() {
            begins(index);
            let sum = summed(relit.by_ref().take(light.as_ref().len()))?;
            let mut one = (self.development).finish(sum.unwrap_or_else(|| prepared.dark()));
            if let Some((photograph, share)) = &self.leaning {
                hedged(&mut one, photograph, *share);
            }
            all.push(one);
        }
        Ok(all)
    }
}
