//! Whether the photograph is shaded as its own depth says, and as infrared is.

use super::{
    Finding,
    look::{Look, by_rows},
};
use drivers::Plane;
use glam::DVec2;
use rayon::prelude::*;

/// Only every so many rows and columns are looked at.
const EVERY: usize = 2;
/// Distance of the pixels compared, pixels at 256×256.
const APART_PIXELS: f32 = 4.0;
/// Steepest view, as a cosine.
const GRAZING: f32 = 0.2;
/// Depths of one surface differ by less, in natural logarithms.
const ONE_SURFACE: f32 = 0.06;
/// Light of one surface differs by less, in natural logarithms.
const ONE_COLOR: f32 = 0.5;
/// So does its red over its blue.
const ONE_TINT: f32 = 0.02;
/// Share of infrared's change that may differ from the shading that depth predicts.
const EXPLAINED: f32 = 0.4;
/// Shading that tells, in natural logarithms.
const TELLING: f32 = 0.03;
/// Departure of the light's logarithm from infrared's, as a factor, that does harm.
const HARMFUL_GAMMA: f32 = 0.12;
/// The same where only depth tells.
const CLEAR_GAMMA: f32 = 0.45;

/// Logarithms of ratios are counted from −SPAN to SPAN.
const SPAN: f32 = 1.0;
/// Places they are counted at.
const BINS: usize = 80;
/// Share of the pairs from which their most frequent ratio is sure.
const FIRM: f32 = 0.12;
/// Fewer pairs tell nothing.
const FEWEST: u32 = 60;

/// How the light changes within surfaces.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shading {
    /// Change of the light's logarithm over that of the shading that depth predicts.
    geometry: Ratios,
    /// The same over infrared amplitude.
    infrared: Ratios,
    flash_lit: bool,
}

/// How often each ratio occurs, by its logarithm; 0 = light changes as it should.
#[derive(Debug, Clone, Copy)]
struct Ratios {
    counts: [u32; BINS],
    /// Pairs, also those with a ratio beyond the ends or under 0.
    pairs: u32,
}

impl Default for Ratios {
    fn default() -> Self {
        Self {
            counts: [0; BINS],
            pairs: 0,
        }
    }
}

impl Ratios {
    fn add(&mut self, told: f32, light: f32) {
        self.pairs += 1;
        let place = ((light / told).ln() / SPAN + 1.0) * 0.5 * BINS as f32;
        // Nor NaN, of light that changes the other way.
        if place >= 0.0 && place < BINS as f32 {
            self.counts[place as usize] += 1;
        }
    }

    fn merged(self, other: Self) -> Self {
        Self {
            counts: std::array::from_fn(|i| self.counts[i] + other.counts[i]),
            pairs: self.pairs + other.pairs,
        }
    }

    fn count(&self) -> u32 {
        self.counts.iter().sum()
    }

    /// The most frequent ratio, as a logarithm, and the share of the pairs that have it: surfaces of one
    /// color all do, borders of colors have any, noise has all.
    fn mode(&self) -> (f32, f32) {
        let around = |i: usize| &self.counts[i.saturating_sub(2)..(i + 3).min(BINS)];
        let weight = |i: usize| around(i).iter().sum::<u32>();
        let best = (0..BINS).max_by_key(|&i| weight(i)).unwrap_or(BINS / 2);
        let first = best.saturating_sub(2);
        let sum: f32 = around(best)
            .iter()
            .enumerate()
            .map(|(i, count)| (first + i) as f32 * *count as f32)
            .sum();
        let place = sum / weight(best).max(1) as f32 + 0.5;
        let share = weight(best) as f32 / self.pairs.max(1) as f32;
        ((2.0 * place / BINS as f32 - 1.0) * SPAN, share)
    }
}

/// Logarithms at one pixel; NaN = unknown.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    light: f32,
    tint: f32,
    metres: f32,
    falloff: f32,
    amplitude: f32,
}

impl Shading {
    pub fn of(look: &Look<'_>) -> Self {
        let (width, height) = look.size();
        let size = (width.div_ceil(EVERY), height.div_ceil(EVERY));
        let points = by_rows(size, |x, y| point(look, EVERY * x, EVERY * y));
        let apart = APART_PIXELS * look.side() / (256 * EVERY) as f32;
        let apart = (apart.round() as usize).max(1);
        let (geometry, infrared) = (0..size.1)
            .into_par_iter()
            .with_min_len(16)
            .map(|y| row(&points, y, apart))
            .reduce(Default::default, |a, b| (a.0.merged(b.0), a.1.merged(b.1)));
        Self {
            geometry,
            infrared,
            flash_lit: look.development.scene.flash_lit,
        }
    }

    pub fn wrong_transfer(&self) -> Finding {
        let told = [
            (&self.infrared, HARMFUL_GAMMA),
            // Surfaces that are not matte shade otherwise, too.
            (&self.geometry, CLEAR_GAMMA),
        ];
        let told = told.iter().find(|(ratios, _)| ratios.count() >= FEWEST);
        let Some((ratios, harmful)) = told.filter(|_| self.flash_lit) else {
            return Finding::new("wrong-transfer", 0.0, None, String::new);
        };
        let (off, share) = ratios.mode();
        let firm = (share / FIRM).min(1.0).powi(2);
        Finding::new("wrong-transfer", firm * off.abs() / harmful, None, || {
            format!(
                "light changes {:.2} times as much as it should: pixel values follow another curve than stated; measure it with `capturectl calibrate response`",
                off.exp()
            )
        })
    }
}

fn point(look: &Look<'_>, x: usize, y: usize) -> Point {
    let scene = &look.development.scene;
    let at = (x * look.stride, y * look.stride);
    let z = scene.depth_metres[at];
    let falloff = if z > 0.0 {
        scene
            .camera
            .ray(DVec2::new(at.0 as f64, at.1 as f64))
            .map_or(f32::NAN, |ray| {
                let ray = ray.as_vec3();
                let length = ray.length();
                let cosine = -scene.normal[at].dot(ray) / length;
                if cosine > GRAZING {
                    (cosine / (z * length).powi(2)).ln()
                } else {
                    f32::NAN
                }
            })
    } else {
        f32::NAN
    };
    Point {
        light: look.light[(x, y)],
        tint: look.tint(at),
        metres: look.metres[(x, y)],
        falloff,
        amplitude: look
            .amplitude
            .as_ref()
            .map_or(f32::NAN, |plane| plane.at(x, y).ln()),
    }
}

fn row(points: &Plane<Point>, y: usize, apart: usize) -> (Ratios, Ratios) {
    let (mut geometry, mut infrared) = <(Ratios, Ratios)>::default();
    for (x, here) in points.row(y).iter().enumerate() {
        for there in [points.get(x + apart, y), points.get(x, y + apart)] {
            let Some(there) = there else {
                continue;
            };
            let light = there.light - here.light;
            let step = (there.metres / here.metres - 1.0).abs();
            // False for NaN.
            let tint = (there.tint - here.tint).abs();
            if !(light.abs() < ONE_COLOR && tint < ONE_TINT && step < ONE_SURFACE) {
                continue;
            }
            let tells = |told: f32| told.abs() > TELLING && told.abs() < ONE_COLOR;
            let shaded = there.falloff - here.falloff;
            if tells(shaded) {
                geometry.add(shaded, light);
            }
            let told = there.amplitude - here.amplitude;
            // What depth does not explain is a pattern, whose infrared is its own.
            if tells(told) && (told - shaded).abs() < EXPLAINED * told.abs() {
                infrared.add(told, light);
            }
        }
    }
    (geometry, infrared)
}
