//! Sets of lights for environments compared: chosen for the scene, and of fixed counts.

use crate::{
    develop::Development,
    radiometry::transfer::srgb_encode,
    relight::{Environment, Found, Lamp, LightSet, RelightOptions, visibility::VisibilityMap},
};
use drivers::Plane;
use serde::Serialize;
use std::{hint::black_box, time::Instant};

/// The fixed counts, fewest first; the last is one light per cell.
pub const COUNTS: [usize; 4] = [4, 16, 64, 256];
/// Timings of which the least counts.
const ROUNDS: usize = 5;

/// One scene under one map, by every set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightSetRun {
    /// The capture.
    pub capture: String,
    /// The map.
    pub map: String,
    /// What the chosen set was chosen by.
    pub found: Found,
    /// The chosen set.
    pub chosen: SetFigures,
    /// One per count of [`COUNTS`].
    pub fixed: Vec<SetFigures>,
}

impl LightSetRun {
    /// Noise of the picture in steps of 255.
    pub fn noise_steps(&self) -> f64 {
        255.0 * f64::from(self.found.noise)
    }
}

/// How near a set comes, and what it takes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SetFigures {
    /// Lights of it.
    pub lights: usize,
    /// Choice of the set, its shadows and its picture together.
    pub milliseconds: f64,
    /// Difference from the picture under one light per cell, root mean square of sRGB, white (the
    /// 99th percentile) = 255.
    pub change_steps: f64,
    /// PSNR of the sRGB picture against that under one light per pixel of the map (reduced to 64×32),
    /// each with its own full shadow; decibel.
    pub dense_psnr_db: f64,
    /// The same against the true picture, where there is one.
    pub truth_psnr_db: Option<f64>,
}

/// Compares the sets of one scene under one map. `truth` is its true picture under that map. `None`
/// where the map sends no light.
pub fn compare(
    [capture, name]: [&str; 2],
    development: &Development,
    map: &Plane<[f32; 3]>,
    truth: Option<&Plane<[f32; 3]>>,
) -> Option<LightSetRun> {
    let environment = Environment::new(map).ok()?;
    let prepared = &development.prepared;
    let options = RelightOptions::default();
    let timed = |choose: &dyn Fn() -> (LightSet, VisibilityMap)| {
        let once = || {
            let begun = Instant::now();
            let (set, map) = choose();
            let picture = prepared.environment(&map, &set, options).light.0;
            (begun.elapsed().as_secs_f64() * 1e3, set, picture)
        };
        let all: Vec<_> = (0..ROUNDS).map(|_| black_box(once())).collect();
        all.into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .expect("several rounds")
    };
    let mapped = |set: LightSet| {
        let map = prepared.visibility_map(&set);
        (set, map)
    };
    let all = LightSet::whole(&environment);
    let chosen = || {
        let map = prepared.visibility_map(&all);
        let (set, found) = development.light_set(&environment, &map);
        (set, map, found)
    };
    let (_, _, whole) = timed(&|| mapped(all.clone()));
    let dense = dense(development, map);
    let figures = |choose: &dyn Fn() -> (LightSet, VisibilityMap)| {
        let (milliseconds, set, picture) = timed(choose);
        SetFigures {
            lights: set.count(),
            milliseconds,
            change_steps: 255.0 * difference(&whole, &picture),
            dense_psnr_db: -20.0 * difference(&dense, &picture).log10(),
            truth_psnr_db: truth.map(|truth| -20.0 * difference(truth, &picture).log10()),
        }
    };
    let fixed = COUNTS.map(|count| {
        figures(&|| match count {
            256 => mapped(all.clone()),
            _ => mapped(LightSet::of_count(&environment, count)),
        })
    });
    Some(LightSetRun {
        capture: capture.to_owned(),
        map: name.to_owned(),
        found: chosen().2,
        chosen: figures(&|| {
            let (set, map, _) = chosen();
            (set, map)
        }),
        fixed: fixed.to_vec(),
    })
}

/// The picture under every pixel of the map, reduced to 64×32, as a lamp with its own sweep.
fn dense(development: &Development, map: &Plane<[f32; 3]>) -> Plane<[f32; 3]> {
    let prepared = &development.prepared;
    let (width, height) = prepared.size();
    let mut sum = Plane::filled(width, height, [0.0f32; 3]);
    let options = RelightOptions::default();
    let factor = (map.height() / 32).max(1);
    for y in (0..map.height()).step_by(factor) {
        for x in (0..map.width()).step_by(factor) {
            let Some(lamp) = lamp(map, (x, y), factor) else {
                continue;
            };
            let one = prepared.relight(&lamp, options).light.0;
            for (sum, one) in sum
                .samples_mut()
                .as_flattened_mut()
                .iter_mut()
                .zip(one.samples().as_flattened())
            {
                *sum += one;
            }
        }
    }
    sum
}

/// The light of a square of the map from its middle; `None` where it is dark or too far behind.
fn lamp(map: &Plane<[f32; 3]>, (left, top): (usize, usize), factor: usize) -> Option<Lamp> {
    use std::f32::consts::{PI, TAU};
    let (width, height) = map.size();
    let mut color = [0.0f32; 3];
    for y in top..(top + factor).min(height) {
        let cosine = (PI * (0.5 - (y as f32 + 0.5) / height as f32)).cos();
        // The area of a pixel on the sphere over π.
        let share = cosine * (PI / height as f32).powi(2) / PI;
        for x in left..(left + factor).min(width) {
            for (color, value) in color.iter_mut().zip(map[(x, y)]) {
                *color += share * value;
            }
        }
    }
    let latitude = PI * (0.5 - (top as f32 + factor as f32 / 2.0) / height as f32);
    let longitude = TAU * ((left as f32 + factor as f32 / 2.0) / width as f32 - 0.5);
    let toward_person = [
        latitude.cos() * longitude.sin(),
        latitude.sin(),
        -latitude.cos() * longitude.cos(),
    ];
    let lamp = Lamp::from_person(toward_person)
        .ok()?
        .with_color(color)
        .ok()?;
    // As far behind as an environment reaches.
    (lamp.toward().z <= 0.342 && color.iter().sum::<f32>() > 0.0).then_some(lamp)
}

/// Root mean square difference of two sRGB pictures over the pixels known in both, white = 1 at the
/// 99th percentile of the first.
fn difference(reference: &Plane<[f32; 3]>, picture: &Plane<[f32; 3]>) -> f64 {
    let pixels = || {
        let pairs = reference.samples().iter().zip(picture.samples());
        pairs.filter(|(a, b)| a.iter().chain(*b).all(|value| value.is_finite()))
    };
    let mut brightest: Vec<f32> = pixels().map(|(a, _)| a[0].max(a[1]).max(a[2])).collect();
    if brightest.is_empty() {
        return 0.0;
    }
    let rank = (brightest.len() - 1) * 99 / 100;
    let white = brightest
        .select_nth_unstable_by(rank, f32::total_cmp)
        .1
        .max(f32::MIN_POSITIVE);
    let shown = |value: f32| f64::from(srgb_encode((value / white).clamp(0.0, 1.0)));
    let square = |(a, b): (&[f32; 3], &[f32; 3])| -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| (shown(*a) - shown(*b)).powi(2))
            .sum()
    };
    (pixels().map(square).sum::<f64>() / (3 * brightest.len()) as f64).sqrt()
}
