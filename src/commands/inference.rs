//! Which tier answers, how long it may take, and what runs its networks.

use super::CommandError;
use crate::{
    api::Tier,
    config::Config,
    darkroom::{self, Answering, Asked},
    inference::Settings,
    relight::networks::Variant,
    session,
};
use clap::Args;
use std::{path::PathBuf, time::Duration};

/// What answers.
#[derive(Debug, Clone, Args)]
pub struct TierArguments {
    /// What answers: what the shot needs, every closed form, those corrected by two compact networks, or the
    /// three networks of Qiu et al. 2020.
    #[arg(long, value_name = "auto|closed|compact|paper", default_value = "auto")]
    tier: Tier,
    /// Longest time from the shot in memory to the relit pictures in memory, with --tier auto, such as
    /// 50ms or 0.3s; what buys least for its time is left out.
    #[arg(long, value_name = "TIME", value_parser = budget)]
    budget: Option<Duration>,
    /// What the networks were trained on, with --tier paper: exact depth, or depth with noise
    /// [default: clean].
    #[arg(long, value_name = "clean|noisy")]
    variant: Option<Variant>,
    #[command(flatten)]
    pub backend: BackendArguments,
}

/// Where networks come from and what runs them; each else as configured.
#[derive(Debug, Clone, Default, Args)]
pub struct BackendArguments {
    /// Folder of the model files.
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// ONNX Runtime's shared library.
    #[arg(long, value_name = "PATH")]
    runtime: Option<PathBuf>,
    /// Threads that one network may use.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    threads: Option<u8>,
}

impl BackendArguments {
    /// These, and the configuration for what they leave open.
    pub fn settings(&self, config: &Config) -> Settings {
        let configured = config.inference.clone();
        Settings {
            models: self.models.clone().or(configured.models),
            runtime: self.runtime.clone().or(configured.runtime),
            threads: self.threads.map(usize::from).or(configured.threads),
        }
    }

    /// True when nothing is asked for here.
    pub fn is_empty(&self) -> bool {
        self.models.is_none() && self.runtime.is_none() && self.threads.is_none()
    }
}

impl TierArguments {
    /// What is asked for.
    pub fn asked(&self) -> Result<Asked, CommandError> {
        if self.tier != Tier::Paper && self.variant.is_some() {
            return Err(CommandError::Arguments(
                "--variant is given without --tier paper; add it".to_owned(),
            ));
        }
        if self.tier != Tier::Auto && self.budget.is_some() {
            return Err(CommandError::Arguments(
                "--budget is given with another tier than auto; leave one of them out".to_owned(),
            ));
        }
        Ok(Asked {
            tier: self.tier,
            variant: self.variant.unwrap_or_default(),
            budget: self.budget,
        })
    }

    /// What answers, made ready, and what to say about it.
    pub fn ready(&self, config: &Config) -> Result<(Answering, Vec<String>), CommandError> {
        let ready = darkroom::ready(self.asked()?, &self.backend.settings(config));
        Ok(ready.map_err(session::SessionError::from)?)
    }
}

/// Reads `50ms` or `0.3s`.
fn budget(text: &str) -> Result<Duration, String> {
    let (number, milliseconds) = match (text.strip_suffix("ms"), text.strip_suffix('s')) {
        (Some(number), _) => (number, 1.0),
        (None, Some(number)) => (number, 1e3),
        (None, None) => return Err("give milliseconds or seconds, as in 50ms or 0.3s".to_owned()),
    };
    let value: f64 = number
        .trim()
        .parse()
        .map_err(|_| format!("\"{number}\" is no number; give 50ms or 0.3s"))?;
    let milliseconds = value * milliseconds;
    if !(milliseconds > 0.0 && milliseconds <= 3.6e6) {
        return Err("it must be above 0 and at most an hour".to_owned());
    }
    Ok(Duration::from_secs_f64(milliseconds / 1e3))
}
