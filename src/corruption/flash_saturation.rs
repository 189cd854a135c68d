//! A flash too strong or too near.

use super::{
    CorruptionError,
    field::upper,
    photographs::{Photographs, brightest},
};
use crate::shot::Shot;
use drivers::chance::Chance;

/// The brightest `percent` of the known pixels of the flash photograph become unknown.
pub(super) fn on_shot(shot: &Shot, percent: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::of(shot)?;
    let white = upper(brightest(&light.flash), percent).filter(|white| *white > 0.0);
    let white = white.ok_or(CorruptionError::NoLight {
        photograph: "flash",
    })?;
    for rgb in light.flash.samples_mut() {
        if rgb.iter().any(|value| *value >= white) {
            *rgb = [f32::NAN; 3];
        }
    }
    Ok(light.into_shot(shot))
}
