//! One lamp as a network corrects it: which light arrives, and how much is bounced.

use super::{
    super::{
        Channels, Network, NetworkError,
        grid::{nearest, resampled},
        paper::answers,
    },
    DEPTH_GAIN, GRID,
    doubt::{Doubt, UNSHADOWED},
    doubt_of, finite,
    sight::median_depth,
    told::Told,
};
use crate::{
    relight::{
        Blocked, Emitter, Origin, Preparation, Prepared, Relit, enlarge::Stretch, prepared::Seen,
    },
    scene::Scene,
};
use drivers::Plane;
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Planes that change with the lamp, and those of [`Ground`] that do not.
const LAMP_PLANES: usize = 10;
const GROUND_PLANES: usize = 7;

/// The network says what is bounced on a grid so many times coarser than its own.
const BOUNCED_GRID: usize = 4;

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
    /// Of a scene on the network's grid, and the share of the hemisphere that is blocked.
    fn of(scene: &Scene, blocked: &Plane<f32>) -> Self {
        let size = scene.albedo.size();
        let (metres, sigma) = (&scene.depth_metres, &scene.depth_sigma_metres);
        let middle = median_depth(metres);
        let point = |index: usize| {
            let pixel = DVec2::new((index % size.0) as f64, (index / size.0) as f64);
            let ray = scene.camera.ray(pixel);
            metres.samples()[index] * ray.map_or(Vec3::NAN, |ray| ray.as_vec3())
        };
        let points = (0..size.0 * size.1).into_par_iter().map(point).collect();
        let planes = Channels::from_pixels(size, |index| {
            let (z, normal) = (metres.samples()[index], scene.normal.samples()[index]);
            let known = z.is_finite() && normal.is_finite();
            if !(known && scene.albedo.samples()[index][0].is_finite()) {
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

/// What the closed form says of one lamp of color 1, with what it is unsure of.
#[derive(Debug, Clone)]
pub struct Swept {
    /// The lamp, white and so bright as it was asked of.
    white: Emitter,
    /// On the photograph's grid.
    pub seen: Seen,
    /// Visibility with bodies as thick as guessed, thinner and thicker, on the network's grid.
    pub doubted: [Plane<f32>; 3],
    /// Light straight from the lamp as if nothing stood in its way, on the network's grid.
    pub direct: Plane<[f32; 3]>,
}

/// What corrects a scene's lamps.
#[derive(Debug, Clone)]
pub struct Correction {
    ground: Ground,
    doubt: Doubt,
    /// The surfaces alone, on the network's grid.
    surfaces: Prepared,
}

impl Correction {
    /// Of a scene and what was made ready of it.
    pub fn of(scene: &Scene, prepared: &Prepared) -> Self {
        let bare = Preparation {
            shadows: false,
            blocked: Blocked::Nothing,
        };
        let small = on_the_networks_grid(scene);
        let (width, height) = prepared.size();
        let blocked = prepared.surfaces.obscurance().to_vec();
        let blocked = Plane::new(width, height, blocked).expect("one per pixel");
        let blocked = resampled(&blocked, small.albedo.size());
        Self {
            ground: Ground::of(&small, &blocked),
            doubt: Doubt::of(prepared),
            surfaces: Prepared::new(&small, bare),
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
        let size = self.ground.planes.size;
        let seen = prepared.seen(white);
        Swept {
            white,
            doubted: self.doubt.seen(white, &seen.visibility, size),
            seen,
            direct: self.surfaces.relight(white, UNSHADOWED).light.0,
        }
    }

    /// Seventeen planes on the network's grid, 0 where nothing is known: visibility as guessed, with
    /// thinner and thicker bodies, n·l, light of the lamp after shadows (3), the unit vector toward the
    /// lamp (3; x right, y up, z toward the camera), and those of [`Ground`].
    pub fn given(&self, swept: &Swept, lamp: impl Into<Emitter>) -> Channels {
        let lamp = lamp.into();
        let ground = &self.ground.planes;
        let width = ground.size.0;
        let count = LAMP_PLANES + GROUND_PLANES;
        let known = ground.channel(GROUND_PLANES - 1);
        let normal = [0, 1, 2].map(|axis| ground.channel(axis));
        let doubted = swept.doubted.each_ref().map(Plane::samples);
        let direct = swept.direct.samples();
        let toward = |point: Vec3| {
            let toward = lamp.seen_from(point).0;
            [toward.x, -toward.y, -toward.z].map(finite)
        };
        let distant = match lamp.origin {
            Origin::Distant(_) => Some(toward(Vec3::NAN)),
            Origin::Near(_) => None,
        };
        Channels::from_rows(ground.size, count, |y, planes| {
            let (planes, below) = planes.split_at_mut(LAMP_PLANES);
            for (out, channel) in below.iter_mut().zip(0..) {
                out.copy_from_slice(&ground.channel(channel)[y * width..][..width]);
            }
            for x in 0..width {
                let index = y * width + x;
                if known[index] <= 0.0 {
                    continue;
                }
                let toward = distant.unwrap_or_else(|| toward(self.ground.points[index]));
                let facing: f32 = (0..3).map(|axis| normal[axis][index] * toward[axis]).sum();
                let [guessed, thin, thick] = doubted.map(|plane| finite(plane[index]));
                let lit = if facing > 0.0 { guessed } else { 0.0 };
                let light = direct[index].map(|light| (finite(light) * lit).clamp(0.0, 2.0));
                let [[red, green, blue], [right, up, back]] = [light, toward];
                let said = [lit, thin, thick, facing, red, green, blue, right, up, back];
                for (plane, said) in planes.iter_mut().zip(said) {
                    plane[x] = said;
                }
            }
        })
    }

    /// The scene under one lamp after another, in their order: while the network says what it has to of one, the next is swept and
    /// the last is shaded.
    pub fn relit<'a>(
        &'a self,
        prepared: &'a Prepared,
        lamps: &'a [Emitter],
        network: &'a dyn Network,
    ) -> Relighting<'a> {
        Relighting {
            correction: self,
            prepared,
            network,
            lamps: lamps.iter(),
            asked: None,
            answered: None,
        }
    }

    fn asked(&self, prepared: &Prepared, lamp: Emitter) -> Asked {
        let swept = self.swept(prepared, lamp);
        Asked {
            color: std::array::from_fn(|c| lamp.color[c] / swept.white.color[c]),
            given: self.given(&swept, lamp),
            white: swept.white,
            seen: swept.seen,
        }
    }

    fn shaded(&self, prepared: &Prepared, asked: Asked, answer: [Channels; 3]) -> Relit {
        let [weight, shadow, bounced] = answer;
        let color = asked.color;
        let share = |answer: Channels| -> Vec<f32> {
            let samples = answer.samples.into_iter();
            samples.map(|share| finite(share).clamp(0.0, 1.0)).collect()
        };
        let (weight, told) = (share(weight), share(shadow));
        let bounced = Told::new(&bounced, BOUNCED_GRID, prepared.size());
        let width = prepared.size().0;
        let stretch = Stretch::new(asked.given.size, prepared.size());
        let albedo = prepared.surfaces.albedo();
        let sees = |y: usize, seen: &mut [f32]| {
            let mut between = Vec::new();
            let [mut weights, mut tells] = [vec![0.0; width], vec![0.0; width]];
            stretch.row(&weight, y, &mut between, &mut weights);
            stretch.row(&told, y, &mut between, &mut tells);
            for ((seen, weight), told) in seen.iter_mut().zip(weights).zip(tells) {
                *seen += weight * (told - *seen);
            }
        };
        let sends = |y: usize, light: &mut [[f32; 3]]| {
            for (c, more) in bounced.row(y).into_iter().enumerate() {
                let albedo = &albedo[c][y * width..];
                for ((light, more), albedo) in light.iter_mut().zip(more).zip(albedo) {
                    let sum = light[c] + albedo * more;
                    // NaN stays NaN.
                    light[c] = color[c] * if sum < 0.0 { 0.0 } else { sum };
                }
            }
        };
        prepared.relight_seen(asked.white, asked.seen, sees, sends)
    }
}

/// One lamp, swept and ready for the network.
struct Asked {
    /// The lamp's color over that of `white`.
    color: [f32; 3],
    given: Channels,
    white: Emitter,
    seen: Seen,
}

/// What [`Correction::relit`] gives.
pub struct Relighting<'a> {
    correction: &'a Correction,
    prepared: &'a Prepared,
    network: &'a dyn Network,
    lamps: std::slice::Iter<'a, Emitter>,
    asked: Option<Asked>,
    answered: Option<(Asked, [Channels; 3])>,
}

impl Iterator for Relighting<'_> {
    type Item = Result<Relit, NetworkError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (correction, prepared) = (self.correction, self.prepared);
        let wanted = [("weight", 1), ("shadow", 1), ("bounced", 3)];
        loop {
            let (lamp, asked, answered) =
                (self.lamps.next(), self.asked.take(), self.answered.take());
            if lamp.is_none() && asked.is_none() && answered.is_none() {
                return None;
            }
            let (mut next, mut relit) = (None, None);
            // The network stays on this thread: it need not know of others.
            let answer = rayon::in_place_scope(|scope| {
                if let Some((asked, answer)) = answered {
                    let relit = &mut relit;
                    scope.spawn(move |_| *relit = Some(correction.shaded(prepared, asked, answer)));
                }
                if let Some(lamp) = lamp {
                    let next = &mut next;
                    scope.spawn(move |_| *next = Some(correction.asked(prepared, *lamp)));
                }
                let given = asked.as_ref().map(|asked| &asked.given)?;
                Some(answers(self.network, &[("lamp", given)], &wanted))
            });
            self.asked = next;
            match answer.transpose() {
                Ok(answer) => self.answered = asked.zip(answer),
                Err(error) => return Some(Err(error)),
            }
            if relit.is_some() {
                return relit.map(Ok);
            }
        }
    }
}

/// What is known of a scene on the network's grid: depth as it is at the middle of each pixel, as its mean over
/// an edge is no surface, all else as means.
fn on_the_networks_grid(scene: &Scene) -> Scene {
    let size = GRID.within(scene.albedo.size());
    Scene {
        camera: scene.camera.scaled_to(size.0, size.1),
        depth_metres: nearest(&scene.depth_metres, size),
        depth_sigma_metres: nearest(&scene.depth_sigma_metres, size),
        thickness_metres: nearest(&scene.thickness_metres, size),
        normal: resampled(&scene.normal, size),
        albedo: resampled(&scene.albedo, size),
        roughness: resampled(&scene.roughness, size),
        confidence: resampled(&scene.confidence, size),
        scale_known: scene.scale_known,
        flash_lit: scene.flash_lit,
        material: scene.material,
        shine: scene.shine.clone(),
    }
}
