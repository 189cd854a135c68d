//! Light from everywhere: an environment map as at most 256 shadowed lights.

use super::{
    Indirect, Lamp, LightSet, Prepared, RelightOptions, Relit, Shadows,
    shading::{Facet, LANES, SurfaceRow, block, store},
    visibility::{
        VisibilityMap,
        map::{AZIMUTHS, DIRECTIONS, RINGS, cell},
    },
};
use crate::radiometry::LinearImage;
use drivers::Plane;
use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*, u32x16};
use glam::Vec3;
use rayon::prelude::*;
use thiserror::Error;

/// A light that sends more than this share of the whole is swept by itself at full resolution:
/// its shadow is seen as one.
const STRONG_SHARE: f32 = 0.04;
/// At most so many lights are swept by themselves.
const STRONG_LIGHTS: usize = 4;

/// Why an environment map gives no light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum EnvironmentError {
    /// Not a picture of the whole sphere.
    #[error("environment map is {0}×{1}; a latitude–longitude map is twice as wide as high")]
    Shape(usize, usize),
    /// Negative or not finite.
    #[error(
        "environment map holds a value that is negative or not finite at pixel ({0}, {1}); clean it first"
    )]
    Value(usize, usize),
    /// All black.
    #[error("environment map sends no light toward what the camera sees")]
    Dark,
}

/// An environment, gathered into the cells of the visibility map.
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    /// One lamp per cell with light in it.
    lamps: Vec<Option<Lamp>>,
}

impl Environment {
    /// Gathers a latitude–longitude radiance map: its middle is what the camera looks at, its
    /// left half lies to the camera's left, its first row is straight up; linear, ≥ 0.
    ///
    /// Each cell of 0.03 sr becomes one lamp that stands at the centroid of the cell's light;
    /// what lies more than 20° behind the scene lights nothing the camera sees and is left out.
    ///
    /// # Errors
    /// [`EnvironmentError`] for a map of another shape, with impossible values, or black.
    pub fn new(radiance: &Plane<[f32; 3]>) -> Result<Self, EnvironmentError> {
        Self::turned(radiance, 0.0)
    }

    /// The same map turned about the vertical: by `degrees` what stood straight ahead goes to the right.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn turned(radiance: &Plane<[f32; 3]>, degrees: f32) -> Result<Self, EnvironmentError> {
        let turn = degrees.rem_euclid(360.0).to_radians();
        let (width, height) = radiance.size();
        if height == 0 || width != 2 * height {
            return Err(EnvironmentError::Shape(width, height));
        }
        let mut gathered = Gathered::default();
        for y in 0..height {
            let latitude = std::f32::consts::PI * (0.5 - (y as f32 + 0.5) / height as f32);
            let (sin_latitude, cos_latitude) = latitude.sin_cos();
            // Area of a pixel on the sphere, over π: irradiance of a white Lambertian is 1 when
            // the whole hemisphere has radiance 1.
            let share = f64::from(cos_latitude) * (std::f64::consts::PI / height as f64).powi(2)
                / std::f64::consts::PI;
            for x in 0..width {
                let longitude =
                    turn + std::f32::consts::TAU * ((x as f32 + 0.5) / width as f32 - 0.5);
                let pixel = radiance[(x, y)];
                if !pixel.iter().all(|value| value.is_finite() && *value >= 0.0) {
                    return Err(EnvironmentError::Value(x, y));
                }
                let toward = Vec3::new(
                    cos_latitude * longitude.sin(),
                    -sin_latitude,
                    cos_latitude * longitude.cos(),
                );
                gathered.add(toward, pixel, share);
            }
        }
        gathered.lamps()
    }

    /// Gathers distant lamps, such as [`Self::lamps`] of another environment: those of one cell
    /// become one at their centroid.
    ///
    /// # Errors
    /// [`EnvironmentError::Dark`] when none of them lights what the camera sees.
    pub fn from_lamps(lamps: &[Lamp]) -> Result<Self, EnvironmentError> {
        let mut gathered = Gathered::default();
        for lamp in lamps {
            gathered.add(lamp.toward(), lamp.color, 1.0);
        }
        gathered.lamps()
    }

    /// The lamps that stand for the environment.
    pub fn lamps(&self) -> impl Iterator<Item = &Lamp> {
        self.lamps.iter().flatten()
    }

    /// The lamp of every cell that has light in it.
    pub(super) fn cells(&self) -> impl Iterator<Item = (usize, Lamp)> {
        let cells = self.lamps.iter().enumerate();
        cells.filter_map(|(cell, lamp)| Some((cell, (*lamp)?)))
    }

    /// Cells whose light is swept by itself, the brightest first.
    pub(super) fn strong(&self) -> Vec<usize> {
        let power = |lamp: &Option<Lamp>| lamp.map_or(0.0, |lamp| lamp.color.iter().sum::<f32>());
        let total: f32 = self.lamps.iter().map(power).sum();
        let mut strong: Vec<usize> = (0..DIRECTIONS)
            .filter(|&cell| power(&self.lamps[cell]) > STRONG_SHARE * total)
            .collect();
        strong.sort_by(|&a, &b| power(&self.lamps[b]).total_cmp(&power(&self.lamps[a])));
        strong.truncate(STRONG_LIGHTS);
        strong
    }
}

