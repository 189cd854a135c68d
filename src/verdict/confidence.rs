//! How far each pixel is to be trusted.

use super::{look::Look, steps::Steps};
use drivers::Plane;

/// Trust left beside a depth step of which the photograph shows nothing.
const UNSEEN_STEP: f32 = 0.3;

/// The scene's own confidence (signal, slant, depth noise, measured or filled), less where depth
/// steps and the photograph does not; NaN where neither light nor depth is known.
pub(super) fn confidence(look: &Look<'_>, steps: &Steps) -> Plane<f32> {
    let scene = &look.development.scene;
    let mut confidence = scene.confidence.clone();
    let (width, height) = confidence.size();
    for step in steps.found.iter().filter(|step| !step.seen) {
        let (left, top) = (step.x * look.stride, step.y * look.stride);
        let reach = 2 * look.stride;
        for y in top.saturating_sub(look.stride)..(top + reach).min(height) {
            let row = confidence.row_mut(y);
            for value in &mut row[left.saturating_sub(look.stride)..(left + reach).min(width)] {
                *value = value.min(UNSEEN_STEP);
            }
        }
    }
    let full = look.development.working_light.as_ref();
    let light = &full.unwrap_or(&look.development.flash_only.light).0;
    let known = light.samples().iter().zip(scene.depth_metres.samples());
    for (value, (rgb, z)) in confidence.samples_mut().iter_mut().zip(known) {
        if rgb[0].is_nan() && z.is_nan() {
            *value = f32::NAN;
        }
    }
    confidence
}
