//! Noise on depth as the reference method is trained and tested with: Gaussian, then blurred.

use crate::shot::Shot;
use drivers::{DepthFrame, Plane, chance::Chance};
use serde::Serialize;

/// Side of the square picture that the strengths are stated for, pixels.
const STATED_SIDE: f32 = 256.0;
/// The blur's kernel reaches so many standard deviations.
const REACH: f32 = 3.0;
/// A span of depth smaller than this is taken as this, metres: the noise of a flat wall.
const LEAST_SPAN_METRES: f32 = 1e-3;

/// Gaussian noise and a Gaussian blur on depth brought to [0, 1] (0 = farthest and unknown).
///
/// Stated for 256×256 pixels. On another grid of side s·256 the blur is s times as wide and the
/// noise of a sample so much stronger (nearly s times) that what is left of it after the blur, on
/// even ground nearly `noise / (2 √π blur)`, is the same.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DepthNoise {
    /// Standard deviation of the noise before the blur, as a share of the span of depth; ≥ 0.
    pub noise: f32,
    /// Standard deviation of the blur, pixels at 256×256; ≥ 0, 0 = none.
    pub blur_pixels: f32,
}

impl DepthNoise {
    /// Of Qiu et al. 2020: 6.25e-2 and one pixel.
    pub const PAPER: Self = Self {
        noise: 6.25e-2,
        blur_pixels: 1.0,
    };

    /// The shot with noise on its depth. The camera's own statement of its sigma is dropped: it
    /// was made of the clean depth.
    pub fn on_shot(self, shot: &Shot, chance: Chance) -> Shot {
        let depth = DepthFrame {
            metres: self.on_depth(&shot.depth.metres, chance),
            sigma: None,
            ..shot.depth.clone()
        };
        Shot {
            depth,
            ..shot.clone()
        }
    }

    /// Depth in metres (NaN = no answer) with the noise on it; what has no answer stays without,
    /// and what would come to lie behind the camera loses it.
    pub fn on_depth(self, metres: &Plane<f32>, chance: Chance) -> Plane<f32> {
        let known = || metres.samples().iter().copied().filter(|z| z.is_finite());
        let least = known().fold(f32::INFINITY, f32::min);
        let most = known().fold(f32::NEG_INFINITY, f32::max);
        if least > most || (self.noise == 0.0 && self.blur_pixels == 0.0) {
            return metres.clone();
        }
        let span = (most - least).max(LEAST_SPAN_METRES);
        let (width, height) = metres.size();
        let scale = ((width * height) as f32).sqrt() / STATED_SIDE;
        let kernel = kernel(self.blur_pixels * scale);
        let noise = self.noise * kept(&self::kernel(self.blur_pixels)) / kept(&kernel);
        let near = Plane::from_fn(width, height, |x, y| {
            let z = metres[(x, y)];
            let near = if z.is_finite() {
                (most - z) / span
            } else {
                0.0
            };
            near + noise * chance.normal((y * width + x) as u64)
        });
        let near = blurred(&near, &kernel);
        Plane::from_fn(width, height, |x, y| {
            let z = most - near[(x, y)] * span;
            if metres[(x, y)].is_finite() && z > 0.0 {
                z
            } else {
                f32::NAN
            }
        })
    }
}

