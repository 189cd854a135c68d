//! A shot developed once, for one light after another: what a film is made of.

use super::{Answering, Clock, DarkroomError, Order, modelled};
use crate::{
    output::Tone,
    parsimony::Model,
    relight::{
        AreaLamp, Emitter, Environment, LightSet, Luminaire, RelightOptions, Relit,
        networks::{Network, compact::Compact},
        summed,
        visibility::VisibilityMap,
    },
};

/// A shot, ready for any light; what is modelled is chosen once, so that nothing changes from frame to
/// frame but the light.
pub struct Reel<'a> {
    model: Model,
    answering: &'a Answering,
    /// Those brought into memory for it.
    networks: Option<Compact>,
    /// Small lamps along a side of large ones.
    side: usize,
    /// Which directions every pixel sees, once there is an environment.
    map: Option<VisibilityMap>,
}

/// One moment's light.
#[derive(Debug, Clone, Default)]
pub struct Moment {
    /// Lamps that shine together.
    pub lamps: Vec<Luminaire>,
    /// Light from all around.
    pub environment: Option<Environment>,
}

impl<'a> Reel<'a> {
    /// Develops the shot of an order, whose lamps are those of some moments.
    ///
    /// `observe` hears of every stage.
    ///
    /// # Errors
    /// As [`super::print`].
    pub fn new(order: &Order<'a>, observe: &mut dyn FnMut(&str)) -> Result<Self, DarkroomError> {
        super::refuse_near_for_paper(order)?;
        let found = modelled::modelled(order, &mut Clock::default(), observe)?;
        let mut reel = Self {
            model: found.model,
            answering: order.answering,
            networks: found.networks,
            side: 1,
            map: None,
        };
        for lamp in order.lamps {
            if let Luminaire::Area(_) = lamp {
                observe("choosing small lights for large ones");
                let stand_for_it = reel.model.development.emitters(lamp).0.len();
                reel.side = reel.side.max(stand_for_it.isqrt());
            }
        }
        Ok(reel)
    }

    /// Small lamps that stand for each large one.
    pub fn lamps_of_large(&self) -> usize {
        self.side * self.side
    }

    /// What is modelled, in words.
    pub fn terms(&self) -> String {
        self.model.terms.to_string()
    }

    /// The scene under the light of one moment, at the photograph's size.
    ///
    /// # Errors
    /// [`DarkroomError::Network`] when a network fails.
    pub fn lit(&mut self, moment: &Moment) -> Result<Relit, DarkroomError> {
        let middle = self.model.development.prepared.middle();
        let emitters = |lamp: &Luminaire| match lamp {
            Luminaire::Distant(lamp) => vec![Emitter::from(lamp)],
            Luminaire::Near(lamp) => vec![*lamp],
            Luminaire::Area(lamp) => AreaLamp::emitters(lamp, self.side, middle),
        };
        let lamps: Vec<Emitter> = moment.lamps.iter().flat_map(emitters).collect();
        let around = moment.environment.as_ref().map(|environment| {
            let development = &self.model.development;
            let prepared = &development.prepared;
            let map = self
                .map
                .get_or_insert_with(|| prepared.visibility_map(&LightSet::everywhere()));
            let (set, _) = development.light_set(environment, map);
            development.finish(prepared.environment(map, &set, RelightOptions::default()))
        });
        match around {
            Some(around) if lamps.is_empty() => Ok(around),
            around => {
                let lit = self.model.relight_all(&lamps, self.network())?;
                let all = [Some(lit), around].into_iter().flatten();
                let sum = summed(all.map(Ok::<_, DarkroomError>))?;
                Ok(sum.unwrap_or_else(|| self.model.development.prepared.dark()))
            }
        }
    }

    /// Which light becomes white, in all frames: 1 where the scale of the scene is known, else what 99 % of
    /// the pixels of these moments stay below.
    ///
    /// # Errors
    /// As [`Self::lit`].
    pub fn tone(&mut self, moments: &[Moment]) -> Result<Tone, DarkroomError> {
        if self.model.development.scene.scale_known {
            return Ok(Tone::absolute());
        }
        let lit: Vec<Relit> = moments
            .iter()
            .map(|moment| self.lit(moment))
            .collect::<Result<_, _>>()?;
        Ok(Tone::robust(lit.iter().map(|relit| &relit.light.0)))
    }

    fn network(&self) -> Option<&dyn Network> {
        let compact = match self.answering {
            Answering::Compact(compact) => Some(compact),
            Answering::Closed | Answering::Paper(_) | Answering::Auto(_) => self.networks.as_ref(),
        };
        compact.map(|compact| compact.light.as_ref())
    }
}
