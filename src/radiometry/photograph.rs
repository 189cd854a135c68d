//! The flash photograph as people see it: no pixel missing.

use super::{FlashOnly, LinearImage, RadiometryError, linearise};
use drivers::ColorFrame;

/// The flash's light where it is known; where something moved the frame with the room's light in it; what
/// clipped, as bright as the brightest pixel that did not. Scene-linear, unit exposure.
///
/// # Errors
/// [`RadiometryError`] as [`linearise`], of a `frame` that `flash_only` was not made of.
pub fn photograph(
    flash_only: &FlashOnly,
    frame: &ColorFrame,
) -> Result<LinearImage, RadiometryError> {
    let mut light = flash_only.light.0.clone();
    if light.samples().iter().all(|pixel| !pixel[0].is_nan()) {
        return Ok(LinearImage(light));
    }
    let lit = linearise(frame)?;
    for (pixel, lit) in light.samples_mut().iter_mut().zip(lit.0.samples()) {
        if pixel[0].is_nan() {
            *pixel = *lit;
        }
    }
    let known = || light.samples().iter().filter(|pixel| !pixel[0].is_nan());
    let brightest: [f32; 3] =
        std::array::from_fn(|c| known().map(|pixel| pixel[c]).fold(0.0, f32::max));
    for pixel in light.samples_mut() {
        if pixel[0].is_nan() {
            *pixel = brightest;
        }
    }
    Ok(LinearImage(light))
}
