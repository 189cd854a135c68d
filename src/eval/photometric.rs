//! True cast shadows from photographs under many known lights, where no shadow map is given.
//!
//! A matte surface of normal n under a lamp of direction l is as bright as `reflectance · n·l`;
//! where a photograph is far darker than that although the surface faces the lamp, something else
//! stands in the lamp's way. The limits below were chosen on the photometric-stereo object that
//! has real cast shadows: with them a plain height-field ray march of its depth map (one layer,
//! unlimited thickness, half-pixel steps) reaches a pooled IoU of 0.888, as an independent
//! script found; between 0.85 and 0.89 for n·l limits of 0.15 to 0.25 and darkness limits of 0.25
//! to 0.4, so the figure does not hang on them.

use super::regions::near;
use drivers::Plane;
use glam::Vec3;

/// Under this n·l a photograph is dark anyway, and a degree of error in the normal decides.
const FACING: f32 = 0.2;
/// A pixel under this fraction of its matte brightness is in cast shadow.
const DARK: f32 = 0.3;
/// Reflectance is this quantile of brightness / n·l over the lights that face the surface: above
/// the median, as shadows only ever darken, and below the highlights.
const QUANTILE: f64 = 0.6;
/// Pixels from the edge of the mask that are not judged: the silhouette's normals are unreliable.
const BORDER: usize = 3;
/// A pixel must be faced by this many lights before its reflectance is believed.
const LIGHTS: usize = 5;

/// What a matte surface would have to reflect to look as it does in most of the photographs.
pub(super) struct MatteFit {
    /// Brightness facing a lamp of unit intensity, ≥ 0; NaN = unknown or not to be judged.
    reflectance: Plane<f32>,
}

impl MatteFit {
    /// From photographs (brightness divided by the lamp's intensity), one per lamp direction, in
    /// the same axes as `normal`; `None` where there are too few of them.
    pub(super) fn new(
        normal: &Plane<Vec3>,
        photographs: &[(Vec3, Plane<f32>)],
        counts: &Plane<bool>,
    ) -> Option<Self> {
        let size = counts.size();
        if photographs.len() < LIGHTS
            || normal.size() != size
            || photographs
                .iter()
                .any(|(_, brightness)| brightness.size() != size)
        {
            return None;
        }
        let outside = near(&counts.map(|counts| !counts), BORDER);
        let (width, height) = size;
        let reflectance = Plane::from_fn(width, height, |x, y| {
            if outside[(x, y)] {
                return f32::NAN;
            }
            let mut ratios = Vec::with_capacity(photographs.len());
            for (direction, brightness) in photographs {
                let cosine = normal[(x, y)].dot(*direction);
                let ratio = brightness[(x, y)] / cosine;
                if cosine > FACING && ratio.is_finite() {
                    ratios.push(f64::from(ratio));
                }
            }
            if ratios.len() < LIGHTS {
                return f32::NAN;
            }
            super::cost::percentile(&mut ratios, QUANTILE).map_or(f32::NAN, |ratio| ratio as f32)
        });
        Some(Self { reflectance })
    }

    /// Cast shadow of one lamp: 0 = shadow, 1 = lit, NaN = not to be judged.
    pub(super) fn cast_shadow(
        &self,
        normal: &Plane<Vec3>,
        direction: Vec3,
        brightness: &Plane<f32>,
    ) -> Plane<f32> {
        let (width, height) = self.reflectance.size();
        Plane::from_fn(width, height, |x, y| {
            let cosine = normal[(x, y)].dot(direction);
            let expected = self.reflectance[(x, y)] * cosine;
            let seen = brightness[(x, y)];
            if cosine > FACING && expected > 0.0 && seen.is_finite() {
                if seen < DARK * expected { 0.0 } else { 1.0 }
            } else {
                f32::NAN
            }
        })
    }

    /// Brightness of the surface facing a lamp of unit intensity; NaN = unknown.
    pub(super) fn reflectance(&self) -> &Plane<f32> {
        &self.reflectance
    }
}

/// Mean of the three channels.
pub(super) fn brightness(light: &Plane<[f32; 3]>) -> Plane<f32> {
    light.map(|[red, green, blue]| (red + green + blue) / 3.0)
}
