//! What answers for a shot, made ready before the shot is taken.

use super::DarkroomError;
use crate::{
    api::Tier,
    costs,
    inference::{self, InferenceError, Settings},
    parsimony::CostModel,
    relight::networks::{Network, Paper, Variant},
};
use std::{path::PathBuf, time::Duration};

/// What answers.
pub enum Answering {
    /// Closed forms, every one of them.
    Closed,
    /// The paper's networks.
    Paper(Paper),
    /// What the shot needs, and time allows.
    Auto(Box<Auto>),
}

impl Answering {
    /// False where every millisecond is counted: then nothing is done that answers no light.
    pub(super) fn has_time(&self) -> bool {
        match self {
            Self::Auto(auto) => auto.budget.is_none(),
            Self::Closed | Self::Paper(_) => true,
        }
    }
}

/// What choosing takes.
pub struct Auto {
    /// What every step costs here.
    pub costs: CostModel,
    /// Where they are kept; shots with a budget correct them.
    pub costs_file: Option<PathBuf>,
    /// From the shot in memory to the relit pictures in memory; `None` = as long as it takes.
    pub budget: Option<Duration>,
    /// Brings the shadow network into memory; `None` without its model file.
    pub network: Option<LoadNetwork>,
}

/// Brings a network into memory, or says why it cannot.
pub type LoadNetwork = Box<dyn Fn() -> Result<Box<dyn Network>, InferenceError> + Send>;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// The tier.
    pub tier: Tier,
    /// Which networks, where the tier is the paper's.
    pub variant: Variant,
    /// The longest time, where the tier is `auto`.
    pub budget: Option<Duration>,
}

/// Makes ready what answers, and says what is to be said about it.
///
/// # Errors
/// [`DarkroomError::Inference`] when the paper's networks cannot be had, [`DarkroomError::Costs`] when
/// costs cannot be measured.
pub fn ready(asked: Asked, settings: &Settings) -> Result<(Answering, Vec<String>), DarkroomError> {
    match asked.tier {
        Tier::Closed => Ok((Answering::Closed, Vec::new())),
        Tier::Paper => {
            let paper = inference::load_paper(asked.variant, settings)?;
            let warning = inference::Runtime::start(settings)?.warning.clone();
            Ok((Answering::Paper(paper), warning.into_iter().collect()))
        }
        Tier::Auto => {
            let settings = settings.clone();
            let variant = Variant::Clean.name();
            let missing = inference::check("shadow", variant, &settings).err();
            let network = missing.is_none().then(|| -> LoadNetwork {
                Box::new(move || inference::load("shadow", variant, &settings))
            });
            let costs_file = costs::usual_file();
            let costs::Known { costs, warning } =
                costs::known(costs_file.as_deref(), network.as_deref())?;
            let missing = missing.map(|error| format!("shadows are not corrected: {error}"));
            let auto = Auto {
                costs,
                costs_file,
                budget: asked.budget,
                network,
            };
            let warnings = warning.into_iter().chain(missing).collect();
            Ok((Answering::Auto(Box::new(auto)), warnings))
        }
    }
}
