//! No more of a scene's model than the shot needs: terms, what speaks for each, and what each costs.

pub mod cost;
mod depth;
mod fallback;
mod glance;
mod model;
mod plan;
mod rule;
mod terms;

use crate::{develop::DevelopError, relight::networks::NetworkError};
use thiserror::Error;

/// Why a shot could not be modelled.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum ModelError {
    #[error(transparent)]
    Develop(#[from] DevelopError),
    #[error(transparent)]
    Network(#[from] NetworkError),
}

pub use cost::{CostModel, Workload};
pub use glance::{Changes, Glance};
pub use model::Model;
pub use plan::{Criterion, Plan, TooLittleTime};
pub use rule::{Rule, Scores};
pub use terms::{Bounced, Geometry, Shadow, Terms};
