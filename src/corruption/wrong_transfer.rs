//! Pixel values that follow another curve than stated.

use super::{CorruptionError, photographs::Photographs};
use crate::shot::Shot;
use drivers::chance::Chance;

/// Light, as a share of the flash photograph's white, to the power 1 / `gamma` in all photographs.
pub(super) fn on_shot(shot: &Shot, gamma: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::of(shot)?;
    let white = light.white()?;
    for light in std::iter::once(&mut light.flash).chain(&mut light.ambient) {
        for value in light.samples_mut().as_flattened_mut() {
            *value = white * crate::radiometry::transfer::gamma_encode(*value / white, gamma);
        }
    }
    Ok(light.into_shot(shot))
}
