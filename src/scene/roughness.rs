//! Roughness from how the flash's reflection falls off with its angle.

use super::{albedo::Reflection, karis::karis_at_lens, regions::Regions};
use drivers::Plane;

/// Roughness values that are weighed against each other: 0.10, 0.15, … 1.00, all equally likely
/// before anything is seen.
const CANDIDATES: usize = 19;

/// The `i`-th candidate.
fn candidate(i: usize) -> f32 {
    0.1 + 0.05 * i as f32
}

/// Rings of angle between normal and flash, narrow where narrow lobes fall off.
const RINGS: usize = 24;

/// Beyond this chord (2 sin(angle/2)) errors of the normals drown the lobe.
const WIDEST: f32 = 1.1;

/// Pixels that carry one independent sample of a surface's texture.
const TEXTURE_PIXELS: f32 = 9.0;

/// Shading that no lobe explains (other light, bent normals), as a share of brightness.
const UNEXPLAINED: f32 = 0.02;

/// Largest pieces of surface that lend what they show to others of their color.
const LENDERS: usize = 128;

/// Two pieces are of one material when their colors differ by less (logarithms, per channel).
const SAME_COLOR: f32 = 0.15;

/// Sums over the pixels of one ring of one piece.
#[derive(Debug, Clone, Copy, Default)]
struct Ring {
    count: f32,
    chord: f32,
    brightness: f32,
    square: f32,
}

/// What one piece of surface shows.
#[derive(Debug, Clone)]
struct Evidence {
    rings: [Ring; RINGS],
    color: [f32; 3],
    pixels: f32,
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            rings: [Ring::default(); RINGS],
            color: [0.0; 3],
            pixels: 0.0,
        }
    }
}

impl Evidence {
    fn add(&mut self, Reflection { value, cosine, .. }: Reflection) {
        // NaN fails every comparison.
        if !(cosine > 0.2 && value[0] + value[1] + value[2] > 0.0) {
            return;
        }
        let plain = value.map(|v| v / cosine);
        let brightness = (plain[0] + plain[1] + plain[2]) / 3.0;
        let chord = (2.0 * (1.0 - cosine)).max(0.0).sqrt();
        let ring = ((chord / WIDEST).powf(0.6) * RINGS as f32) as usize;
        for (sum, value) in self.color.iter_mut().zip(plain) {
            *sum += value;
        }
        self.pixels += 1.0;
        if let Some(ring) = self.rings.get_mut(ring) {
            ring.count += 1.0;
            ring.chord += chord;
            ring.brightness += brightness;
            ring.square += brightness * brightness;
        }
    }

    /// Rings as (cosine, mean brightness, its variance).
    fn profile(&self) -> Vec<(f32, f32, f32)> {
        let point = |ring: &Ring| {
            let mean = ring.brightness / ring.count;
            let spread = (ring.square / ring.count - mean * mean).max(0.0);
            let chord = ring.chord / ring.count;
            let variance = spread * TEXTURE_PIXELS / ring.count + (UNEXPLAINED * mean).powi(2);
            (1.0 - 0.5 * chord * chord, mean, variance + 1e-8)
        };
        self.rings
            .iter()
            .filter(|ring| ring.count >= TEXTURE_PIXELS)
            .map(point)
            .collect()
    }

    /// Logarithm of how well each candidate explains the profile, on top of one albedo.
    fn log_likelihood(&self) -> [f32; CANDIDATES] {
        let profile = self.profile();
        let misfit: [f32; CANDIDATES] = std::array::from_fn(|i| misfit(&profile, candidate(i)));
        let best = misfit.iter().copied().fold(f32::INFINITY, f32::min);
        // A profile that no candidate fits is weak evidence for any of them.
        let excess = (best / (profile.len() as f32 - 2.0).max(1.0)).max(1.0);
        misfit.map(|m| -0.5 * (m - best) / excess)
    }

    /// Logarithm of the mean color; `None` without light.
    fn log_color(&self) -> Option<[f32; 3]> {
        (self.pixels > 0.0).then(|| self.color.map(|sum| (sum / self.pixels).max(1e-3).ln()))
    }
}

/// Weighted squared error of `albedo + highlight(roughness)` with the best albedo.
fn misfit(profile: &[(f32, f32, f32)], roughness: f32) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for &(cosine, value, variance) in profile {
        sum += (value - karis_at_lens(cosine, roughness)) / variance;
        weights += 1.0 / variance;
    }
    let albedo = if weights > 0.0 {
        (sum / weights).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let error = |&(cosine, value, variance): &(f32, f32, f32)| {
        (value - albedo - karis_at_lens(cosine, roughness)).powi(2) / variance
    };
    profile.iter().map(error).sum()
}

