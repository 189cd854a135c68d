//! Which of 256 directions every pixel sees; once per shot and set of lights.
//!
//! The directions stand in 32 azimuths and 8 rings of equal area around the camera's axis, from
//! the lens's own direction to 20° behind the scene's side. One bit says whether the way is
//! clear, so that the shadow of any further light is a look at a bit. Horizon maps (Max 1988;
//! Sloan & Cohen 2000) keep one angle per azimuth; slabs can leave gaps under an occluder, hence
//! bits.

use super::{
    answers::Answers,
    occluders::Occluders,
    sweep::{LIT, Thickness, sweep},
};
use crate::relight::Origin;
use drivers::Plane;
use glam::Vec3;
use rayon::prelude::*;

/// Azimuths around the camera's axis.
pub const AZIMUTHS: usize = 32;
/// Rings of equal solid angle.
pub const RINGS: usize = 8;
/// Directions of a map.
pub const DIRECTIONS: usize = AZIMUTHS * RINGS;
/// Cosine between the camera's axis (toward the camera) and the outer edge of the last ring:
/// lights a little behind the scene still graze what the camera sees.
pub const LEAST_COSINE: f32 = -0.342;

/// The map is computed on a grid of at most this many pixels.
const MAP_PIXELS: usize = 32_768;

/// Unit vector of direction `index` in camera axes: the middle of its cell.
pub fn direction(index: usize) -> Vec3 {
    let (ring, azimuth) = (index / AZIMUTHS, index % AZIMUTHS);
    let cosine = 1.0 - (ring as f32 + 0.5) / RINGS as f32 * (1.0 - LEAST_COSINE);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (sin, cos) = ((azimuth as f32 + 0.5) / AZIMUTHS as f32 * std::f32::consts::TAU).sin_cos();
    Vec3::new(sine * cos, sine * sin, -cosine)
}

/// The direction whose cell contains `toward` (unit, camera axes); `None` further behind the
/// scene than the map reaches.
pub fn cell(toward: Vec3) -> Option<usize> {
    let share = (1.0 + toward.z) / (1.0 - LEAST_COSINE);
    if share > 1.0 {
        return None;
    }
    let ring = ((share * RINGS as f32) as usize).min(RINGS - 1);
    let turn = toward.y.atan2(toward.x).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
    Some(ring * AZIMUTHS + ((turn * AZIMUTHS as f32) as usize).min(AZIMUTHS - 1))
}

/// Some of the directions.
pub type Cells = [bool; DIRECTIONS];

/// The whole factor that reduces a grid to at most so many pixels.
pub(in crate::relight) fn factor((width, height): (usize, usize), pixels: usize) -> usize {
    let mut factor = 1;
    while width.div_ceil(factor) * height.div_ceil(factor) > pixels {
        factor += 1;
    }
    factor
}

/// Per ring one word per pixel of `occluders`, bit = azimuth; set = clear. Directions outside
/// `cells` are not swept and clear.
fn clear(occluders: &Occluders, cells: &Cells) -> Vec<Vec<u32>> {
    let (width, height) = occluders.size();
    (0..RINGS)
        .into_par_iter()
        .map(|ring| {
            let cells = &cells[ring * AZIMUTHS..(ring + 1) * AZIMUTHS];
            let unasked = (0..AZIMUTHS).fold(0u32, |word, azimuth| {
                word | u32::from(!cells[azimuth]) << azimuth
            });
            let mut words = vec![unasked; width * height];
            let mut row = vec![0u8; width];
            for azimuth in (0..AZIMUTHS).filter(|&azimuth| cells[azimuth]) {
                let toward = direction(ring * AZIMUTHS + azimuth);
                let swept = sweep(occluders, Origin::Distant(toward), Thickness::Guessed);
                let answers = Answers::new(&swept, width);
                for (y, words) in words.chunks_mut(width.max(1)).enumerate() {
                    answers.part(y, 0, &mut row);
                    for (word, answer) in words.iter_mut().zip(&row) {
                        *word |= u32::from(answer & LIT > LIT / 2) << azimuth;
                    }
                }
            }
            words
        })
        .collect()
}

/// Which directions every pixel sees.
#[derive(Debug, Clone)]
pub struct VisibilityMap {
    /// Per ring one word per map pixel, bit = azimuth; set = clear.
    rings: Vec<Vec<u32>>,
    /// Per pixel of the occluders' grid the map pixel that answers for it.
    nearest: Plane<u32>,
}

impl VisibilityMap {
    /// Sweeps the directions of `cells`; every other counts as clear everywhere.
    pub fn new(occluders: &Occluders, cells: &Cells) -> Self {
        let factor = factor(occluders.size(), MAP_PIXELS);
        let small = occluders.reduced(factor);
        Self {
            rings: clear(&small, cells),
            nearest: nearest(occluders, &small, factor),
        }
    }

    /// Of a picture in which nothing stands in the way.
    pub fn clear((width, height): (usize, usize)) -> Self {
        Self {
            rings: vec![vec![u32::MAX]; RINGS],
            nearest: Plane::filled(width, height, 0),
        }
    }

    /// The words of one ring, one per map pixel.
    pub(in crate::relight) fn ring(&self, ring: usize) -> &[u32] {
        &self.rings[ring]
    }

    /// Map pixels that answer for the pixels of row `y`.
    pub(in crate::relight) fn nearest(&self) -> &Plane<u32> {
        &self.nearest
    }
}

/// For every pixel the map pixel around it whose surface lies nearest in depth, so that shadows
/// keep to their side of an edge.
fn nearest(occluders: &Occluders, small: &Occluders, factor: usize) -> Plane<u32> {
    let (width, height) = occluders.size();
    let (small_width, small_height) = small.size();
    let middle = (factor - 1) / 2;
    let around = |at: usize, limit: usize| {
        let at = (at as f32 - middle as f32) / factor as f32;
        let first = at.floor().max(0.0) as usize;
        [
            (first.min(limit - 1), (at - first as f32).abs()),
            ((first + 1).min(limit - 1), (first as f32 + 1.0 - at).abs()),
        ]
    };
    let samples = (0..width * height)
        .into_par_iter()
        .map(|index| {
            let (x, y) = (index % width, index / width);
            let z = occluders.metres(x, y);
            let mut best = (f32::INFINITY, 0);
            for (sy, dy) in around(y, small_height) {
                for (sx, dx) in around(x, small_width) {
                    let there = small.metres(sx, sy);
                    let apart = if there == z {
                        0.0
                    } else {
                        ((there - z) / z).abs()
                    };
                    // A pixel apart counts as much as half a percent of depth.
                    let cost = apart + 0.005 * (dx + dy);
                    if cost < best.0 {
                        best = (cost, sy * small_width + sx);
                    }
                }
            }
            best.1 as u32
        })
        .collect();
    Plane::new(width, height, samples).expect("one index per pixel")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_direction_lies_in_its_own_cell() {
        for index in 0..DIRECTIONS {
            assert_eq!(cell(direction(index)), Some(index));
        }
        assert_eq!(cell(Vec3::Z), None);
    }
}
