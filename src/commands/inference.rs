//! Which tier answers, and what runs its networks: `--tier`, `--variant`, `--models`, `--runtime`,
//! `--threads`.

use super::CommandError;
use crate::{
    api::Tier,
    config::Config,
    inference::{self, Settings},
    relight::networks::{Paper, Variant},
};
use clap::Args;
use std::path::PathBuf;

/// What answers.
#[derive(Debug, Clone, Args)]
pub struct TierArguments {
    /// What answers: closed forms, or the three networks of Qiu et al. 2020.
    #[arg(long, value_name = "closed|paper", default_value = "closed")]
    tier: Tier,
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
    /// The tier and the variant of its networks.
    pub fn tier(&self) -> Result<(Tier, Variant), CommandError> {
        if self.tier == Tier::Closed && self.variant.is_some() {
            return Err(CommandError::Arguments(
                "--variant is given without --tier paper; add it".to_owned(),
            ));
        }
        Ok((self.tier, self.variant.unwrap_or_default()))
    }

    /// The networks, where the tier has any, and what to say about what runs them.
    pub fn load(&self, config: &Config) -> Result<Loaded, CommandError> {
        let settings = self.backend.settings(config);
        Ok(match self.tier()? {
            (Tier::Closed, _) => Loaded::default(),
            (Tier::Paper, variant) => Loaded {
                paper: Some(inference::load_paper(variant, &settings)?),
                warning: inference::Runtime::start(&settings)?.warning.clone(),
            },
        })
    }
}

/// What a tier needs.
#[derive(Default)]
pub struct Loaded {
    /// Its networks.
    pub paper: Option<Paper>,
    /// What to say about what runs them.
    pub warning: Option<String>,
}