/// Light summed by cell.
struct Gathered {
    colors: [[f64; 3]; DIRECTIONS],
    centroids: [Vec3; DIRECTIONS],
}

impl Default for Gathered {
    fn default() -> Self {
        Self {
            colors: [[0.0; 3]; DIRECTIONS],
            centroids: [Vec3::ZERO; DIRECTIONS],
        }
    }
}

impl Gathered {
    /// Adds `share` of the light `color` from `toward`, unless it is too far behind the scene.
    fn add(&mut self, toward: Vec3, color: [f32; 3], share: f64) {
        let Some(cell) = cell(toward) else { return };
        for (sum, value) in self.colors[cell].iter_mut().zip(color) {
            *sum += f64::from(value) * share;
        }
        self.centroids[cell] += toward * (color.iter().sum::<f32>() * share as f32);
    }

    fn lamps(self) -> Result<Environment, EnvironmentError> {
        let lamps: Vec<Option<Lamp>> = self
            .colors
            .iter()
            .zip(self.centroids)
            .map(|(color, centroid)| {
                let lamp = Lamp::from_person([centroid.x, -centroid.y, -centroid.z]).ok()?;
                lamp.with_color(color.map(|value| value as f32)).ok()
            })
            .collect();
        if lamps.iter().all(Option::is_none) {
            return Err(EnvironmentError::Dark);
        }
        Ok(Environment { lamps })
    }
}

/// One lamp of the map as the shader sees it.
#[derive(Clone, Copy)]
struct CellLamp {
    azimuth: u32,
    toward: [f32; 3],
    color: [f32; 3],
    /// Mean of the color's channels.
    level: f32,
}

impl Prepared {
    /// Which of the directions of a set's lights every pixel sees.
    pub fn visibility_map(&self, set: &LightSet) -> VisibilityMap {
        match &self.occluders {
            Some(occluders) => VisibilityMap::new(occluders, &set.cells()),
            None => VisibilityMap::clear(self.size()),
        }
    }

    /// The scene under an environment. `shadow` of the answer is the share of the light that
    /// arrives.
    ///
    /// `map` is [`Self::visibility_map`] of the same set or of the whole environment it stands for: of
    /// any other, shadows are missing.
    ///
    /// # Panics
    /// When `map` is of another scene's size: a bug of the caller.
    pub fn environment(
        &self,
        map: &VisibilityMap,
        set: &LightSet,
        options: RelightOptions,
    ) -> Relit {
        let mut rings: [Vec<CellLamp>; RINGS] = Default::default();
        for (cell, lamp) in &set.weak {
            rings[cell / AZIMUTHS].push(CellLamp {
                azimuth: (cell % AZIMUTHS) as u32,
                toward: lamp.toward().to_array(),
                color: lamp.color,
                level: lamp.color.iter().sum::<f32>() / 3.0,
            });
        }
        let (width, height) = self.size();
        let mut light = Plane::filled(width, height, [0.0f32; 3]);
        let mut shadow = Plane::filled(width, height, 0.0f32);
        let mut open = Plane::filled(width, height, 0.0f32);
        let shadows = (options.shadows != Shadows::None).then_some(map);
        light
            .samples_mut()
            .par_chunks_mut(width.max(1))
            .zip(shadow.samples_mut().par_chunks_mut(width.max(1)))
            .zip(open.samples_mut().par_chunks_mut(width.max(1)))
            .enumerate()
            .for_each_init(
                || (vec![0.0f32; width], vec![0u32; width]),
                |(level, places), (y, ((light, shadow), open))| {
                    self.map_places(map, y, places);
                    let surface = self.surfaces.row(y, level);
                    let row = Row {
                        surface,
                        places,
                        map: shadows,
                        rings: &rings,
                        shines: self.shines,
                    };
                    dispatch!(Level::new(), simd => row.shade(simd, light, shadow, open));
                },
            );
        let mut unseen_path_fraction = 0.0;
        for lamp in &set.strong {
            let options = RelightOptions {
                indirect: Indirect::None,
                ..options
            };
            let one = self.relight(lamp, options);
            let full = self.cosines(lamp);
            let weight = lamp.color.iter().sum::<f32>() / 3.0;
            unseen_path_fraction = one.unseen_path_fraction.max(unseen_path_fraction);
            for (sum, value) in light.samples_mut().iter_mut().zip(one.light.0.samples()) {
                *sum = std::array::from_fn(|c| sum[c] + value[c]);
            }
            for (((shadow, open), one), cosine) in shadow
                .samples_mut()
                .iter_mut()
                .zip(open.samples_mut())
                .zip(one.shadow.samples())
                .zip(full)
            {
                *shadow += one * cosine * weight;
                *open += cosine * weight;
            }
        }
        if options.indirect == Indirect::Obscurance {
            self.add_bounced(&mut light);
        }
        for (shadow, open) in shadow.samples_mut().iter_mut().zip(open.samples()) {
            *shadow = if *open > 0.0 {
                *shadow / open
            } else {
                *shadow * 0.0
            };
        }
        Relit {
            light: LinearImage(light),
            shadow,
            unseen_path_fraction,
        }
    }

