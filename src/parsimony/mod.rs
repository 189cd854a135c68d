//! No more of a scene's model than the shot needs: terms, what speaks for each, and what each costs.

pub mod cost;
mod depth;
mod fallback;
mod glance;
mod model;
mod plan;
mod rule;
mod terms;

pub use cost::{CostModel, Workload};
pub use glance::{Changes, Glance};
pub use model::Model;
pub use plan::{Criterion, Plan, TooLittleTime};
pub use rule::{Rule, Scores};
pub use terms::{Bounced, Geometry, Shadow, Terms};
