//! The parts of a picture that a mean hides: shadow edges, highlights, occlusion edges, glossy, dark.

use super::light_error::{Decibel, SquaredError};
use super::photometric::brightness;
use drivers::Plane;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A kind of place in a picture, as the truth tells it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// Within [`band_pixels`] of a border between lit and shadow in the true shadow map.
    CastShadowBand,
    /// The brightest 2 % of the true picture.
    Highlight,
    /// Within [`band_pixels`] of the mask's edge or of a step in depth of more than 2 %.
    OcclusionEdge,
    /// True roughness under 0.4.
    Glossy,
    /// True albedo under 0.1 (for unknown scale: of the truth's white).
    Dark,
}

impl Region {
    /// Every region, in the order of the tables.
    pub const ALL: [Self; 5] = [
        Self::CastShadowBand,
        Self::Highlight,
        Self::OcclusionEdge,
        Self::Glossy,
        Self::Dark,
    ];

    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::CastShadowBand => "cast-shadow band",
            Self::Highlight => "highlight",
            Self::OcclusionEdge => "occlusion edge",
            Self::Glossy => "glossy",
            Self::Dark => "dark",
        }
    }

    /// What it is, for charts.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::CastShadowBand => "along the borders of true cast shadows",
            Self::Highlight => "the brightest 2 % of the true picture",
            Self::OcclusionEdge => "along steps in depth and the mask's edge",
            Self::Glossy => "true roughness under 0.4",
            Self::Dark => "true albedo under 0.1",
        }
    }
}

const HIGHLIGHT_FRACTION: f64 = 0.02;
const DEPTH_STEP: f32 = 0.02;
const GLOSSY_ROUGHNESS: f32 = 0.4;
const DARK_ALBEDO: f32 = 0.1;

/// Half width of the bands: 1 % of the picture's longer side, at least 2 pixels.
pub fn band_pixels(size: (usize, usize)) -> usize {
    (size.0.max(size.1) / 100).max(2)
}

/// The error within one region, pooled over all lights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RegionError {
    /// Where.
    pub region: Region,
    /// Mean squared error in linear light.
    pub linear_mse: f64,
    /// PSNR in linear light.
    pub linear_psnr_db: Decibel,
    /// Mean squared error in sRGB.
    pub srgb_mse: f64,
    /// PSNR in sRGB.
    pub srgb_psnr_db: Decibel,
    /// Pixels compared, over all lights.
    pub pixels: usize,
}

/// What is known of the scene whatever the light.
pub(super) struct Surfaces<'a> {
    pub(super) depth_metres: Option<&'a Plane<f32>>,
    pub(super) roughness: Option<&'a Plane<f32>>,
    /// Mean of the channels, white = 1.
    pub(super) albedo: Option<&'a Plane<f32>>,
}

/// Region masks that hold for every light, and the sums of one method within all regions.
pub(super) struct Regions {
    lasting: Vec<(Region, Plane<bool>)>,
    counts: Plane<bool>,
}

impl Regions {
    /// Finds the regions that the light does not change; a plane of another size than `counts`
    /// has no say.
    pub(super) fn new(surfaces: &Surfaces<'_>, counts: &Plane<bool>) -> Self {
        let fits = |plane: &&Plane<f32>| plane.size() == counts.size();
        let mut lasting = vec![(
            Region::OcclusionEdge,
            occlusion_edges(surfaces.depth_metres.filter(fits), counts),
        )];
        if let Some(roughness) = surfaces.roughness.filter(fits) {
            lasting.push((
                Region::Glossy,
                roughness.map(|rough| *rough < GLOSSY_ROUGHNESS),
            ));
        }
        if let Some(albedo) = surfaces.albedo.filter(fits) {
            lasting.push((Region::Dark, albedo.map(|albedo| *albedo < DARK_ALBEDO)));
        }
        Self {
            lasting,
            counts: counts.clone(),
        }
    }

