//! Light from all around, as few lights for the scene that was developed.

use super::Clock;
use crate::{
    develop::Development,
    relight::{Environment, Found, LightSet, RelightOptions, Relit, visibility::VisibilityMap},
};

/// What stands for an environment in one scene.
pub(super) struct Surroundings {
    map: VisibilityMap,
    pub set: LightSet,
    /// What the set was chosen by.
    pub found: Found,
}

impl Surroundings {
    /// Needs the variance of the flash's light.
    pub fn new(environment: &Environment, development: &Development, clock: &mut Clock) -> Self {
        clock.begin("visibility map");
        let map = development
            .prepared
            .visibility_map(&LightSet::whole(environment));
        clock.begin("choice of lights");
        let (set, found) = development.light_set(environment, &map);
        Self { map, set, found }
    }

    /// The scene under it, in closed form, at the photograph's size.
    pub fn relight(&self, development: &Development) -> Relit {
        let options = RelightOptions::default();
        let answer = development
            .prepared
            .environment(&self.map, &self.set, options);
        development.finish(answer)
    }
}
