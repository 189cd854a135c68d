//! How much of what a surface could see is the scene itself.
//!
//! Light that bounces comes from the directions in which other surfaces stand. The share of the
//! cosine-weighted hemisphere that the scene's own slabs block (obscurance; Zhukov, Iones &
//! Kronin 1998) times the mean light the scene sends out is therefore the indirect light: none
//! on a lone convex body, much in a corner.

use super::{
    Origin,
    enlarge::enlarge,
    visibility::{Answers, Occluders, Thickness, map, sweep},
};
use crate::scene::Scene;
use drivers::Plane;
use rayon::prelude::*;

/// The share varies slowly: a grid of about this many pixels shows it.
const PIXELS: usize = 8_192;
/// Every fourth azimuth and every second ring of the visibility map's directions.
const AZIMUTH_STEP: usize = 4;
const RING_STEP: usize = 2;

/// Share of the hemisphere blocked by the scene, in [0, 1], on the scene's grid.
///
/// A pixel without a surface has the share 0.
pub(super) fn obscurance(scene: &Scene, occluders: &Occluders) -> Vec<f32> {
    let (width, height) = scene.normal.size();
    let mut factor = 1;
    while width.div_ceil(factor) * height.div_ceil(factor) > PIXELS {
        factor += 1;
    }
    let small = occluders.reduced(factor);
    let (small_width, small_height) = small.size();
    let directions: Vec<_> = (0..map::RINGS)
        .step_by(RING_STEP)
        .flat_map(|ring| {
            // Neighbouring rings start at different azimuths, so that no azimuth is left out.
            let first = ring / RING_STEP % AZIMUTH_STEP;
            (first..map::AZIMUTHS)
                .step_by(AZIMUTH_STEP)
                .map(move |azimuth| map::direction(ring * map::AZIMUTHS + azimuth))
        })
        .collect();
    let middle = (factor - 1) / 2;
    let normal = |x: usize, y: usize| {
        let at = |index: usize, limit: usize| (index * factor + middle).min(limit - 1);
        scene.normal[(at(x, width), at(y, height))]
    };
    let sums = directions
        .par_iter()
        .map(|&toward| {
            let swept = sweep(&small, Origin::Distant(toward), Thickness::Guessed);
            let answers = Answers::new(&swept, small_width);
            let mut visibility = vec![0.0f32; small_width];
            let mut sums = vec![[0.0f32; 2]; small_width * small_height];
            for y in 0..small_height {
                answers.row(y, &mut visibility);
                for (x, &lit) in visibility.iter().enumerate() {
                    // NaN normals have no cosine: max keeps 0.
                    let cosine = normal(x, y).dot(toward).max(0.0);
                    sums[y * small_width + x] = [cosine * (1.0 - lit), cosine];
                }
            }
            sums
        })
        .reduce(
            || vec![[0.0; 2]; small_width * small_height],
            |mut sums, more| {
                for (sum, more) in sums.iter_mut().zip(more) {
                    *sum = [sum[0] + more[0], sum[1] + more[1]];
                }
                sums
            },
        );
    let shares = sums
        .iter()
        .map(|[blocked, all]| if *all > 0.0 { blocked / all } else { 0.0 });
    let shares = Plane::new(small_width, small_height, shares.collect()).expect("one per pixel");
    enlarge(&shares, width, height).into_samples()
}
