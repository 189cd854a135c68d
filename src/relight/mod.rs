//! Lamps, visibility and shading: the scene under a new light.
//!
//! [`Prepared`] holds what every light needs, computed once per scene; [`Prepared::relight`]
//! answers for one lamp with one sweep over the depth map.

mod emitter;
pub mod enlarge;
pub mod environment;
pub mod lamp;
pub mod light_set;
mod luminaire;
pub mod networks;
mod obscurance;
mod pinhole;
pub mod prepared;
pub mod shading;
mod source;
mod surfaces;
pub mod visibility;

pub use emitter::{Emitter, Origin};
pub use environment::{Environment, EnvironmentError};
pub use lamp::{Lamp, LampError};
pub use light_set::{Found, LightSet};
pub use luminaire::{AreaLamp, Luminaire, summed};
pub use prepared::{Blocked, Indirect, Preparation, Prepared, RelightOptions, Relit, Shadows};