    /// Masks under one light, from its true picture and, where there is one, true shadow map.
    fn under_light(
        &self,
        truth: &Plane<[f32; 3]>,
        shadow: Option<&Plane<f32>>,
    ) -> Vec<(Region, Plane<bool>)> {
        let mut masks = vec![(
            Region::Highlight,
            brightest(&brightness(truth), &self.counts),
        )];
        if let Some(shadow) = shadow.filter(|shadow| shadow.size() == self.counts.size()) {
            let reach = band_pixels(shadow.size());
            let dark = near(&shadow.map(|lit| *lit < 0.5), reach);
            let lit = near(&shadow.map(|lit| *lit >= 0.5), reach);
            let band = Plane::from_fn(shadow.width(), shadow.height(), |x, y| {
                dark[(x, y)] && lit[(x, y)] && shadow[(x, y)].is_finite()
            });
            masks.push((Region::CastShadowBand, band));
        }
        masks
    }

    /// Adds one light's errors to `sums`; planes must lie on the grid of the mask.
    pub(super) fn tally(
        &self,
        sums: &mut RegionSums,
        found: &Plane<[f32; 3]>,
        truth: &Plane<[f32; 3]>,
        shadow: Option<&Plane<f32>>,
    ) {
        let known = |light: &[f32; 3]| light.iter().all(|value| value.is_finite());
        let masks = self.under_light(truth, shadow);
        for (region, mask) in self.lasting.iter().chain(&masks) {
            let sum = sums.0.entry(*region).or_default();
            for (index, on) in mask.samples().iter().enumerate() {
                let (found, truth) = (&found.samples()[index], &truth.samples()[index]);
                if *on && self.counts.samples()[index] && known(found) && known(truth) {
                    sum.add(found, truth);
                }
            }
        }
    }
}

/// Errors per region, summed over lights.
#[derive(Default)]
pub(super) struct RegionSums(BTreeMap<Region, SquaredError>);

impl RegionSums {
    /// The errors of the regions that have pixels.
    pub(super) fn errors(&self) -> Vec<RegionError> {
        self.0
            .iter()
            .filter_map(|(region, sum)| {
                let (linear_mse, srgb_mse) = sum.means()?;
                Some(RegionError {
                    region: *region,
                    linear_mse,
                    linear_psnr_db: Decibel::from_mse(linear_mse),
                    srgb_mse,
                    srgb_psnr_db: Decibel::from_mse(srgb_mse),
                    pixels: sum.pixels,
                })
            })
            .collect()
    }
}

/// Pixels at least as bright as all but the brightest 2 % of those that count.
fn brightest(brightness: &Plane<f32>, counts: &Plane<bool>) -> Plane<bool> {
    let mut values: Vec<f64> = brightness
        .samples()
        .iter()
        .zip(counts.samples())
        .filter(|(value, counts)| **counts && value.is_finite())
        .map(|(value, _)| f64::from(*value))
        .collect();
    let limit = super::cost::percentile(&mut values, 1.0 - HIGHLIGHT_FRACTION);
    brightness.map(|value| limit.is_some_and(|limit| f64::from(*value) >= limit))
}

/// Pixels near a step in depth or near the edge of what counts.
fn occlusion_edges(depth_metres: Option<&Plane<f32>>, counts: &Plane<bool>) -> Plane<bool> {
    let (width, height) = counts.size();
    let steps = |here: (usize, usize), there: (usize, usize)| {
        counts[here] != counts[there]
            || depth_metres.is_some_and(|depth| {
                (depth[here] - depth[there]).abs() > DEPTH_STEP * depth[here].min(depth[there])
            })
    };
    let edges = Plane::from_fn(width, height, |x, y| {
        (x + 1 < width && steps((x, y), (x + 1, y)))
            || (y + 1 < height && steps((x, y), (x, y + 1)))
    });
    near(&edges, band_pixels(counts.size()))
}

/// True where a true pixel lies within `reach` pixels along both axes.
pub(super) fn near(mask: &Plane<bool>, reach: usize) -> Plane<bool> {
    let (width, height) = mask.size();
    let along_x = Plane::from_fn(width, height, |x, y| {
        mask.row(y)[x.saturating_sub(reach)..(x + reach + 1).min(width)].contains(&true)
    });
    Plane::from_fn(width, height, |x, y| {
        (y.saturating_sub(reach)..(y + reach + 1).min(height)).any(|y| along_x[(x, y)])
    })
}
