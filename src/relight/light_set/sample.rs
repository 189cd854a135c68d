//! A scene so small that it can be lit hundreds of times in a few milliseconds.

use crate::relight::{
    Lamp, Prepared,
    shading::{ShaderLamp, SurfaceRow, shade_row},
    visibility::{
        VisibilityMap,
        map::{AZIMUTHS, RINGS},
    },
};

/// At most so many pixels of each kind.
const PIXELS: [usize; 2] = [1536, 768];
/// Roughness under which highlights are small and sharp: such pixels are few, and change most.
const GLOSSY: f32 = 0.35;

/// Pixels spread over a scene, those whose surface is known, in one row, and which directions they
/// see.
#[derive(Debug)]
pub(super) struct Sample {
    /// Where each stands in the scene.
    pub pixels: Vec<(usize, usize)>,
    /// How many of the scene's pixels each stands for, relative to the mean.
    pub weights: Vec<f32>,
    /// Normal, albedo, roughness and ray, one plane after another.
    planes: [Vec<f32>; 9],
    /// Nothing is bounced here.
    obscurance: Vec<f32>,
    /// Per ring one word per pixel, bit = azimuth; set = clear.
    rings: Vec<Vec<u32>>,
    shines: bool,
}

impl Sample {
    /// Of a scene and the directions that its pixels see.
    pub fn new(prepared: &Prepared, map: &VisibilityMap) -> Self {
        let (width, height) = prepared.size();
        let mut level = vec![0.0; width];
        let kind = |row: &SurfaceRow<'_>, x: usize| {
            let known = row.albedo[0][x].is_finite();
            known.then(|| usize::from(prepared.shines && row.roughness[x] < GLOSSY))
        };
        let mut counts = [0usize; 2];
        for y in 0..height {
            let row = prepared.surfaces.row(y, &mut level);
            for kind in (0..width).filter_map(|x| kind(&row, x)) {
                counts[kind] += 1;
            }
        }
        let sides: [usize; 2] = std::array::from_fn(|kind| {
            let fits = |side: &usize| counts[kind] <= PIXELS[kind] * side * side;
            (1..).find(fits).unwrap_or(1)
        });
        let mut sample = Self {
            pixels: Vec::new(),
            weights: Vec::new(),
            planes: Default::default(),
            obscurance: Vec::new(),
            rings: vec![Vec::new(); RINGS],
            shines: prepared.shines,
        };
        let mut places = vec![0; width];
        for y in 0..height {
            prepared.map_places(map, y, &mut places);
            let row = prepared.surfaces.row(y, &mut level);
            for (x, place) in places.iter().enumerate() {
                if let Some(kind) = kind(&row, x)
                    && stands_for_square((x, y), sides[kind])
                {
                    sample.push((x, y), &row, map, *place);
                    sample.weights.push((sides[kind] * sides[kind]) as f32);
                }
            }
        }
        sample.obscurance = vec![0.0; sample.pixels.len()];
        let mean = sample.weights.iter().sum::<f32>() / sample.weights.len().max(1) as f32;
        sample.weights.iter_mut().for_each(|weight| *weight /= mean);
        sample
    }

    fn push(&mut self, at: (usize, usize), row: &SurfaceRow<'_>, map: &VisibilityMap, place: u32) {
        self.pixels.push(at);
        let [nx, ny, nz] = row.normal;
        let [red, green, blue] = row.albedo;
        let from = [
            nx,
            ny,
            nz,
            red,
            green,
            blue,
            row.roughness,
            row.ray_x,
            row.ray_y,
        ];
        for (plane, from) in self.planes.iter_mut().zip(from) {
            plane.push(from[at.0]);
        }
        for (ring, words) in self.rings.iter_mut().enumerate() {
            let word = map.ring(ring).get(place as usize);
            words.push(word.copied().unwrap_or(u32::MAX));
        }
    }

    /// Light of the scene's mean pixel.
    pub fn mean(&self, pixels: &[[f32; 3]]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (pixel, weight) in pixels.iter().zip(&self.weights) {
            for (sum, value) in sum.iter_mut().zip(pixel) {
                *sum += f64::from(weight * value);
            }
        }
        sum.map(|sum| sum / pixels.len().max(1) as f64)
    }

    /// The pixels under a lamp with the shadows of a cell's direction.
    pub fn lit(&self, cell: usize, lamp: &Lamp) -> Vec<[f32; 3]> {
        let azimuth = cell % AZIMUTHS;
        let mut visibility: Vec<f32> = self.rings[cell / AZIMUTHS]
            .iter()
            .map(|word| (word >> azimuth & 1) as f32)
            .collect();
        let [nx, ny, nz, red, green, blue, roughness, ray_x, ray_y] =
            self.planes.each_ref().map(Vec::as_slice);
        let row = SurfaceRow {
            normal: [nx, ny, nz],
            albedo: [red, green, blue],
            roughness,
            obscurance: &self.obscurance,
            ray_x,
            ray_y,
            metres: &[],
        };
        let lamp = ShaderLamp {
            emitter: lamp.into(),
            indirect: [0.0; 3],
            shines: self.shines,
        };
        let mut lit = vec![[0.0; 3]; self.pixels.len()];
        shade_row(&row, &lamp, &mut visibility, &mut lit);
        lit
    }
}

/// One pixel of each square of pixels, elsewhere in every square, so that no pattern keeps step.
fn stands_for_square((x, y): (usize, usize), side: usize) -> bool {
    let (across, down) = (x / side, y / side);
    (3 * across + 2 * down) % side == y % side && (2 * across + 3 * down) % side == x % side
}
