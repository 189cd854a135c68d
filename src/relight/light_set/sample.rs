//! A scene so small that it can be lit hundreds of times in a few milliseconds.

use crate::relight::{
    Lamp, Prepared,
    shading::{ShaderLamp, SurfaceRow, shade_row},
    visibility::{
        VisibilityMap,
        map::{AZIMUTHS, RINGS},
    },
};

/// At most so many pixels.
const PIXELS: usize = 2048;

/// Pixels spread over a scene, those whose surface is known, in one row, and which directions they
/// see.
#[derive(Debug)]
pub(super) struct Sample {
    /// Where each stands in the scene.
    pub pixels: Vec<(usize, usize)>,
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
        let mut side = 1;
        while (width / side) * (height / side) > PIXELS {
            side += 1;
        }
        let mut sample = Self {
            pixels: Vec::new(),
            planes: Default::default(),
            obscurance: Vec::new(),
            rings: vec![Vec::new(); RINGS],
            shines: prepared.shines,
        };
        let (mut level, mut places) = (vec![0.0; width], vec![0; width]);
        for y in 0..height {
            prepared.map_places(map, y, &mut places);
            let row = prepared.surfaces.row(y, &mut level);
            // One pixel of each square, elsewhere in every square, so that no pattern keeps step.
            let squares = (0..width / side).filter(|across| {
                (3 * across + 2 * (y / side)) % side == y % side && y / side < height / side
            });
            for across in squares {
                let x = side * across + (2 * across + 3 * (y / side)) % side;
                if row.albedo[0][x].is_finite() {
                    sample.push((x, y), &row, map, places[x]);
                }
            }
        }
        sample.obscurance = vec![0.0; sample.pixels.len()];
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
        };
        let lamp = ShaderLamp {
            toward: lamp.toward().to_array(),
            color: lamp.color,
            indirect: [0.0; 3],
            shines: self.shines,
        };
        let mut lit = vec![[0.0; 3]; self.pixels.len()];
        shade_row(&row, &lamp, &mut visibility, &mut lit);
        lit
    }
}