    /// Map pixels for row `y` of the photograph's grid.
    pub(super) fn map_places(&self, map: &VisibilityMap, y: usize, places: &mut [u32]) {
        match &self.straightened {
            None => places.copy_from_slice(map.nearest().row(y)),
            Some(lookup) => {
                for (place, &index) in places.iter_mut().zip(lookup.row(y)) {
                    let straight = map.nearest().samples();
                    *place = straight.get(index as usize).copied().unwrap_or(0);
                }
            }
        }
    }

    /// n·l of every pixel, 0 where it is turned away; NaN = unknown.
    fn cosines(&self, lamp: &Lamp) -> Vec<f32> {
        let toward = lamp.toward();
        let mut level = vec![0.0; self.width];
        let mut cosines = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            let SurfaceRow {
                normal: [nx, ny, nz],
                albedo,
                ..
            } = self.surfaces.row(y, &mut level);
            cosines.extend((0..self.width).map(|x| {
                let cosine = nx[x] * toward.x + ny[x] * toward.y + nz[x] * toward.z;
                albedo[0][x].mul_add(0.0, cosine.max(0.0))
            }));
        }
        cosines
    }

    /// Adds one bounce, as [`Indirect::Obscurance`] has it.
    fn add_bounced(&self, light: &mut Plane<[f32; 3]>) {
        let mut sum = [0.0f64; 3];
        let mut count = 0.0f64;
        for pixel in light
            .samples()
            .iter()
            .step_by(61)
            .filter(|pixel| pixel[0].is_finite())
        {
            sum = std::array::from_fn(|c| sum[c] + f64::from(pixel[c]));
            count += 1.0;
        }
        let sent: [f32; 3] = sum.map(|sum| (sum / count.max(1.0)) as f32 * self.bounce);
        let width = self.width.max(1);
        light
            .samples_mut()
            .par_chunks_mut(width)
            .enumerate()
            .for_each_init(
                || vec![0.0; self.width],
                |level, (y, light)| {
                    let SurfaceRow {
                        albedo, obscurance, ..
                    } = self.surfaces.row(y, level);
                    for (x, pixel) in light.iter_mut().enumerate() {
                        let bounced = |c: usize| albedo[c][x] * obscurance[x] * sent[c];
                        *pixel = std::array::from_fn(|c| pixel[c] + bounced(c));
                    }
                },
            );
    }
}

/// One row on its way through all lamps of the map.
struct Row<'a> {
    surface: SurfaceRow<'a>,
    places: &'a [u32],
    map: Option<&'a VisibilityMap>,
    rings: &'a [Vec<CellLamp>; RINGS],
    shines: bool,
}

