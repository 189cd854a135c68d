//! Roughness from how the flash's reflection falls off with its angle.

use super::{albedo::Reflection, karis::karis_at_lens, regions::Regions};
use drivers::Plane;
use rayon::prelude::*;

/// Roughness values that are weighed against each other: 0.10, 0.15, … 1.00, all equally likely
/// before anything is seen.
pub(super) const CANDIDATES: usize = 19;

/// The `i`-th candidate.
pub(super) fn candidate(i: usize) -> f32 {
    0.1 + 0.05 * i as f32
}

/// Rings of angle between normal and flash, narrow where narrow lobes fall off.
const RINGS: usize = 24;

/// Beyond this chord (2 sin(angle/2)) errors of the normals drown the lobe.
const WIDEST: f32 = 1.1;

/// Pixels that carry one independent sample of a surface's texture.
const TEXTURE_PIXELS: f32 = 9.0;

/// Fewest pixels of a ring that is heard: narrow lobes show in a few.
const FEWEST: f32 = 3.0;

/// Variance of the logarithm of a texture of which too little is seen to tell.
const UNSEEN_TEXTURE: f32 = 0.01;

/// Shading that no lobe explains, as a share of brightness, on a surface seen head on…
const UNEXPLAINED: f32 = 0.02;

/// …and how it grows with the square of the chord: light from other surfaces stays where that of the
/// flash falls off.
const UNEXPLAINED_ASLANT: f32 = 0.1;

/// Normals are never better than this (chord, so about radians).
const LEAST_TILT: f32 = 0.01;

/// Largest pieces of surface that lend what they show to others of their color.
const LENDERS: usize = 128;

/// Two pieces are of one material when their colors differ by less (logarithms, per channel).
const SAME_COLOR: f32 = 0.15;

/// Sums over the pixels of one ring of one piece. Brightness is summed as logarithms: texture and
/// light from elsewhere scale it, and a glint that covers few pixels must not decide for all.
#[derive(Debug, Clone, Copy, Default)]
struct Ring {
    count: f32,
    chord: f32,
    log: f32,
    square: f32,
}

/// What one piece of surface shows.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    rings: [Ring; RINGS],
    log_color: [f32; 3],
    tilt: f32,
    pixels: f32,
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            rings: [Ring::default(); RINGS],
            log_color: [0.0; 3],
            tilt: 0.0,
            pixels: 0.0,
        }
    }
}

/// One ring's answer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    chord: f32,
    log: f32,
    variance: f32,
}

/// Darkest albedo told apart from none.
const BLACK: f32 = 1e-3;

/// What one pixel says of its piece.
#[derive(Debug, Clone, Copy)]
struct Glimpse {
    ring: usize,
    chord: f32,
    log: f32,
    log_color: [f32; 3],
    tilt: f32,
}

impl Glimpse {
    /// `tilt` is the standard deviation of the pixel's normal, radians; `None` of a pixel that says nothing.
    fn of(Reflection { value, cosine, .. }: Reflection, tilt: f32) -> Option<Self> {
        // NaN fails every comparison.
        if !(cosine > 0.2 && value[0] + value[1] + value[2] > 0.0) {
            return None;
        }
        let plain = value.map(|v| (v / cosine).max(BLACK));
        let chord = (2.0 * (1.0 - cosine)).max(0.0).sqrt();
        Some(Self {
            ring: ((chord / WIDEST).powf(0.6) * RINGS as f32) as usize,
            chord,
            log: ((plain[0] + plain[1] + plain[2]) / 3.0).ln(),
            log_color: plain.map(f32::ln),
            tilt: tilt.clamp(0.0, 1.0),
        })
    }
}

impl Evidence {
    fn add(&mut self, glimpse: &Glimpse) {
        for (sum, log) in self.log_color.iter_mut().zip(glimpse.log_color) {
            *sum += log;
        }
        self.pixels += 1.0;
        self.tilt += glimpse.tilt;
        if let Some(ring) = self.rings.get_mut(glimpse.ring) {
            ring.count += 1.0;
            ring.chord += glimpse.chord;
            ring.log += glimpse.log;
            ring.square += glimpse.log * glimpse.log;
        }
    }

    pub(super) fn profile(&self) -> Vec<Point> {
        let point = |ring: &Ring| {
            let log = ring.log / ring.count;
            let spread = (ring.square / ring.count - log * log).max(0.0) + UNSEEN_TEXTURE;
            let chord = ring.chord / ring.count;
            let unexplained = UNEXPLAINED + UNEXPLAINED_ASLANT * chord * chord;
            Point {
                chord,
                log,
                variance: spread * TEXTURE_PIXELS / ring.count + unexplained * unexplained,
            }
        };
        self.rings
            .iter()
            .filter(|ring| ring.count >= FEWEST)
            .map(point)
            .collect()
    }

