//! No more of a scene's model than the shot needs: terms, what speaks for each, and what each costs.

mod depth;
mod glance;
mod rule;
mod terms;

pub use glance::{Changes, Glance};
pub use rule::{Rule, Scores};
pub use terms::{Bounced, Geometry, Shadow, Terms};
