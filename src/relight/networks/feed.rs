//! What the paper's networks are fed; `models/reference/feeding.py` does the very same in training.

use super::{
    Channels,
    grid::{self, Grid},
};
use crate::radiometry::LinearImage;
use drivers::{Intrinsics, Plane};
use glam::DVec2;

/// Light is cut here; a white Lambertian facing the lamp is 1.
pub(super) const BRIGHTEST: f32 = 2.0;
/// Metres, or units of the cloud, below which an extent counts as none.
const NEAREST_SPAN: f32 = 1e-3;

/// The largest size that the shipped networks saw in training, 128 × 128; five layers halve the picture.
/// At the paper's 256 × 256 they do worse: on eight test scenes shadow MSE is 8.4e-2 instead of 6.9e-2.
pub(super) const GRID: Grid = Grid {
    pixels: 16_384.0,
    multiple: 32.0,
};

/// A photograph with its depth.
#[derive(Debug, Clone, Copy)]
pub struct Photograph<'a> {
    /// Light of the flash alone (with the room's for the Env variant), unit exposure; NaN = unknown.
    pub light: &'a LinearImage,
    /// Distance along z, metres, on this or another grid of the same picture; NaN = unknown.
    pub depth_metres: &'a Plane<f32>,
    /// Which part of the picture counts, on any grid of it; `None` = all.
    pub mask: Option<&'a Plane<bool>>,
    /// Lens of the light's grid.
    pub camera: &'a Intrinsics,
    /// Value in `light` of a white Lambertian patch facing the flash at one metre.
    pub intensity: f32,
}

/// Inputs of the networks, on their own grid of about 128 × 128 pixels.
#[derive(Debug, Clone)]
pub struct Feed {
    /// Lens of the grid.
    pub camera: Intrinsics,
    /// The photograph's light, unscaled; NaN = unknown.
    pub light: LinearImage,
    /// Light over intensity × the median distance squared, in [0, 2]; 0 where no surface is known.
    pub flash: Channels,
    /// 1 at the nearest known surface, 0 at the farthest and where none is known.
    pub near: Channels,
    /// Points (x right, y up, z toward the camera) about the middle of their box, in units of half
    /// its longest side; 0 where unknown.
    pub cloud: Channels,
    /// 1 where a surface is known, else 0.
    pub mask: Channels,
}

impl Feed {
    /// Brings a photograph onto the networks' grid; a square one of 128 × 128 is there already.
    ///
    /// # Panics
    /// When a plane is empty: a bug of the caller.
    pub fn new(photograph: &Photograph<'_>) -> Self {
        let size = GRID.size_for(photograph.light.0.size());
        let camera = photograph.camera.scaled_to(size.0, size.1);
        let light = grid::resampled(&photograph.light.0, size);
        let depth = grid::nearest(photograph.depth_metres, size);
        let counts = photograph.mask.map(|mask| grid::nearest(mask, size));
        let depth = Plane::from_fn(size.0, size.1, |x, y| {
            let z = depth[(x, y)];
            let counts = counts.as_ref().is_none_or(|counts| counts[(x, y)]);
            if counts && z.is_finite() && z > 0.0 {
                z
            } else {
                f32::NAN
            }
        });
        Self {
            flash: scaled(&light, photograph.intensity, &depth),
            near: nearness(&depth),
            cloud: normalised(&depth, &camera),
            mask: Channels::from_pixels(size, |i| {
                [f32::from(u8::from(!depth.samples()[i].is_nan()))]
            }),
            light: LinearImage(light),
            camera,
        }
    }

    /// (width, height) of the grid.
    pub fn size(&self) -> (usize, usize) {
        self.flash.size
    }
}

/// Known depths, nearest first.
fn known(depth: &Plane<f32>) -> Vec<f32> {
    let mut known: Vec<f32> = depth
        .samples()
        .iter()
        .copied()
        .filter(|z| !z.is_nan())
        .collect();
    known.sort_by(f32::total_cmp);
    known
}

fn scaled(light: &Plane<[f32; 3]>, intensity: f32, depth: &Plane<f32>) -> Channels {
    let known = known(depth);
    // The lower of two middle values.
    let median = known
        .get(known.len().saturating_sub(1) / 2)
        .copied()
        .unwrap_or(1.0);
    let factor = median * median / intensity.max(1e-6);
    Channels::from_pixels(light.size(), |i| {
        if depth.samples()[i].is_nan() {
            return [0.0; 3];
        }
        light.samples()[i].map(|value| {
            if value.is_nan() {
                0.0
            } else {
                (value * factor).clamp(0.0, BRIGHTEST)
            }
        })
    })
}