    /// The rings that `keeps` says yes to.
    pub(super) fn some_rings(&self, keeps: impl Fn(usize) -> bool) -> Self {
        let mut kept = self.clone();
        // Rings without pixels do not count, so that every second one is every second one seen.
        let seen = kept.rings.iter_mut().filter(|ring| ring.count >= FEWEST);
        for (number, ring) in seen.enumerate() {
            if !keeps(number) {
                *ring = Ring::default();
            }
        }
        kept
    }

    /// Standard deviation of the piece's normals, radians.
    fn tilt(&self) -> f32 {
        LEAST_TILT.hypot(self.tilt / self.pixels.max(1.0))
    }

    /// How badly each candidate explains the profile.
    pub(super) fn misfits(&self) -> [f32; CANDIDATES] {
        let (profile, tilt) = (self.profile(), self.tilt());
        std::array::from_fn(|i| Lobe::new(&profile, Some(candidate(i)), tilt).deviance())
    }

    /// The same of one roughness; `None` = no highlight at all.
    pub(super) fn misfit(&self, roughness: Option<f32>) -> f32 {
        Lobe::new(&self.profile(), roughness, self.tilt()).deviance()
    }

    /// Logarithm of the albedo that fits best beside a roughness.
    pub(super) fn albedo(&self, roughness: Option<f32>) -> f32 {
        Lobe::new(&self.profile(), roughness, self.tilt()).log_albedo()
    }

    /// Squared misfit in variances, summed over the profile, beside this logarithm of the albedo.
    pub(super) fn misfit_of(&self, roughness: Option<f32>, log_albedo: f32) -> f32 {
        Lobe::new(&self.profile(), roughness, self.tilt()).squares(log_albedo)
    }

    /// Logarithm of how well each candidate explains the profile, on top of one albedo.
    pub(super) fn log_likelihood(&self) -> [f32; CANDIDATES] {
        if self.pixels < FEWEST {
            return [0.0; CANDIDATES];
        }
        let misfit = self.misfits();
        let best = misfit.iter().copied().fold(f32::INFINITY, f32::min);
        // A profile that no candidate fits is weak evidence for any of them.
        let rings = self.profile().len() as f32;
        let excess = (best / (rings - 2.0).max(1.0)).max(1.0);
        misfit.map(|m| -0.5 * (m - best) / excess)
    }

    /// Logarithm of the color, averaged as such; `None` without light.
    fn log_color(&self) -> Option<[f32; 3]> {
        (self.pixels > 0.0).then(|| self.log_color.map(|sum| sum / self.pixels))
    }
}

/// One roughness beside one profile.
struct Lobe<'a> {
    profile: &'a [Point],
    /// The highlight at every point, and at the ends of its error.
    heights: Vec<[f32; 3]>,
}

impl<'a> Lobe<'a> {
    /// `tilt` is the error of the normals, which blurs narrow lobes.
    fn new(profile: &'a [Point], roughness: Option<f32>, tilt: f32) -> Self {
        let highlight = |chord: f32| {
            roughness.map_or(0.0, |roughness| {
                karis_at_lens(1.0 - 0.5 * chord * chord, roughness)
            })
        };
        let heights = profile.iter().map(|point| {
            [
                highlight(point.chord),
                highlight((point.chord - tilt).max(0.0)),
                highlight(point.chord + tilt),
            ]
        });
        Self {
            profile,
            heights: heights.collect(),
        }
    }

    fn variance(point: &Point, lobe: &[f32; 3], albedo: f32) -> f32 {
        let blurred = 0.5 * ((albedo + lobe[1]) / (albedo + lobe[2])).ln();
        point.variance + blurred * blurred
    }

    /// Logarithm of the albedo with the least weighted squared error of ln(albedo + highlight).
    fn log_albedo(&self) -> f32 {
        // Gauss–Newton on ln(albedo), which keeps it positive; it starts at the darkest ring.
        let darkest = self.profile.iter().map(|point| point.log);
        let mut log_albedo = darkest.fold(0.0, f32::min).max(BLACK.ln());
        for _ in 0..5 {
            let albedo = log_albedo.exp();
            let (mut step, mut weights) = (0.0, 1e-9);
            for (point, lobe) in self.profile.iter().zip(&self.heights) {
                let share = albedo / (albedo + lobe[0]);
                let weight = share / Self::variance(point, lobe, albedo);
                step += weight * (point.log - (albedo + lobe[0]).ln());
                weights += weight * share;
            }
            log_albedo = (log_albedo + (step / weights).clamp(-1.0, 1.0)).clamp(BLACK.ln(), 0.0);
        }
        log_albedo
    }

