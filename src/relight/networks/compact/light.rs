//! One lamp as a network corrects it: which light arrives, and how much is bounced.

use super::{
    super::{
        Channels, Network, NetworkError,
        grid::{nearest, resampled},
        paper::{answers, plane},
    },
    DEPTH_GAIN, GRID, calmed,
    doubt::{Doubt, UNSHADOWED},
    doubt_of, finite,
    sight::median_depth,
};
use crate::{
    relight::{Emitter, Origin, Prepared, RelightOptions, Relit},
    scene::Scene,
};
use drivers::Plane;
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Planes of [`Ground`], and of what the network is fed.
const GROUND_PLANES: usize = 7;
const LAMP_PLANES: usize = 10 + GROUND_PLANES;

/// What the network of light is fed whatever the lamp.
#[derive(Debug, Clone)]
pub struct Ground {
    /// Normal (x right, y up, z toward the camera), sigma of depth, depth, share of the hemisphere
    /// that the scene blocks, whether a surface is known; 0 where nothing is.
    pub planes: Channels,
    /// What each pixel sees, in camera axes and metres; not a number where nothing is known.
    points: Vec<Vec3>,
}

impl Ground {
    /// Of a scene and what was made ready of it.
    pub fn of(scene: &Scene, prepared: &Prepared) -> Self {
        let size = GRID.within(scene.albedo.size());
        let normal = resampled(&scene.normal, size);
        let albedo = resampled(&scene.albedo, size);
        let metres = nearest(&scene.depth_metres, size);
        let sigma = nearest(&scene.depth_sigma_metres, size);
        let (width, height) = prepared.size();
        let blocked = prepared.surfaces.obscurance().to_vec();
        let blocked = Plane::new(width, height, blocked).expect("one per pixel");
        let blocked = resampled(&blocked, size);
        let middle = median_depth(&metres);
        let camera = scene.camera.scaled_to(size.0, size.1);
        let point = |index: usize| {
            let pixel = DVec2::new((index % size.0) as f64, (index / size.0) as f64);
            let ray = camera.ray(pixel).map_or(Vec3::NAN, |ray| ray.as_vec3());
            metres.samples()[index] * ray
        };
        let points = (0..size.0 * size.1).into_par_iter().map(point).collect();
        let planes = Channels::from_pixels(size, |index| {
            let (z, normal) = (metres.samples()[index], normal.samples()[index]);
            let known = z.is_finite() && normal.is_finite();
            if !(known && albedo.samples()[index][0].is_finite()) {
                return [0.0; GROUND_PLANES];
            }
            [
                normal.x,
                -normal.y,
                -normal.z,
                doubt_of(sigma.samples()[index], z),
                finite(DEPTH_GAIN * (z / middle).ln()),
                finite(blocked.samples()[index]),
                1.0,
            ]
        });
        Self { planes, points }
    }

    /// A near lamp's light falls off, but the network knows light as bright as a distant lamp's: the
    /// median of what arrives, facing a lamp of color 1, at the known pixels.
    fn level(&self, lamp: Emitter) -> f32 {
        if matches!(lamp.origin, Origin::Distant(_)) {
            return 1.0;
        }
        let known = self.planes.channel(GROUND_PLANES - 1).iter();
        let known = known.zip(&self.points).filter(|(known, _)| **known > 0.0);
        let mut light: Vec<f32> = known.map(|(_, point)| lamp.seen_from(*point).1).collect();
        if light.is_empty() {
            return 1.0;
        }
        let middle = light.len() / 2;
        light
            .select_nth_unstable_by(middle, f32::total_cmp)
            .1
            .max(1e-6)
    }
}

/// The closed form's answer for one lamp of color 1, with what it is unsure of.
#[derive(Debug, Clone)]
pub struct Swept {
    /// As [`Prepared::relight`] gives it.
    pub relit: Relit,
    /// Visibility with bodies thinner than guessed, and thicker, on a grid of at least the network's size.
    pub others: [Plane<f32>; 2],
    /// Light straight from the lamp as if nothing stood in its way.
    pub direct: Plane<[f32; 3]>,
}

/// What corrects a scene's lamps.
#[derive(Debug, Clone)]
pub struct Correction {
    ground: Ground,
    doubt: Doubt,
}

impl Correction {
    /// Of a scene and what was made ready of it.
    pub fn of(scene: &Scene, prepared: &Prepared) -> Self {
        Self {
            ground: Ground::of(scene, prepared),
            doubt: Doubt::of(prepared),
        }
    }

    /// What does not depend on the lamp.
    pub fn ground(&self) -> &Ground {
        &self.ground
    }

