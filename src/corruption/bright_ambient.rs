//! A bright room.

use super::{
    CorruptionError,
    photographs::{Photographs, mean},
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};

/// Light of the room added to all photographs, in the mean `times` that of the flash alone, with
/// the noise of a sensor whose exposure holds the sum. The room keeps its look; a dark room, or one
/// not photographed, gets that of the flash photograph.
pub(super) fn on_shot(shot: &Shot, times: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::of(shot)?;
    let (room, flash_alone) = if light.room_is_lit()? {
        let room = light.ambient[0].clone();
        let pairs = light.flash.samples().iter().zip(room.samples());
        let difference: Vec<[f32; 3]> = pairs
            .map(|(sum, room)| std::array::from_fn(|channel| sum[channel] - room[channel]))
            .collect();
        let difference = Plane::new(difference.len(), 1, difference).unwrap_or_default();
        (room, mean(&difference))
    } else {
        (light.flash.clone(), mean(&light.flash))
    };
    let flash_alone = flash_alone.filter(|light| *light > 0.0);
    let (Some(flash_alone), Some(bright)) = (flash_alone, mean(&room)) else {
        return Err(CorruptionError::NoLight {
            photograph: "flash",
        });
    };
    let factor = times * flash_alone / bright;
    light.brighten(&room.map(|rgb| rgb.map(|value| factor * value)));
    light.add_noise(1.0, chance)?;
    Ok(light.into_shot(shot))
}