fn nearness(depth: &Plane<f32>) -> Channels {
    let known = known(depth);
    let least = known.first().copied().unwrap_or_default();
    let most = known.last().copied().unwrap_or_default();
    let span = (most - least).max(NEAREST_SPAN);
    Channels::from_pixels(depth.size(), |i| {
        let z = depth.samples()[i];
        [if z.is_nan() { 0.0 } else { (most - z) / span }]
    })
}

fn normalised(depth: &Plane<f32>, camera: &Intrinsics) -> Channels {
    let width = depth.width();
    let mut points = Vec::with_capacity(depth.len());
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for (index, &z) in depth.samples().iter().enumerate() {
        let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
        // Outside the lens's useful circle no point is known.
        let point = camera.ray(pixel).filter(|_| !z.is_nan()).map(|ray| {
            let (x, y) = (ray.x as f32, ray.y as f32);
            [x * z, -y * z, -z]
        });
        for (axis, value) in point.into_iter().flatten().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
        points.push(point);
    }
    let half = (0..3)
        .map(|axis| (high[axis] - low[axis]) / 2.0)
        .fold(NEAREST_SPAN, f32::max);
    Channels::from_pixels(depth.size(), |i| match points[i] {
        None => [0.0; 3],
        Some(point) => {
            std::array::from_fn(|axis| (point[axis] - (low[axis] + high[axis]) / 2.0) / half)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::Distortion;

    fn lens() -> Intrinsics {
        Intrinsics {
            width: 128,
            height: 128,
            fx: 64.0,
            fy: 64.0,
            cx: 63.5,
            cy: 63.5,
            distortion: Distortion::None {},
        }
    }

    fn feed(light: f32, depth: impl Fn(usize, usize) -> f32 + Sync) -> Feed {
        Feed::new(&Photograph {
            light: &LinearImage(Plane::filled(128, 128, [light; 3])),
            depth_metres: &Plane::from_fn(128, 128, depth),
            mask: None,
            camera: &lens(),
            intensity: 4.0,
        })
    }

    #[test]
    fn a_white_wall_at_the_median_distance_is_white_and_light_is_cut_at_two() {
        // At 2 m a white patch sends 4 / 2² = 1.
        let wall = feed(1.0, |_, _| 2.0);
        assert!(wall.flash.samples.iter().all(|v| (v - 1.0).abs() < 1e-6));
        let glare = feed(9.0, |_, _| 2.0);
        assert!(glare.flash.samples.iter().all(|v| *v == 2.0));
        let unknown = feed(f32::NAN, |_, _| 2.0);
        assert!(unknown.flash.samples.iter().all(|v| *v == 0.0));
    }

    #[test]
    fn nearness_runs_from_one_to_zero_and_unknown_counts_as_far() {
        let step = feed(1.0, |x, y| match (x, y) {
            (0, 0) => f32::NAN,
            (x, _) if x < 64 => 1.0,
            _ => 3.0,
        });
        let near = step.near.channel(0);
        assert_eq!([near[0], near[1], near[100]], [0.0, 1.0, 0.0]);
        assert_eq!(
            [step.mask.channel(0)[0], step.mask.channel(0)[1]],
            [0.0, 1.0]
        );
        assert_eq!(step.flash.channel(1)[0], 0.0);
    }

    #[test]
    fn clouds_fill_the_unit_cube_about_their_middle() {
        // A wall at 2 m: x and y reach ±63.5/64 · 2, z is flat.
        let wall = feed(1.0, |_, _| 2.0);
        let at = |axis: usize, x: usize, y: usize| wall.cloud.channel(axis)[y * 128 + x];
        assert!((at(0, 127, 0) - 1.0).abs() < 1e-6 && (at(0, 0, 0) + 1.0).abs() < 1e-6);
        // Row 0 is up.
        assert!((at(1, 0, 0) - 1.0).abs() < 1e-6 && at(2, 3, 3).abs() < 1e-6);
        let nowhere = feed(1.0, |_, _| f32::NAN);
        assert!(nowhere.cloud.samples.iter().all(|v| *v == 0.0));
    }

    #[test]
    fn what_does_not_count_is_unknown_and_another_grid_of_depth_will_do() {
        let fed = Feed::new(&Photograph {
            light: &LinearImage(Plane::filled(128, 128, [1.0; 3])),
            depth_metres: &Plane::from_fn(256, 256, |x, _| if x < 128 { 2.0 } else { 9.0 }),
            mask: Some(&Plane::from_fn(2, 1, |x, _| x == 0)),
            camera: &lens(),
            intensity: 4.0,
        });
        let at = |x: usize| [fed.mask.channel(0)[x], fed.flash.channel(2)[x]];
        assert_eq!([at(63), at(64)], [[1.0, 1.0], [0.0, 0.0]]);
    }
}