    /// The closed form under a white lamp that stands where `lamp` does: of color 1, or so bright where it is
    /// near that half of what is known gets more than 1.
    pub fn swept(&self, prepared: &Prepared, lamp: impl Into<Emitter>) -> Swept {
        let lamp = lamp.into();
        let white = Emitter {
            color: [1.0 / self.ground.level(lamp); 3],
            ..lamp
        };
        Swept {
            relit: prepared.relight(white, RelightOptions::default()),
            others: self.doubt.others(white),
            direct: prepared.relight(white, UNSHADOWED).light.0,
        }
    }

    /// Seventeen planes on the network's grid, 0 where nothing is known: visibility as guessed, with
    /// thinner and thicker bodies, n·l, light of the lamp after shadows (3), the unit vector toward the
    /// lamp (3; x right, y up, z toward the camera), and those of [`Ground`].
    pub fn given(&self, swept: &Swept, lamp: impl Into<Emitter>) -> Channels {
        let lamp = lamp.into();
        let ground = &self.ground.planes;
        let size = ground.size;
        let seen = resampled(&swept.relit.shadow, size);
        let others = swept.others.each_ref().map(|plane| resampled(plane, size));
        let direct = resampled(&swept.direct, size);
        let toward = |index: usize, axis: usize| {
            let toward = lamp.seen_from(self.ground.points[index]).0;
            finite([toward.x, -toward.y, -toward.z][axis])
        };
        let pixels = size.0 * size.1;
        let mut samples = vec![0.0; LAMP_PLANES * pixels];
        samples
            .par_chunks_mut(pixels)
            .enumerate()
            .for_each(|(plane, out)| {
                let known = ground.channel(GROUND_PLANES - 1);
                let seen = seen.samples();
                let shares = |from: &[f32], out: &mut [f32]| {
                    for ((out, share), known) in out.iter_mut().zip(from).zip(known) {
                        *out = if *known > 0.0 { finite(*share) } else { 0.0 };
                    }
                };
                match plane {
                    0 => shares(seen, out),
                    1 | 2 => shares(others[plane - 1].samples(), out),
                    3 => {
                        for axis in 0..3 {
                            let normals = out.iter_mut().zip(ground.channel(axis)).enumerate();
                            for (index, (out, normal)) in normals {
                                *out += normal * toward(index, axis);
                            }
                        }
                    }
                    4..7 => {
                        let light = direct.samples().iter().zip(seen).zip(known);
                        for (out, ((light, seen), known)) in out.iter_mut().zip(light) {
                            if *known > 0.0 {
                                *out = (finite(light[plane - 4]) * finite(*seen)).clamp(0.0, 2.0);
                            }
                        }
                    }
                    7..10 => {
                        for (index, (out, known)) in out.iter_mut().zip(known).enumerate() {
                            *out = known * toward(index, plane - 7);
                        }
                    }
                    _ => out.copy_from_slice(ground.channel(plane - 10)),
                }
            });
        Channels {
            size,
            count: LAMP_PLANES,
            samples,
        }
    }

    /// The scene under one lamp.
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn relight(
        &self,
        prepared: &Prepared,
        lamp: impl Into<Emitter>,
        network: &dyn Network,
    ) -> Result<Relit, NetworkError> {
        let lamp = lamp.into();
        let level = self.ground.level(lamp);
        let color = lamp.color.map(|color| color * level);
        let swept = self.swept(prepared, lamp);
        let given = self.given(&swept, lamp);
        let wanted = [("weight", 1), ("shadow", 1), ("bounced", 3)];
        let [weight, shadow, bounced] = answers(network, &[("lamp", &given)], &wanted)?;
        let size = prepared.size();
        let one = |answer: &Channels| resampled(&plane::<1>(answer).map(|[value]| *value), size);
        let (weight, told) = (one(&weight), one(&shadow));
        let bounced = calmed(&plane::<3>(&bounced), size);
        let albedo = prepared.surfaces.albedo();
        let mut relit = swept.relit;
        let pixels = relit.light.0.samples_mut().par_iter_mut();
        let pixels = pixels.zip(relit.shadow.samples_mut()).with_min_len(4096);
        pixels.enumerate().for_each(|(index, (light, shadow))| {
            let weight = finite(weight.samples()[index]).clamp(0.0, 1.0);
            let told = finite(told.samples()[index]).clamp(0.0, 1.0);
            let direct = swept.direct.samples()[index];
            // NaN stays NaN, and what is turned away stays dark.
            let faces = direct.iter().sum::<f32>() > 0.0;
            let step = if faces {
                weight * (told - *shadow)
            } else {
                0.0
            };
            *shadow += step;
            let bounced = bounced.samples()[index];
            *light = std::array::from_fn(|c| {
                let more = step * direct[c] + albedo[c][index] * finite(bounced[c]);
                let sum = light[c] + more;
                color[c] * if sum < 0.0 { 0.0 } else { sum }
            });
        });
        Ok(relit)
    }
}
