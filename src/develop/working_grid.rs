//! Photographs, their rig and their depth on a grid of fewer pixels.

use crate::{
    radiometry::{FlashOnly, LinearImage},
    relight::enlarge::Mix,
    shot::Shot,
};
use drivers::{DepthFrame, Plane, Rig};
use rayon::prelude::*;

/// The whole factor by which both sides shrink.
pub(super) fn reduction(pixels: usize, working_pixels: usize) -> usize {
    let mut factor = 1;
    while pixels / (factor * factor) > working_pixels.max(1) {
        factor += 1;
    }
    factor
}

/// Means over squares of `factor` pixels; unknown pixels do not take part.
pub fn reduced(light: &FlashOnly, factor: usize) -> FlashOnly {
    let area = (factor * factor) as f32;
    FlashOnly {
        light: LinearImage(mean(&light.light.0, factor)),
        // The mean of n independent samples varies n times less.
        variance: mean(&light.variance, factor).map(|variance| variance / area),
        report: light.report.clone(),
    }
}

fn mean<T: Mix>(plane: &Plane<T>, factor: usize) -> Plane<T> {
    let (width, height) = (
        (plane.width() / factor).max(1),
        (plane.height() / factor).max(1),
    );
    let mut samples = vec![T::UNKNOWN; width * height];
    let lines = samples.par_chunks_mut(width).enumerate();
    lines.for_each(|(j, out)| {
        let rows = j * factor..((j + 1) * factor).min(plane.height());
        for (i, out) in out.iter_mut().enumerate() {
            let columns = i * factor..((i + 1) * factor).min(plane.width());
            let (mut sum, mut known) = (T::NOTHING, 0);
            for y in rows.clone() {
                for sample in &plane.row(y)[columns.clone()] {
                    if sample.is_known() {
                        sum = sum.plus(1.0, *sample);
                        known += 1;
                    }
                }
            }
            // More than half unknown: a mean of the rest would be of something else.
            if 2 * known >= factor * factor {
                *out = sum.over(known as f32);
            }
        }
    });
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// The rig on a reduced grid; depth that lay on the color grid is thinned out with it.
pub(super) fn working_rig(
    shot: &Shot,
    (width, height): (usize, usize),
) -> (Rig, Option<DepthFrame>) {
    let mut rig = shot.rig;
    rig.color = rig.color.scaled_to(width, height);
    if rig.depth.is_some() {
        return (rig, None);
    }
    let thin = |plane: &Plane<f32>| {
        Plane::from_fn(width, height, |x, y| {
            let at = |index: usize, small: usize, large: usize| {
                ((2 * index + 1) * large / (2 * small)).min(large - 1)
            };
            plane[(at(x, width, plane.width()), at(y, height, plane.height()))]
        })
    };
    let depth = DepthFrame {
        metres: thin(&shot.depth.metres),
        amplitude: shot.depth.amplitude.as_ref().map(thin),
        sigma: shot.depth.sigma.as_ref().map(thin),
        ..shot.depth
    };
    (rig, Some(depth))
}
