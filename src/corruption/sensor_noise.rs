//! A sensor at high gain.

use super::{CorruptionError, photographs::Photographs};
use crate::shot::Shot;
use drivers::chance::Chance;

/// Shot and read noise at `gain` in all photographs.
pub(super) fn on_shot(shot: &Shot, gain: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::of(shot)?;
    light.add_noise(gain, chance)?;
    Ok(light.into_shot(shot))
}
