//! What the depth camera's own samples say for a plane, for smooth surfaces, and for every detail.

use super::rule::Scores;
use crate::{scene::Flat, shot::Shot};
use drivers::Plane;
use glam::{DVec2, DVec3};

/// Samples asked, about.
const SAMPLES: usize = 8_192;
/// Tiles of a side: samples of one tile err together, tiles do not.
const TILES: usize = 8;
/// Depth is never better than this share of it.
const LEAST_SIGMA: f64 = 5e-4;
/// Every so many of them the plane is fitted to: its three numbers need no more.
const PLANE_STRIDE: usize = 4;

/// A sample, and what its neighbours one and two samples away make of it.
struct Held {
    tile: usize,
    ray: DVec3,
    inverse: f64,
    near: f64,
    far: f64,
}

/// Held-out samples of 1/z, predicted by one plane, by samples two steps away (half the grid) and by
/// their neighbours; the loss is that of Cauchy, so that a step of depth counts and does not rule.
pub(super) fn depth_scores(shot: &Shot) -> Scores {
    let metres = &shot.depth.metres;
    let held = held(shot, metres);
    if held.len() < 3 {
        return Scores::new::<3>(&[], [0.0; 3], [0; 3], 0);
    }
    let mut misfits: Vec<f64> = held
        .iter()
        .map(|one| (one.near - one.inverse).abs())
        .collect();
    let middle = misfits.len() / 2;
    let usual = *misfits.select_nth_unstable_by(middle, f64::total_cmp).1;
    let sigma = |one: &Held| usual.max(LEAST_SIGMA * one.inverse);
    let fitted = held.iter().step_by(PLANE_STRIDE);
    let fitted: Vec<(DVec3, f64)> = fitted.map(|one| (one.ray, one.inverse)).collect();
    let plane = Flat::through(&fitted);
    let loss = |one: &Held, predicted: f64| {
        let misfit = (predicted - one.inverse) / sigma(one);
        (1.0 + misfit * misfit).ln() as f32
    };
    let mut tiles = vec![([0.0f32; 3], 0.0f32); TILES * TILES];
    let mut deviance = [0.0; 3];
    for one in &held {
        let losses = [
            loss(
                one,
                plane.map_or(f64::INFINITY, |plane| plane.along(one.ray)),
            ),
            loss(one, one.far),
            loss(one, one.near),
        ];
        let (sums, count) = &mut tiles[one.tile];
        for model in 0..3 {
            sums[model] += losses[model];
            deviance[model] += 2.0 * f64::from(losses[model]);
        }
        *count += 1.0;
    }
    let groups: Vec<[f32; 3]> = tiles
        .iter()
        .filter(|(_, count)| *count > 0.0)
        .map(|(sums, count)| sums.map(|sum| sum / count))
        .collect();
    let parameters = [3, held.len() / 4, held.len()];
    Scores::new(&groups, deviance, parameters, held.len())
}

/// Samples that are known with all their neighbours, spread over the picture.
fn held(shot: &Shot, metres: &Plane<f32>) -> Vec<Held> {
    let (width, height) = metres.size();
    if width < 5 || height < 5 {
        return Vec::new();
    }
    let lens = shot.rig.depth.map_or(shot.rig.color, |depth| depth.lens);
    let step = ((width * height) as f64 / SAMPLES as f64)
        .sqrt()
        .floor()
        .max(1.0) as usize;
    let inverse = |x: usize, y: usize| {
        let z = f64::from(metres[(x, y)]);
        if z > 0.0 { 1.0 / z } else { f64::NAN }
    };
    let around = |x: usize, y: usize, apart: usize| {
        0.25 * (inverse(x - apart, y)
            + inverse(x + apart, y)
            + inverse(x, y - apart)
            + inverse(x, y + apart))
    };
    let mut held = Vec::new();
    for y in (2..height - 2).step_by(step) {
        for x in (2..width - 2).step_by(step) {
            let Some(ray) = lens.ray(DVec2::new(x as f64, y as f64)) else {
                continue;
            };
            let one = Held {
                tile: y * TILES / height * TILES + x * TILES / width,
                ray,
                inverse: inverse(x, y),
                near: around(x, y, 1),
                far: around(x, y, 2),
            };
            if (one.inverse + one.near + one.far).is_finite() {
                held.push(one);
            }
        }
    }
    held
}
