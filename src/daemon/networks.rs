//! Networks that are loaded once, and shared by all shots.

use crate::{
    api::Tier,
    darkroom::{self, Answering, Asked, DarkroomError, LoadNetworks},
    inference::Settings,
    relight::networks::{
        Channels, Network, NetworkError, NetworkRecord, Variant, compact::Compact,
    },
};
use std::{
    collections::{HashMap, hash_map::Entry},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// A network in memory. Its lock is never waited for: one shot is developed at a time.
#[derive(Clone)]
struct Shared(Arc<Mutex<Box<dyn Network>>>);

impl Shared {
    fn network(&self) -> MutexGuard<'_, Box<dyn Network>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Network for Shared {
    fn answer(
        &self,
        given: &[(&str, &Channels)],
        wanted: &[&str],
    ) -> Result<Vec<Channels>, NetworkError> {
        self.network().answer(given, wanted)
    }

    fn record(&self) -> NetworkRecord {
        self.network().record()
    }
}

/// What answers for shots, made ready at the first that asks for it.
#[derive(Default)]
pub(super) struct Networks {
    settings: Settings,
    ready: HashMap<(Tier, Variant), (Answering, Vec<String>)>,
}

impl Networks {
    /// What answers, and what is to be said about it.
    ///
    /// # Errors
    /// As [`darkroom::ready`].
    pub fn ready(
        &mut self,
        asked: Asked,
        settings: &Settings,
    ) -> Result<(&Answering, Vec<String>), DarkroomError> {
        if self.settings != *settings {
            self.settings = settings.clone();
            self.ready.clear();
        }
        let (answering, said) = match self.ready.entry((asked.tier, asked.variant)) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => {
                let (answering, said) = darkroom::ready(asked, settings)?;
                free.insert((kept(answering), said))
            }
        };
        if let Answering::Auto(auto) = answering {
            auto.budget = asked.budget;
        }
        Ok((answering, said.clone()))
    }
}

/// The same, but a network that was loaded stays.
fn kept(answering: Answering) -> Answering {
    let Answering::Auto(mut auto) = answering else {
        return answering;
    };
    auto.networks = auto.networks.map(|load| -> LoadNetworks {
        let loaded: Mutex<Option<[Shared; 2]>> = Mutex::new(None);
        Box::new(move || {
            let mut loaded = loaded.lock().unwrap_or_else(PoisonError::into_inner);
            let [surfaces, light] = match &*loaded {
                Some(shared) => shared.clone(),
                None => {
                    let Compact { surfaces, light } = load()?;
                    [surfaces, light].map(|network| Shared(Arc::new(Mutex::new(network))))
                }
            };
            *loaded = Some([surfaces.clone(), light.clone()]);
            Ok(Compact {
                surfaces: Box::new(surfaces),
                light: Box::new(light),
            })
        })
    });
    Answering::Auto(auto)
}
