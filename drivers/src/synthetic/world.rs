//! A world with known truth: what every ray meets, and how bright it is under any light.

use super::{
    Options,
    layout::{Body, bodies},
    material::karis,
};
use crate::{
    calibration::{DepthCamera, Distortion, FlashLamp, Intrinsics, Rig, RigidTransform},
    plane::Plane,
};
use glam::{DMat3, DVec2, DVec3, Vec3};
use std::f64::consts::PI;

/// Light of the flash on a white Lambertian patch facing it at one metre, at unit exposure.
pub const FLASH_INTENSITY: f32 = 45.0;
/// Toward the room's lamp, camera axes before normalisation: from the upper right, behind the camera.
const ROOM_LAMP: DVec3 = DVec3::new(0.5, -0.8, -0.6);
/// Room light at `ambient=1`, unit exposure: its lamp and what comes from everywhere.
const ROOM_DIRECT: f64 = 6.0;
const ROOM_CONSTANT: f64 = 2.0;
/// Infrared amplitude of a white patch facing the ToF camera at one metre, in device units.
const TOF_AMPLITUDE: f64 = 1000.0;
/// Below this amplitude the ToF camera gives no answer.
const TOF_WEAKEST: f64 = 15.0;
/// Away from a surface before asking whether something is in the way, metres.
const LIFT: f64 = 1e-6;

/// What a pixel sees.
#[derive(Debug, Clone, Copy)]
struct Surface {
    point: DVec3,
    normal: DVec3,
    view: DVec3,
    albedo: [f32; 3],
    roughness: f32,
    infrared: f32,
}

/// The truth about what the color camera sees; planes lie on its grid, NaN = nothing there.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Distance along z, metres.
    pub depth_metres: Plane<f32>,
    /// Unit normals in camera axes (x right, y down, z forward), facing the camera.
    pub normal: Plane<Vec3>,
    /// Diffuse albedo, linear.
    pub albedo: Plane<[f32; 3]>,
    /// Karis roughness in (0, 1].
    pub roughness: Plane<f32>,
}

/// The world under one light of unit strength, distant or near.
#[derive(Debug, Clone, PartialEq)]
pub struct Relit {
    /// Scene-linear light; a white Lambertian facing the lamp = 1, for a near one at one metre.
    pub light: Plane<[f32; 3]>,
    /// 1 = lit, 0 = in shadow, cast or attached.
    pub shadow: Plane<f32>,
}

/// Perfect measurements of the ToF camera, on its grid, in its axes; NaN = no answer.
#[derive(Debug, Clone)]
pub(super) struct TimeOfFlight {
    pub metres: Plane<f32>,
    pub amplitude: Plane<f32>,
    pub sigma: Plane<f32>,
}

/// A layout, its lights and its rig.
#[derive(Debug, Clone)]
pub struct World {
    bodies: Vec<Body>,
    rig: Rig,
    ambient: f64,
}

impl World {
    /// The world that a synthetic device with these options photographs.
    pub fn new(options: &Options) -> Self {
        let size = (options.width, options.height);
        let color = Intrinsics::pinhole(size, options.width as f64);
        // A wider lens than the color camera's, bent like a small ToF module's.
        let bent = Distortion::BrownConrady {
            k1: -0.12,
            k2: 0.03,
            p1: 4e-4,
            p2: -3e-4,
            k3: 0.0,
        };
        let (width, height) = (options.depth_width, options.depth_width * 3 / 4);
        let depth = DepthCamera {
            lens: Intrinsics {
                distortion: bent,
                ..Intrinsics::pinhole((width, height), 0.8 * width as f64)
            },
            to_color: RigidTransform {
                rotation: DMat3::from_rotation_y(-0.015) * DMat3::from_rotation_x(0.008),
                translation_metres: DVec3::new(0.03, -0.004, 0.002),
            },
        };
        let flash = FlashLamp {
            position_metres: DVec3::new(-0.012, -0.006, 0.0),
            intensity: Some(FLASH_INTENSITY),
            beam: crate::calibration::Beam::default(),
        };
        Self {
            bodies: bodies(options.layout, options.seed),
            rig: Rig {
                color,
                depth: Some(depth),
                flash,
            },
            ambient: f64::from(options.ambient),
        }
    }

    /// Its geometry.
    pub fn rig(&self) -> Rig {
        self.rig
    }

