//! What answers for a shot, made ready before the shot is taken.

use super::DarkroomError;
use crate::{
    api::Tier,
    costs,
    inference::{self, InferenceError, Settings},
    parsimony::CostModel,
    relight::networks::{Paper, Variant, compact::Compact},
};
use std::{path::PathBuf, time::Duration};

/// What answers.
pub enum Answering {
    /// Closed forms, every one of them.
    Closed,
    /// Closed forms, corrected by compact networks.
    Compact(Compact),
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
            Self::Closed | Self::Compact(_) | Self::Paper(_) => true,
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
    /// Brings the compact networks into memory; `None` without their model files.
    pub networks: Option<LoadNetworks>,
}

/// Brings the compact networks into memory, or says why it cannot.
pub type LoadNetworks = Box<dyn Fn() -> Result<Compact, InferenceError> + Send>;

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
        Tier::Compact => {
            let answering = Answering::Compact(inference::load_compact(settings)?);
            Ok((answering, said_of_runtime(settings)?))
        }
        Tier::Paper => {
            let answering = Answering::Paper(inference::load_paper(asked.variant, settings)?);
            Ok((answering, said_of_runtime(settings)?))
        }
        Tier::Auto => {
            let settings = settings.clone();
            let missing = inference::check_compact(&settings).err();
            let networks = missing
                .is_none()
                .then(|| -> LoadNetworks { Box::new(move || inference::load_compact(&settings)) });
            let costs_file = costs::usual_file();
            let costs::Known { costs, warning } =
                costs::known(costs_file.as_deref(), networks.as_deref())?;
            let missing = missing.map(|error| format!("closed forms are not corrected: {error}"));
            let auto = Auto {
                costs,
                costs_file,
                budget: asked.budget,
                networks,
            };
            let warnings = warning.into_iter().chain(missing).collect();
            Ok((Answering::Auto(Box::new(auto)), warnings))
        }
    }
}

/// What is to be said about what runs the networks.
fn said_of_runtime(settings: &Settings) -> Result<Vec<String>, InferenceError> {
    let warning = &inference::Runtime::start(settings)?.warning;
    Ok(warning.iter().cloned().collect())
}