/// A Gaussian's weights, sum 1, its middle in the middle; the middle alone for a width of 0.
fn kernel(sigma_pixels: f32) -> Vec<f32> {
    if sigma_pixels == 0.0 {
        return vec![1.0];
    }
    let reach = (REACH * sigma_pixels).ceil() as i32;
    let weights = (-reach..=reach).map(|at| (-0.5 * (at as f32 / sigma_pixels).powi(2)).exp());
    let weights: Vec<f32> = weights.collect();
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// The share of the standard deviation of white noise that is left after a blur along both axes.
fn kept(kernel: &[f32]) -> f32 {
    kernel.iter().map(|weight| weight * weight).sum()
}

/// Blur along both axes, sides continued beyond the border.
fn blurred(plane: &Plane<f32>, kernel: &[f32]) -> Plane<f32> {
    let reach = (kernel.len() / 2) as isize;
    let along = |at: usize, end: usize, sample: &dyn Fn(usize) -> f32| -> f32 {
        let taps = kernel.iter().zip(-reach..=reach);
        taps.map(|(weight, offset)| {
            let place = at.saturating_add_signed(offset).min(end - 1);
            weight * sample(place)
        })
        .sum()
    };
    let (width, height) = plane.size();
    let rows = Plane::from_fn(width, height, |x, y| along(x, width, &|x| plane[(x, y)]));
    Plane::from_fn(width, height, |x, y| along(y, height, &|y| rows[(x, y)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Flat ground, with one near and one far sample to span the depth.
    fn ground(side: usize, least: f32, most: f32) -> Plane<f32> {
        let mut plane = Plane::filled(side, side, 0.5 * (least + most));
        plane[(0, 0)] = least;
        plane[(side - 1, 0)] = most;
        plane
    }

    /// Standard deviation well inside the border.
    fn deviation(plane: &Plane<f32>) -> f32 {
        let side = plane.width();
        let inside: Vec<f32> = (16..side - 16)
            .flat_map(|y| plane.row(y)[16..side - 16].iter().copied())
            .collect();
        let mean = inside.iter().sum::<f32>() / inside.len() as f32;
        let squares: f32 = inside.iter().map(|z| (z - mean).powi(2)).sum();
        (squares / inside.len() as f32).sqrt()
    }

    #[test]
    fn after_the_blur_a_28th_of_the_noise_is_left_on_every_grid() {
        // 6.25e-2 / (2 √π) = 1.763e-2 of the span. Blurred noise is alike over some 13 pixels at
        // 256², so the fewest samples, 96² blurred by half a pixel, are over 2000 independent ones:
        // 8 % is five standard errors.
        for side in [128, 256, 512] {
            let found = DepthNoise::PAPER.on_depth(&ground(side, 1.0, 3.0), Chance::new(5));
            let share = deviation(&found) / 2.0;
            let wanted = 6.25e-2 / (2.0 * std::f32::consts::PI.sqrt());
            assert!(
                (share / wanted - 1.0).abs() < 0.08,
                "{side}: {share} of the span"
            );
        }
    }

    #[test]
    fn a_shot_keeps_everything_but_its_depth_and_its_sigma() {
        use drivers::{
            ColorFrame, Distortion, Exposure, FlashLamp, Illumination, Intrinsics, Pixels, Rig,
            Timestamp, Transfer,
        };
        let flash = ColorFrame {
            at: Timestamp::from_nanos(1),
            sequence: 1,
            light: Illumination::Flash,
            exposure: Exposure {
                seconds: 1.0,
                gain: 1.0,
            },
            pixels: Pixels::RgbF32(Plane::filled(64, 64, [0.5; 3])),
            transfer: Transfer::Linear,
            black_level: 0.0,
            white_level: 1.0,
        };
        let shot = Shot {
            flash,
            ambient: Vec::new(),
            depth: DepthFrame {
                at: Timestamp::from_nanos(1),
                sequence: 0,
                metres: ground(64, 1.0, 2.0),
                amplitude: Some(Plane::filled(64, 64, 7.0)),
                sigma: Some(Plane::filled(64, 64, 0.001)),
            },
            rig: Rig {
                color: Intrinsics {
                    width: 64,
                    height: 64,
                    fx: 60.0,
                    fy: 60.0,
                    cx: 31.5,
                    cy: 31.5,
                    distortion: Distortion::None {},
                },
                depth: None,
                flash: FlashLamp {
                    position_metres: glam::DVec3::ZERO,
                    intensity: None,
                    beam: drivers::Beam::default(),
                },
            },
            mask: None,
        };
        let worse = DepthNoise::PAPER.on_shot(&shot, Chance::new(1));
        assert_ne!(worse.depth.metres, shot.depth.metres);
        assert_eq!(worse.depth.amplitude, shot.depth.amplitude);
        assert_eq!(worse.depth.sigma, None);
        assert_eq!(worse.flash.pixels, shot.flash.pixels);
    }

    proptest! {
        #[test]
        fn no_noise_and_no_blur_change_nothing(
            depths in proptest::collection::vec(0.2_f32..9.0, 12 * 9),
            seed in any::<u64>(),
        ) {
            let plane = Plane::new(12, 9, depths).unwrap();
            let none = DepthNoise { noise: 0.0, blur_pixels: 0.0 };
            prop_assert_eq!(none.on_depth(&plane, Chance::new(seed)), plane);
        }

        #[test]
        fn the_same_seed_gives_the_same_depth_and_another_seed_another(seed in any::<u64>()) {
            let plane = ground(24, 0.5, 1.5);
            let once = DepthNoise::PAPER.on_depth(&plane, Chance::new(seed));
            let again = DepthNoise::PAPER.on_depth(&plane, Chance::new(seed));
            let other = DepthNoise::PAPER.on_depth(&plane, Chance::new(seed ^ 1));
            prop_assert_eq!(&once, &again);
            prop_assert_ne!(&once, &other);
        }

        #[test]
        fn what_has_no_answer_stays_without(
            holes in proptest::collection::vec(any::<bool>(), 20 * 20),
            seed in any::<u64>(),
        ) {
            let mut plane = ground(20, 2.0, 3.0);
            for (z, hole) in plane.samples_mut().iter_mut().zip(&holes) {
                if *hole {
                    *z = f32::NAN;
                }
            }
            let found = DepthNoise::PAPER.on_depth(&plane, Chance::new(seed));
            for (found, clean) in found.samples().iter().zip(plane.samples()) {
                prop_assert_eq!(found.is_finite(), clean.is_finite());
            }
        }

        #[test]
        fn the_noise_grows_with_the_span_of_depth(factor in 0.2_f32..4.0, seed in any::<u64>()) {
            let near = ground(48, 1.0, 2.0);
            let far = near.map(|z| z * factor);
            let chance = Chance::new(seed);
            let (near, far) = (
                DepthNoise::PAPER.on_depth(&near, chance),
                DepthNoise::PAPER.on_depth(&far, chance),
            );
            for (near, far) in near.samples().iter().zip(far.samples()) {
                prop_assert!((near * factor - far).abs() < 1e-4 * factor.max(1.0));
            }
        }
    }
}
