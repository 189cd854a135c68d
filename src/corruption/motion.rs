//! Something that moves between the photographs.

use super::{
    CorruptionError,
    depth_grid::scale,
    photographs::{Photographs, sampled},
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};
use std::f64::consts::TAU;

/// The ambient frames moved by `pixels` inside an ellipse at a random place, half as wide and high
/// as the picture; of a bracket, each frame to another side.
pub(super) fn on_shot(shot: &Shot, pixels: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::in_lit_room(shot)?;
    let (width, height) = light.flash.size();
    let (wide, high) = (width as f32, height as f32);
    let place = |counter, side: f32| side * (0.3 + 0.4 * chance.unit(counter) as f32);
    let (middle_x, middle_y) = (place(0, wide), place(1, high));
    for (photograph, light) in (2..).zip(&mut light.ambient) {
        let (down, right) = (TAU * chance.unit(photograph)).sin_cos();
        let shift = pixels * scale((width, height));
        let (right, down) = (shift * right as f32, shift * down as f32);
        *light = Plane::from_fn(width, height, |x, y| {
            let across = (x as f32 - middle_x) / (0.25 * wide);
            let along = (y as f32 - middle_y) / (0.25 * high);
            if across * across + along * along < 1.0 {
                sampled(light, x as f32 - right, y as f32 - down)
            } else {
                light[(x, y)]
            }
        });
    }
    Ok(light.into_shot(shot))
}
