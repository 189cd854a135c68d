//! The points that stand for an order's lamps in the scene that was developed.

use super::Clock;
use crate::{
    develop::Development,
    relight::{Emitter, Found, Luminaire},
};

/// What stands for lamps in one scene.
pub(super) struct Standing {
    /// Per lamp.
    pub emitters: Vec<Vec<Emitter>>,
    /// What those of large lamps were chosen by; `None` for points.
    pub found: Vec<Option<Found>>,
}

impl Standing {
    /// Needs the variance of the flash's light.
    pub fn new(lamps: &[Luminaire], development: &Development, clock: &mut Clock) -> Self {
        if lamps.iter().any(|lamp| matches!(lamp, Luminaire::Area(_))) {
            clock.begin("large lights");
        }
        let all = lamps.iter().map(|lamp| development.emitters(lamp));
        let (emitters, found) = all.unzip();
        Self { emitters, found }
    }
}
