//! Whether the photograph is shaded as its own depth says, and as infrared is.

use super::{
    Finding,
    look::{Look, by_rows},
};
use drivers::Plane;
use glam::DVec2;
use rayon::prelude::*;

/// Only every so many rows and columns are looked at.
const EVERY: usize = 2;
/// Distance of the pixels compared, pixels at 256×256.
const APART_PIXELS: f32 = 4.0;
/// Steepest view, as a cosine.
const GRAZING: f32 = 0.2;
/// Depths of one surface differ by less, in natural logarithms.
const ONE_SURFACE: f32 = 0.06;
/// Light of one surface differs by less, in natural logarithms.
const ONE_COLOR: f32 = 0.5;
/// Shading that tells, in natural logarithms.
const TELLING: f32 = 0.03;
/// Departure of the light's logarithm from infrared's, as a factor, that does harm.
const HARMFUL_GAMMA: f32 = 0.12;
/// What the shading lacks of what depth says.
const HARMFUL_SHADING: f32 = 0.4;

/// How the light changes within surfaces.
pub(super) struct Shading {
    /// Slope of the light's logarithm over that of the shading that depth predicts; 1 = as it says.
    pub geometry: Slope,
    /// The same over infrared amplitude.
    pub infrared: Slope,
}

/// A slope through the origin, robust: sums of the absolute values and of the products of signs.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slope {
    along: f64,
    product: f64,
    back_along: f64,
    back: f64,
    pub count: usize,
}

impl Slope {
    fn add(&mut self, x: f32, y: f32) {
        self.along += f64::from(x.abs());
        self.product += f64::from(y * x.signum());
        self.back_along += f64::from(y.abs());
        self.back += f64::from(x * y.signum());
        self.count += 1;
    }

    fn merged(mut self, other: Self) -> Self {
        self.along += other.along;
        self.product += other.product;
        self.back_along += other.back_along;
        self.back += other.back;
        self.count += other.count;
        self
    }

    /// Of y over x; noise of x makes it too small.
    pub fn forward(&self) -> f32 {
        (self.product / self.along) as f32
    }

    /// Of y over x, told the other way; noise of y makes it too large.
    pub fn backward(&self) -> f32 {
        (self.back_along / self.back) as f32
    }
}

/// Logarithms at one pixel; NaN = unknown.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    light: f32,
    metres: f32,
    falloff: f32,
    amplitude: f32,
}

impl Shading {
    pub fn of(look: &Look<'_>) -> Self {
        let (width, height) = look.size();
        let size = (width.div_ceil(EVERY), height.div_ceil(EVERY));
        let points = by_rows(size, |x, y| point(look, EVERY * x, EVERY * y));
        let apart = APART_PIXELS * look.side() / (256 * EVERY) as f32;
        let apart = (apart.round() as usize).max(1);
        let (geometry, infrared) = (0..size.1)
            .into_par_iter()
            .with_min_len(16)
            .map(|y| row(&points, y, apart))
            .reduce(Default::default, |a, b| (a.0.merged(b.0), a.1.merged(b.1)));
        Self { geometry, infrared }
    }

    pub fn multipath(&self) -> Finding {
        let lacking = 1.0 - self.geometry.forward();
        Finding::new("multipath", lacking / HARMFUL_SHADING, None, || {
            "the flash's light does not fall on surfaces as depth shapes them: infrared reaches corners over other surfaces; keep bright walls out of the picture's sides or use a higher modulation frequency".into()
        })
    }

    pub fn wrong_transfer(&self) -> Finding {
        let slope = if self.infrared.count > 500 {
            self.infrared
        } else {
            self.geometry
        };
        let gamma = (slope.forward().max(0.0) * slope.backward()).sqrt();
        let off = gamma.ln().abs();
        Finding::new("wrong-transfer", off / HARMFUL_GAMMA, None, || {
            format!(
                "light changes {gamma:.2} times as much as it should: pixel values follow another curve than stated; measure it with `capturectl calibrate response`"
            )
        })
    }
}

fn point(look: &Look<'_>, x: usize, y: usize) -> Point {
    let scene = &look.development.scene;
    let at = (x * look.stride, y * look.stride);
    let z = scene.depth_metres[at];
    let falloff = if z > 0.0 {
        scene
            .camera
            .ray(DVec2::new(at.0 as f64, at.1 as f64))
            .map_or(f32::NAN, |ray| {
                let ray = ray.as_vec3();
                let length = ray.length();
                let cosine = -scene.normal[at].dot(ray) / length;
                if cosine > GRAZING {
                    (cosine / (z * length).powi(2)).ln()
                } else {
                    f32::NAN
                }
            })
    } else {
        f32::NAN
    };
    Point {
        light: look.light[(x, y)],
        metres: look.metres[(x, y)],
        falloff,
        amplitude: look
            .amplitude
            .as_ref()
            .map_or(f32::NAN, |plane| plane.at(x, y).ln()),
    }
}

fn row(points: &Plane<Point>, y: usize, apart: usize) -> (Slope, Slope) {
    let (mut geometry, mut infrared) = <(Slope, Slope)>::default();
    for (x, here) in points.row(y).iter().enumerate() {
        for there in [points.get(x + apart, y), points.get(x, y + apart)] {
            let Some(there) = there else {
                continue;
            };
            let light = there.light - here.light;
            let step = (there.metres / here.metres - 1.0).abs();
            // False for NaN.
            if !(light.abs() < ONE_COLOR && step < ONE_SURFACE) {
                continue;
            }
            let tells = |told: f32| told.abs() > TELLING && told.abs() < ONE_COLOR;
            let told = there.falloff - here.falloff;
            if tells(told) {
                geometry.add(told, light);
            }
            let told = there.amplitude - here.amplitude;
            if tells(told) {
                infrared.add(told, light);
            }
        }
    }
    (geometry, infrared)
}