    fn nearest(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3, &Body)> {
        self.bodies
            .iter()
            .filter_map(|body| body.shape.hit(origin, direction).map(|(t, n)| (t, n, body)))
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// True when nothing stands between `point` and `distance` metres `toward` a light.
    fn clear(&self, surface: &Surface, toward: DVec3, distance: f64) -> bool {
        let origin = surface.point + surface.normal * LIFT;
        !self.bodies.iter().any(|body| {
            body.shape
                .hit(origin, toward)
                .is_some_and(|(t, _)| t < distance)
        })
    }

    /// What the ray through `origin` along `ray` (any length) meets.
    fn surface(&self, origin: DVec3, ray: DVec3) -> Option<Surface> {
        let direction = ray.normalize();
        let (t, normal, body) = self.nearest(origin, direction)?;
        let point = origin + t * direction;
        let place = body.placement.axes.transpose() * (point - body.placement.anchor);
        Some(Surface {
            point,
            normal,
            view: -direction,
            albedo: body.material.albedo(place),
            roughness: body.material.roughness,
            infrared: body.material.infrared,
        })
    }

    /// Asks `answer` about what each pixel of the color camera sees; `nothing` where it sees nothing.
    fn seen<T: Copy + Send + Sync>(
        &self,
        nothing: T,
        answer: impl Fn(&Surface) -> T + Sync,
    ) -> Plane<T> {
        let lens = &self.rig.color;
        Plane::from_fn(lens.width, lens.height, |x, y| {
            lens.ray(DVec2::new(x as f64, y as f64))
                .and_then(|ray| self.surface(DVec3::ZERO, ray))
                .map_or(nothing, |surface| answer(&surface))
        })
    }

    /// Geometry and material on the color grid.
    pub fn truth(&self) -> Truth {
        Truth {
            depth_metres: self.seen(f32::NAN, |s| s.point.z as f32),
            normal: self.seen(Vec3::NAN, |s| s.normal.as_vec3()),
            albedo: self.seen([f32::NAN; 3], |s| s.albedo),
            roughness: self.seen(f32::NAN, |s| s.roughness),
        }
    }

    /// The world under a directional light alone. `direction` points toward the light; x right,
    /// y up, z toward the camera; any length.
    pub fn relit(&self, direction: Vec3) -> Relit {
        let toward = DVec3::new(
            direction.x.into(),
            -f64::from(direction.y),
            -f64::from(direction.z),
        );
        let toward = toward.normalize_or(DVec3::NEG_Z);
        Relit {
            light: self.seen([f32::NAN; 3], |s| {
                self.direct(s, toward, 1.0, f64::INFINITY)
            }),
            shadow: self.seen(f32::NAN, |s| {
                let lit = s.normal.dot(toward) > 0.0 && self.clear(s, toward, f64::INFINITY);
                f32::from(u8::from(lit))
            }),
        }
    }

    /// The world under a near lamp alone, as strong as to light a white patch that faces it at one
    /// metre with 1. `place` in metres from the lens; x right, y up, z toward the camera.
    pub fn relit_near(&self, place: Vec3) -> Relit {
        let place = DVec3::new(place.x.into(), -f64::from(place.y), -f64::from(place.z));
        let way = |s: &Surface| {
            let way = place - s.point;
            (way.normalize(), way.length())
        };
        Relit {
            light: self.seen([f32::NAN; 3], |s| {
                let (toward, distance) = way(s);
                self.direct(s, toward, 1.0 / (distance * distance), distance)
            }),
            shadow: self.seen(f32::NAN, |s| {
                let (toward, distance) = way(s);
                let lit = s.normal.dot(toward) > 0.0 && self.clear(s, toward, distance);
                f32::from(u8::from(lit))
            }),
        }
    }

    /// The light of the flash alone on the color grid, unit exposure, without noise.
    pub fn flash_light(&self) -> Plane<[f32; 3]> {
        self.seen([0.0; 3], |s| {
            let toward = self.rig.flash.position_metres - s.point;
            let distance = toward.length();
            let strength = f64::from(FLASH_INTENSITY) / (distance * distance);
            self.direct(s, toward / distance, strength, distance)
        })
    }

    /// The room's light alone on the color grid, unit exposure, mean over the mains period.
    pub fn room_light(&self) -> Plane<[f32; 3]> {
        let toward = ROOM_LAMP.normalize();
        self.seen([0.0; 3], |s| {
            let direct = self.direct(s, toward, self.ambient * ROOM_DIRECT, f64::INFINITY);
            let constant = (self.ambient * ROOM_CONSTANT) as f32;
            std::array::from_fn(|c| direct[c] + s.albedo[c] * constant)
        })
    }

    /// `strength · (albedo + π f) · (n·l)`, or nothing in shadow.
    fn direct(&self, s: &Surface, toward: DVec3, strength: f64, distance: f64) -> [f32; 3] {
        let cosine = s.normal.dot(toward);
        if cosine <= 0.0 || !self.clear(s, toward, distance) {
            return [0.0; 3];
        }
        let gloss = PI * karis(s.normal, s.view, toward, s.roughness.into());
        s.albedo
            .map(|albedo| (strength * cosine * (f64::from(albedo) + gloss)) as f32)
    }

    pub(super) fn time_of_flight(&self) -> TimeOfFlight {
        let (lens, to_color) = match self.rig.depth {
            Some(depth) => (depth.lens, depth.to_color),
            None => (self.rig.color, RigidTransform::IDENTITY),
        };
        // z in the ToF camera's axes, and the infrared that comes back.
        let seen = Plane::from_fn(lens.width, lens.height, |x, y| {
            let ray = lens.ray(DVec2::new(x as f64, y as f64))?;
            let eye = to_color.translation_metres;
            let surface = self.surface(eye, to_color.rotation * ray)?;
            let distance = surface.point.distance(eye);
            let facing = surface.normal.dot(surface.view).max(0.0);
            let amplitude =
                TOF_AMPLITUDE * f64::from(surface.infrared) * facing / (distance * distance);
            (amplitude >= TOF_WEAKEST).then(|| (distance / ray.length(), amplitude))
        });
        TimeOfFlight {
            metres: seen.map(|s| s.map_or(f32::NAN, |(z, _)| z as f32)),
            amplitude: seen.map(|s| s.map_or(0.0, |(_, amplitude)| amplitude as f32)),
            // A floor, and a part that grows as the light gets weak (Lange & Seitz 2001).
            sigma: seen.map(|s| s.map_or(f32::NAN, |(_, a)| (0.0008 + 0.5 / a) as f32)),
        }
    }
}