/// Mean and standard deviation of the candidates under a log-likelihood.
fn expected(log_likelihood: &[f32; CANDIDATES]) -> (f32, f32) {
    let best = log_likelihood
        .iter()
        .copied()
        .fold(f32::NEG_INFINITY, f32::max);
    let (mut weights, mut mean, mut square) = (0.0, 0.0, 0.0);
    for (i, log) in log_likelihood.iter().enumerate() {
        let weight = (log - best).exp();
        weights += weight;
        mean += weight * candidate(i);
        square += weight * candidate(i) * candidate(i);
    }
    let mean = mean / weights;
    (mean, (square / weights - mean * mean).max(0.0).sqrt())
}

/// Karis roughness of every pixel with known depth, one value per piece of surface; NaN elsewhere.
///
/// With the flash at the lens n·l = n·v = n·h, so brightness over angle shows the whole lobe as one
/// curve on top of the albedo. Every candidate roughness is weighed by how well it explains that
/// curve, pieces of one color sharing their evidence, and the mean of the candidates is the answer:
/// a surface never seen head on gets the middle of the range, one seen head on without a highlight
/// the middle of its matte end.
pub(super) fn roughness(reflections: &Plane<Reflection>, regions: &Regions) -> Plane<f32> {
    let mut evidence = vec![Evidence::default(); regions.count];
    for (reflection, region) in reflections.samples().iter().zip(regions.of.samples()) {
        if let Some(region) = region {
            evidence[*region as usize].add(*reflection);
        }
    }
    let mut lenders: Vec<usize> = (0..evidence.len()).collect();
    lenders.sort_by(|&a, &b| evidence[b].pixels.total_cmp(&evidence[a].pixels));
    lenders.truncate(LENDERS);
    let lent: Vec<_> = lenders
        .iter()
        .filter_map(|&i| Some((i, evidence[i].log_color()?, evidence[i].log_likelihood())))
        .collect();
    let answers: Vec<f32> = evidence
        .iter()
        .enumerate()
        .map(|(i, own)| {
            let mut log = own.log_likelihood();
            if let Some(color) = own.log_color() {
                for (_, _, other) in lent
                    .iter()
                    .filter(|(j, theirs, _)| *j != i && alike(&color, theirs))
                {
                    for (sum, other) in log.iter_mut().zip(other) {
                        *sum += other;
                    }
                }
            }
            expected(&log).0
        })
        .collect();
    let (width, height) = reflections.size();
    Plane::from_fn(width, height, |x, y| {
        regions.of[(x, y)].map_or(f32::NAN, |region| answers[region as usize])
    })
}

/// One color, as far as light and dark of a texture allow to tell.
fn alike(a: &[f32; 3], b: &[f32; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME_COLOR)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball lit and seen from afar: cos² is uniform over its disc.
    fn ball(albedo: f32, roughness: f32) -> Evidence {
        let mut evidence = Evidence::default();
        for i in 0..20_000 {
            let cosine = (1.0 - (i as f32 + 0.5) / 20_000.0).sqrt();
            let value = cosine * (albedo + karis_at_lens(cosine, roughness));
            evidence.add(Reflection {
                value: [value; 3],
                variance: 1e-6,
                cosine,
            });
        }
        evidence
    }

    #[test]
    fn roughness_of_a_shiny_ball_is_read_from_its_profile() {
        for roughness in [0.2, 0.3, 0.4, 0.5, 0.6] {
            let (mean, sigma) = expected(&ball(0.3, roughness).log_likelihood());
            assert!((mean - roughness).abs() < 0.04, "{roughness}: {mean}");
            assert!(sigma < 0.05, "{roughness}: ±{sigma}");
        }
    }

    #[test]
    fn a_matte_ball_is_rough_and_an_unseen_one_undecided() {
        let (matte, _) = expected(&ball(0.3, 1.0).log_likelihood());
        assert!(matte > 0.8, "{matte}");
        let (unseen, sigma) = expected(&Evidence::default().log_likelihood());
        assert!(
            (unseen - 0.55).abs() < 1e-3 && sigma > 0.25,
            "{unseen} ± {sigma}"
        );
    }

    #[test]
    fn a_piece_seen_only_from_the_side_borrows_from_its_color() {
        let shiny = |cosine: f32| {
            let value = cosine * (0.4 + karis_at_lens(cosine, 0.3));
            Reflection {
                value: [value; 3],
                variance: 1e-6,
                cosine,
            }
        };
        // Left half: a ball's profile; right half: the same material at 60°.
        let reflections = Plane::from_fn(400, 50, |x, y| {
            let share = ((y * 200 + x) as f32 + 0.5) / 10_000.0;
            shiny(if x < 200 { (1.0 - share).sqrt() } else { 0.5 })
        });
        let of = Plane::from_fn(400, 50, |x, _| Some(u32::from(x >= 200)));
        let found = roughness(&reflections, &Regions { of, count: 2 });
        assert!((found[(10, 10)] - 0.3).abs() < 0.05, "{}", found[(10, 10)]);
        assert!(
            (found[(300, 10)] - 0.3).abs() < 0.05,
            "{}",
            found[(300, 10)]
        );
    }
}