impl Row<'_> {
    #[inline(always)]
    fn shade<S: Simd>(
        &self,
        simd: S,
        light: &mut [[f32; 3]],
        shadow: &mut [f32],
        open: &mut [f32],
    ) {
        let zero = f32x16::splat(simd, 0.0);
        let surface = &self.surface;
        for start in (0..light.len()).step_by(LANES) {
            let end = (start + LANES).min(light.len());
            let facet = Facet::new(simd, surface, start);
            let mut diffuse = [zero; 3];
            let mut shine = [zero; 3];
            let mut arriving = zero;
            let mut sent = zero;
            for (ring, lamps) in self.rings.iter().enumerate() {
                let mut words = [u32::MAX; LANES];
                if let Some(map) = self.map {
                    let ring = map.ring(ring);
                    for (word, &place) in words.iter_mut().zip(&self.places[start..end]) {
                        *word = ring.get(place as usize).copied().unwrap_or(u32::MAX);
                    }
                }
                let words = u32x16::load_array(simd, words);
                for lamp in lamps {
                    let toward = lamp.toward.map(|axis| f32x16::splat(simd, axis));
                    let [lit, specular] = facet.reflected(simd, toward, self.shines);
                    let clear = ((words >> lamp.azimuth) & 1).simd_gt(0);
                    sent = lit.mul_add(lamp.level, sent);
                    let lit = clear.select(lit, zero);
                    let specular = clear.select(specular, zero);
                    arriving = lit.mul_add(lamp.level, arriving);
                    for c in 0..3 {
                        diffuse[c] = lit.mul_add(lamp.color[c], diffuse[c]);
                        shine[c] = specular.mul_add(lamp.color[c], shine[c]);
                    }
                }
            }
            let mut channels = [zero; 3];
            for c in 0..3 {
                let albedo = block(simd, surface.albedo[c], start);
                channels[c] = albedo.mul_add(diffuse[c], shine[c]);
            }
            store(&channels, &mut light[start..]);
            // Unknown albedo makes the share unknown: zero times it is NaN again.
            let arriving = block(simd, surface.albedo[0], start).mul_add(zero, arriving);
            shadow[start..end].copy_from_slice(&arriving.as_slice()[..end - start]);
            open[start..end].copy_from_slice(&sent.as_slice()[..end - start]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_sphere_lights_a_white_wall_facing_the_camera_with_one() {
        let environment = Environment::new(&Plane::filled(256, 128, [1.0; 3])).unwrap();
        let facing: f32 = environment
            .lamps()
            .map(|lamp| lamp.color[0] * (-lamp.toward().z).max(0.0))
            .sum();
        // Cells and pixels of the map do not quite tile each other.
        assert!((facing - 1.0).abs() < 0.01, "{facing}");
    }

    #[test]
    fn light_on_the_right_of_the_map_stands_on_the_right() {
        let map = Plane::from_fn(64, 32, |x, y| {
            [((40..44).contains(&x) && y < 16) as u8 as f32; 3]
        });
        let environment = Environment::new(&map).unwrap();
        for lamp in environment.lamps() {
            let [x, y, _] = lamp.person_direction();
            assert!(x > 0.0 && y > 0.0);
        }
    }

    #[test]
    fn a_turned_map_is_the_map_with_its_columns_moved() {
        let value = |x: usize, y: usize| [((3 * x + y) % 11) as f32, (x % 5) as f32, 1.0];
        let map = Plane::from_fn(64, 32, value);
        // A quarter of the way round are 16 columns.
        let moved = Plane::from_fn(64, 32, |x, y| value((x + 48) % 64, y));
        let [turned, moved] = [
            Environment::turned(&map, 90.0).unwrap(),
            Environment::turned(&moved, 360.0).unwrap(),
        ];
        for (a, b) in turned.lamps().zip(moved.lamps()) {
            assert!(a.toward().dot(b.toward()) > 0.999, "{a:?} {b:?}");
            assert!((a.color[0] - b.color[0]).abs() < 1e-3 * (1.0 + b.color[0]));
        }
        let ahead = Plane::from_fn(64, 32, |x, y| [f32::from(x == 31 && y == 15); 3]);
        let turned = Environment::turned(&ahead, 100.0).unwrap();
        let lamp = turned.lamps().next().unwrap();
        assert!(lamp.person_direction()[0] > 0.9, "to the right");
    }

    #[test]
    fn maps_that_cannot_be_environments_are_refused() {
        let refuse = |map: Plane<[f32; 3]>| Environment::new(&map).unwrap_err();
        assert_eq!(
            refuse(Plane::filled(8, 8, [1.0; 3])),
            EnvironmentError::Shape(8, 8)
        );
        assert_eq!(
            refuse(Plane::filled(8, 4, [f32::NAN; 3])),
            EnvironmentError::Value(0, 0)
        );
        assert_eq!(
            refuse(Plane::filled(8, 4, [0.0; 3])),
            EnvironmentError::Dark
        );
    }
}
