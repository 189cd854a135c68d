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
    /// Those of pairs that count by chance alone.
    by_chance: [u32; BINS],
    /// All pairs, also those with a ratio beyond the ends or under 0.
    pairs: u32,
}

impl Default for Ratios {
    fn default() -> Self {
        Self {
            counts: [0; BINS],
            by_chance: [0; BINS],
            pairs: 0,
        }
    }
}

impl Ratios {
    fn add(&mut self, told: f32, light: f32) {
        self.pairs += 1;
        if let Some(place) = place(told, light) {
            self.counts[place] += 1;
        }
    }

    fn add_by_chance(&mut self, told: f32, light: f32) {
        self.pairs += 1;
        if let Some(place) = place(told, light) {
            self.by_chance[place] += 1;
        }
    }

    fn merged(self, other: Self) -> Self {
        let sums = |a: [u32; BINS], b: [u32; BINS]| std::array::from_fn(|i| a[i] + b[i]);
        Self {
            counts: sums(self.counts, other.counts),
            by_chance: sums(self.by_chance, other.by_chance),
            pairs: self.pairs + other.pairs,
        }
    }

    /// What is left of the counts without what chance adds to them.
    fn sure(&self) -> [u32; BINS] {
        std::array::from_fn(|i| self.counts[i].saturating_sub(self.by_chance[i]))
    }

    fn count(&self) -> u32 {
        self.sure().iter().sum()
    }

    /// The most frequent ratio, as a logarithm, and the share of the pairs that have it: surfaces of one
    /// color all do, borders of colors have any, noise has all.
    ///
    /// The width of a bin grows with its ratio, so that its pairs are divided by that: noise that scatters evenly
    /// about the true ratio then has its peak there. By the logarithm its peak lies above, at 1.44 times
    /// the true ratio where noise is 0.8 of the change.
    fn mode(&self) -> (f32, f32) {
        let log = |place: f32| (2.0 * place / BINS as f32 - 1.0) * SPAN;
        let counts = self.sure();
        let density: [f32; BINS] =
            std::array::from_fn(|i| counts[i] as f32 * (-log(i as f32 + 0.5)).exp());
        let around = |i: usize| i.saturating_sub(2)..(i + 3).min(BINS);
        let weight = |i: usize| density[around(i)].iter().sum::<f32>();
        let best = (0..BINS).max_by(|a, b| weight(*a).total_cmp(&weight(*b)));
        let best = around(best.unwrap_or(BINS / 2));
        let of: f32 = density[best.clone()].iter().sum();
        let sum: f32 = best.clone().map(|i| (i as f32 + 0.5) * density[i]).sum();
        let place = if of > 0.0 {
            sum / of
        } else {
            0.5 * BINS as f32
        };
        let having: u32 = counts[best].iter().sum();
        (log(place), having as f32 / self.pairs.max(1) as f32)
    }
}

/// Where a ratio is counted; `None` beyond the ends, and of light that changes the other way.
fn place(told: f32, light: f32) -> Option<usize> {
    let place = ((light / told).ln() / SPAN + 1.0) * 0.5 * BINS as f32;
    (place >= 0.0 && place < BINS as f32).then_some(place as usize)
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
            // What depth does not explain is a pattern, whose infrared is its own. Depth that is noisy explains as much of it
            // by chance as it explains the wrong way round.
            let explains = |shaded: f32| (told - shaded).abs() < EXPLAINED * told.abs();
            if tells(told) && explains(shaded) {
                infrared.add(told, light);
            } else if tells(told) && explains(-shaded) {
                infrared.add_by_chance(told, light);
            }
        }
    }
    (geometry, infrared)
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::chance::Chance;

    /// What is found where infrared shows a pattern, light 0.6 times as much of it, and depth `explains` that share of it,
    /// all else of depth being noise.
    fn pattern(explains: f32) -> Finding {
        let chance = Chance::new(9);
        let mut points = Plane::filled(128, 128, Point::default());
        for (i, point) in points.samples_mut().iter_mut().enumerate() {
            let [pattern, noise] = [2 * i, 2 * i + 1].map(|i| 0.15 * chance.normal(i as u64));
            *point = Point {
                light: 0.6 * pattern,
                tint: 0.0,
                metres: 1.0,
                falloff: explains * pattern + (1.0 - explains) * noise,
                amplitude: pattern,
            };
        }
        let rows = (0..128).map(|y| row(&points, y, 2));
        let (geometry, infrared) = rows.fold(<(Ratios, Ratios)>::default(), |a, b| {
            (a.0.merged(b.0), a.1.merged(b.1))
        });
        Shading {
            geometry,
            infrared,
            flash_lit: true,
        }
        .wrong_transfer()
    }

    #[test]
    fn a_pattern_that_noise_explains_by_chance_is_no_wrong_curve() {
        assert!(!pattern(0.0).is_harmful());
        assert!(pattern(0.9).is_harmful());
    }

    #[test]
    fn noise_as_large_as_the_change_makes_no_other_curve_of_a_true_one() {
        for (truth, noise) in [(1.0, 0.0), (1.0, 0.3), (1.0, 0.8), (1.4, 0.0), (1.4, 0.3)] {
            let chance = Chance::new(7);
            let mut ratios = Ratios::default();
            for pair in 0..40_000 {
                let normal = chance.normal(pair);
                ratios.add(0.1, 0.1 * (truth + noise * normal));
            }
            let (off, share) = ratios.mode();
            let off = off - f32::ln(truth);
            assert!(
                off.abs() < 0.2,
                "{truth} under {noise}: {off}, {share} have it"
            );
        }
    }
}
