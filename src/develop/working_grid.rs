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
    let samples = (0..width * height)
        .into_par_iter()
        .map_init(Vec::new, |known, index| {
            let (left, top) = (index % width * factor, index / width * factor);
            known.clear();
            for y in top..(top + factor).min(plane.height()) {
                let row = plane.row(y);
                let end = (left + factor).min(row.len());
                known.extend(
                    row[left..end]
                        .iter()
                        .filter(|s| s.is_known())
                        .map(|s| (1.0, *s)),
                );
            }
            let share = 1.0 / known.len() as f32;
            known.iter_mut().for_each(|(weight, _)| *weight = share);
            // More than half unknown: a mean of the rest would be of something else.
            if 2 * known.len() < factor * factor {
                T::unknown()
            } else {
                T::mix(known)
            }
        })
        .collect();
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
