//! A shot modelled with chosen terms, ready for lamps.

use super::{
    glance::Glance,
    plan::Plan,
    terms::{Shadow, Terms},
};
use crate::{
    develop::{DevelopError, Development, Options, Stage, develop_light},
    radiometry::FlashOnly,
    relight::{
        Lamp, RelightOptions, Relit,
        networks::{Doubt, Feed, Network, NetworkError, Variant},
    },
    shot::Shot,
};

/// A shot modelled with chosen terms.
#[derive(Debug, Clone)]
pub struct Model {
    /// The shot, understood.
    pub development: Development,
    /// The terms.
    pub terms: Terms,
    /// What leaving a network out may change, root mean square, linear light of white = 1.
    pub tolerance: f32,
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
            development,
            terms: plan.terms,
            tolerance: glance.noise,
            correction,
        })
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
        Ok(self.development.finish(relit))
    }
}