    /// Squared error in variances beside an albedo.
    fn squares(&self, log_albedo: f32) -> f32 {
        let albedo = log_albedo.exp();
        let points = self.profile.iter().zip(&self.heights);
        points
            .map(|(point, lobe)| {
                let error = point.log - (albedo + lobe[0]).ln();
                error * error / Self::variance(point, lobe, albedo)
            })
            .sum()
    }

    /// The squared error beside the best albedo, and what the freedom of the weights costs.
    fn deviance(&self) -> f32 {
        let log_albedo = self.log_albedo();
        let albedo = log_albedo.exp();
        let points = self.profile.iter().zip(&self.heights);
        let freedom =
            points.map(|(point, lobe)| (Self::variance(point, lobe, albedo) / point.variance).ln());
        self.squares(log_albedo) + freedom.sum::<f32>()
    }
}

/// Mean and standard deviation of the candidates under a log-likelihood.
pub(super) fn expected(log_likelihood: &[f32; CANDIDATES]) -> (f32, f32) {
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
/// the middle of its matte end. `one_for_all` gives the whole picture one roughness.
pub(super) fn roughness(
    reflections: &Plane<Reflection>,
    normal_sigma: &Plane<f32>,
    regions: &Regions,
    one_for_all: bool,
) -> Plane<f32> {
    let evidence = evidence(reflections, normal_sigma, regions);
    let (width, height) = reflections.size();
    if one_for_all {
        let all = sum(evidence.par_iter().map(Evidence::log_likelihood));
        let (answer, _) = expected(&all);
        return regions.of.map(|of| of.map_or(f32::NAN, |_| answer));
    }
    let tells = |i: &usize| evidence[*i].pixels >= FEWEST;
    let mut lenders: Vec<usize> = (0..evidence.len()).filter(tells).collect();
    lenders.sort_by(|&a, &b| evidence[b].pixels.total_cmp(&evidence[a].pixels));
    lenders.truncate(LENDERS);
    let lent: Vec<_> = lenders
        .iter()
        .filter_map(|&i| Some((i, evidence[i].log_color()?, evidence[i].log_likelihood())))
        .collect();
    let answers: Vec<f32> = evidence
        .par_iter()
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
    Plane::from_fn(width, height, |x, y| {
        regions.of[(x, y)].map_or(f32::NAN, |region| answers[region as usize])
    })
}

/// Pixels that are looked at together.
const GLIMPSES: usize = 65_536;

/// What every piece of surface shows.
pub(super) fn evidence(
    reflections: &Plane<Reflection>,
    normal_sigma: &Plane<f32>,
    regions: &Regions,
) -> Vec<Evidence> {
    let mut evidence = vec![Evidence::default(); regions.count];
    let reflections = reflections.samples().chunks(GLIMPSES);
    let pixels = reflections.zip(normal_sigma.samples().chunks(GLIMPSES));
    let mut glimpses = Vec::with_capacity(GLIMPSES);
    for ((reflections, tilts), regions) in pixels.zip(regions.of.samples().chunks(GLIMPSES)) {
        // Logarithms take longest; sums stay in the order of the pixels, and the same every time.
        let pixels = reflections.par_iter().zip(tilts).with_min_len(4096);
        let seen = pixels.map(|(reflection, tilt)| Glimpse::of(*reflection, *tilt));
        seen.collect_into_vec(&mut glimpses);
        for (glimpse, region) in glimpses.iter().zip(regions) {
            if let (Some(glimpse), Some(region)) = (glimpse, region) {
                evidence[*region as usize].add(glimpse);
            }
        }
    }
    evidence
}

fn sum(all: impl ParallelIterator<Item = [f32; CANDIDATES]>) -> [f32; CANDIDATES] {
    all.reduce(
        || [0.0; CANDIDATES],
        |a, b| std::array::from_fn(|i| a[i] + b[i]),
    )
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
            let seen = Reflection {
                value: [value; 3],
                variance: 1e-6,
                cosine,
            };
            if let Some(glimpse) = Glimpse::of(seen, 0.0) {
                evidence.add(&glimpse);
            }
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
        let found = roughness(
            &reflections,
            &reflections.map(|_| 0.0),
            &Regions { of, count: 2 },
            false,
        );
        assert!((found[(10, 10)] - 0.3).abs() < 0.05, "{}", found[(10, 10)]);
        assert!(
            (found[(300, 10)] - 0.3).abs() < 0.05,
            "{}",
            found[(300, 10)]
        );
    }
}
