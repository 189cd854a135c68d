//! A shot modelled with chosen terms, ready for lamps.

use super::{
    fallback::{Hedge, hedge, hedged, without},
    glance::Glance,
    plan::Plan,
    terms::{Shadow, Terms},
};
use crate::{
    develop::{DevelopError, Development, Options, Stage, develop_light},
    radiometry::{FlashOnly, LinearImage, photograph},
    relight::{
        Lamp, RelightOptions, Relit,
        networks::{Doubt, Feed, Network, NetworkError, Variant},
    },
    shot::Shot,
    verdict::{Verdict, contradicted, judge},
};
use std::borrow::Cow;

/// Rounds in which depth is left out: behind what goes, more may show.
const MOST_ROUNDS: usize = 3;

/// A shot modelled with chosen terms.
#[derive(Debug, Clone)]
pub struct Model {
    /// The shot, understood.
    pub development: Development,
    /// The terms.
    pub terms: Terms,
    /// What leaving a network out may change, root mean square, linear light of white = 1.
    pub tolerance: f32,
    /// What the shot says about itself; only of a careful model.
    pub verdict: Option<Verdict>,
    /// Whether depth that the photograph contradicts was left out.
    pub depth_left_out: bool,
    /// The photograph and how answers lean on it, where they do.
    leaning: Option<(LinearImage, Hedge)>,
    /// What a network needs to correct its shadows.
    correction: Option<(Doubt, Feed)>,
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
        let corrects = plan.terms.shadow == Shadow::Network;
        let correction = corrects.then(|| {
            let doubt = Doubt::of(&development.prepared);
            (doubt, development.feed(shot, Variant::Clean))
        });
        Ok(Self {
            verdict: None,
            depth_left_out: false,
            leaning: None,
            development,
            terms: plan.terms,
            tolerance: glance.tolerance,
            correction,
        })
    }

    /// The same, but what the shot's own evidence says would do harm is left out: depth that the
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
        let mut wrong = verdict.contradicted.take();
        let mut filled = Cow::Borrowed(shot);
        for _ in 0..MOST_ROUNDS {
            let Some(pixels) = wrong else { break };
            filled = Cow::Owned(without(&filled, &model.development, &pixels));
            let flash_only = model.development.flash_only;
            model = Self::new(&filled, flash_only, plan, glance, base, begins)?;
            model.depth_left_out = true;
            wrong = contradicted(&filled, &model.development);
        }
        if let Some(hedge) = hedge(&verdict) {
            let flash_only = &model.development.flash_only;
            model.leaning = Some((photograph(flash_only, &shot.flash)?, hedge));
        }
        model.verdict = Some(verdict);
        Ok(model)
    }

    /// Share of the photograph that answers are mixed with, [0, 0.8].
    pub fn hedge(&self) -> f32 {
        self.leaning.as_ref().map_or(0.0, |(_, hedge)| hedge.share)
    }

    /// The photograph under a lamp, at its own size. Without a `network` swept shadows stay as they are.
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn relight(
        &self,
        lamp: &Lamp,
        network: Option<&dyn Network>,
    ) -> Result<Relit, NetworkError> {
        let prepared = &self.development.prepared;
        let relit = match (&self.correction, network) {
            (Some((doubt, feed)), Some(network)) => {
                doubt.relight(prepared, lamp, network, feed, self.tolerance)?
            }
            _ => prepared.relight(lamp, RelightOptions::default()),
        };
        let mut relit = self.development.finish(relit);
        if let Some((photograph, hedge)) = &self.leaning {
            hedged(&mut relit, photograph, *hedge);
        }
        Ok(relit)
    }
}
