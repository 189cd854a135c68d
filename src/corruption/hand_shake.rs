//! A camera held in a hand.

use super::{
    CorruptionError,
    depth_grid::scale,
    photographs::{Light, Photographs, sampled},
};
use crate::shot::Shot;
use drivers::{Plane, chance::Chance};
use std::f64::consts::TAU;

/// Each photograph smeared over `pixels` along its own line; the ambient ones also lie that far
/// beside the flash photograph, which stays in its place.
pub(super) fn on_shot(shot: &Shot, pixels: f32, chance: Chance) -> Result<Shot, CorruptionError> {
    let mut light = Photographs::of(shot)?;
    let length = pixels * scale(light.flash.size());
    let along = |counter| {
        let (down, right) = (TAU * chance.unit(counter)).sin_cos();
        [length * right as f32, length * down as f32]
    };
    light.flash = smeared(&light.flash, along(0), [0.0; 2]);
    for (photograph, light) in (1..).zip(&mut light.ambient) {
        *light = smeared(light, along(2 * photograph), along(2 * photograph + 1));
    }
    Ok(light.into_shot(shot))
}

/// The mean over a line, moved by `shift`.
fn smeared(light: &Light, line: [f32; 2], shift: [f32; 2]) -> Light {
    let (width, height) = light.size();
    // Two samples a pixel, so that none is stepped over.
    let steps = (2.0 * line[0].hypot(line[1])).ceil().max(1.0) as usize;
    Plane::from_fn(width, height, |x, y| {
        let mut sum = [0.0; 3];
        for step in 0..=steps {
            let part = step as f32 / steps as f32 - 0.5;
            let rgb = sampled(
                light,
                x as f32 - shift[0] + part * line[0],
                y as f32 - shift[1] + part * line[1],
            );
            sum = std::array::from_fn(|channel| sum[channel] + rgb[channel]);
        }
        sum.map(|value| value / (steps + 1) as f32)
    })
}
