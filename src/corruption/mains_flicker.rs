//! Lamps on alternating current.

use super::{CorruptionError, photographs::Photographs};
use crate::shot::Shot;
use drivers::chance::Chance;
use std::f64::consts::TAU;

/// Pulses while one picture is read out: 30 ms at 100 Hz.
const PULSES: f64 = 3.0;

/// Pulses between two photographs, beyond whole ones: never so few that they cancel.
const APART: [f64; 2] = [0.25, 0.75];

/// The room's light goes up and down by `percent` from row to row, in every photograph in another
/// phase; the flash's does not.
pub(super) fn on_shot(shot: &Shot, percent: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::in_lit_room(shot)?;
    let (_, height) = light.flash.size();
    let (first, apart) = (
        chance.unit(0),
        APART[0] + (APART[1] - APART[0]) * chance.unit(1),
    );
    let swing = |photograph: u64, y: usize| {
        let turns = first + photograph as f64 * apart + PULSES * y as f64 / height as f64;
        0.01 * percent * (TAU * turns).sin() as f32
    };
    for y in 0..height {
        let room = light.ambient[0].row(y).iter();
        for (sum, room) in light.flash.row_mut(y).iter_mut().zip(room) {
            // What is unknown of the room leaves the flash photograph as it is.
            let room = room.map(|value| if value.is_finite() { value } else { 0.0 });
            *sum = std::array::from_fn(|channel| sum[channel] + swing(0, y) * room[channel]);
        }
    }
    for (photograph, ambient) in (1..).zip(&mut light.ambient) {
        for y in 0..height {
            let gain = 1.0 + swing(photograph, y);
            for value in ambient.row_mut(y).as_flattened_mut() {
                *value *= gain;
            }
        }
    }
    Ok(light.into_shot(shot))
}
