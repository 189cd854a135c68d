//! Geometry of a rig: lenses, where the depth camera sits, where the flash sits.
//!
//! Camera axes everywhere: x right, y down, z forward, metres.

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// How a lens bends rays, in OpenCV's coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "snake_case", deny_unknown_fields)]
#[expect(missing_docs, reason = "coefficient names are OpenCV's")]
pub enum Distortion {
    /// A pinhole.
    None {},
    /// Brown–Conrady (Brown 1966).
    BrownConrady {
        k1: f64,
        k2: f64,
        p1: f64,
        p2: f64,
        #[serde(default)]
        k3: f64,
    },
    /// The rational model with eight coefficients (Claus & Fitzgibbon 2005).
    Rational {
        k1: f64,
        k2: f64,
        p1: f64,
        p2: f64,
        k3: f64,
        k4: f64,
        k5: f64,
        k6: f64,
    },
}

impl Distortion {
    /// `[k1, k2, p1, p2, k3, k4, k5, k6]`; 0 where the model has no such coefficient.
    pub fn coefficients(&self) -> [f64; 8] {
        match *self {
            Self::None {} => [0.0; 8],
            Self::BrownConrady { k1, k2, p1, p2, k3 } => [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0],
            Self::Rational {
                k1,
                k2,
                p1,
                p2,
                k3,
                k4,
                k5,
                k6,
            } => [k1, k2, p1, p2, k3, k4, k5, k6],
        }
    }

    /// Bends a ideal image point (x/z, y/z) to where the lens puts it.
    pub fn distort(&self, ideal: DVec2) -> DVec2 {
        if matches!(self, Self::None {}) {
            return ideal;
        }
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.coefficients();
        let DVec2 { x, y } = ideal;
        let r2 = x * x + y * y;
        let radial =
            (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        DVec2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// Change of [`Self::distort`] with x and with y.
    fn slopes(&self, DVec2 { x, y }: DVec2) -> [DVec2; 2] {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.coefficients();
        let r2 = x * x + y * y;
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let radial = above / below;
        // Of the radial factor, with r².
        let growth = (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
            - radial * (k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6)))
            / below;
        let across = 2.0 * (x * y * growth + p1 * x + p2 * y);
        [
            DVec2::new(
                radial + 2.0 * x * x * growth + 2.0 * p1 * y + 6.0 * p2 * x,
                across,
            ),
            DVec2::new(
                across,
                radial + 2.0 * y * y * growth + 6.0 * p1 * y + 2.0 * p2 * x,
            ),
        ]
    }

    /// Inverse of [`Self::distort`] by Newton's method; `None` where the model has no inverse
    /// (outside the lens's useful circle).
    pub fn undistort(&self, bent: DVec2) -> Option<DVec2> {
        if matches!(self, Self::None {}) {
            return Some(bent);
        }
        let mut ideal = bent;
        for _ in 0..30 {
            let error = self.distort(ideal) - bent;
            if error.length_squared() < 1e-20 {
                return Some(ideal);
            }
            let [dx, dy] = self.slopes(ideal);
            let determinant = dx.x * dy.y - dy.x * dx.y;
            // A fold of the model: beyond it two rays share one pixel.
            if determinant <= 1e-9 {
                return None;
            }
            ideal -= DVec2::new(
                (error.x * dy.y - dy.x * error.y) / determinant,
                (dx.x * error.y - error.x * dx.y) / determinant,
            );
        }
        None
    }
}

/// A camera's grid and lens, in pixels; the centre of the top-left pixel is (0, 0).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the pinhole's usual names")]
pub struct Intrinsics {
    pub width: usize,
    pub height: usize,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    pub distortion: Distortion,
}

impl Intrinsics {
    /// Pixel of a point in camera axes (metres); `None` behind the lens.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        if point.z <= 0.0 {
            return None;
        }
        let bent = self
            .distortion
            .distort(DVec2::new(point.x / point.z, point.y / point.z));
        Some(DVec2::new(
            self.fx * bent.x + self.cx,
            self.fy * bent.y + self.cy,
        ))
    }

    /// Ray (x/z, y/z, 1) through a pixel; `None` outside the lens model's useful circle.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        let bent = DVec2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        self.distortion
            .undistort(bent)
            .map(|ideal| ideal.extend(1.0))
    }

    /// A pinhole of a focal length in pixels, whose axis meets the middle of the picture.
    pub fn pinhole((width, height): (usize, usize), focal: f64) -> Self {
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: (width as f64 - 1.0) / 2.0,
            cy: (height as f64 - 1.0) / 2.0,
            distortion: Distortion::None {},
        }
    }

    /// `(width, height)`.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The same lens on a grid `factor` times as fine (pixel centres kept in place).
    #[must_use]
    pub fn scaled_to(&self, width: usize, height: usize) -> Self {
        let sx = width as f64 / self.width as f64;
        let sy = height as f64 / self.height as f64;
        Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: (self.cx + 0.5) * sx - 0.5,
            cy: (self.cy + 0.5) * sy - 0.5,
            distortion: self.distortion,
        }
    }
}

/// A rotation, then a shift: `there = rotation · here + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RigidTransform {
    /// Orthonormal, determinant +1.
    pub rotation: DMat3,
    /// Metres.
    pub translation_metres: DVec3,
}

impl RigidTransform {
    /// Leaves every point where it is.
    pub const IDENTITY: Self = Self {
        rotation: DMat3::IDENTITY,
        translation_metres: DVec3::ZERO,
    };

    /// Takes a point across.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation_metres
    }
}

/// The Time-of-Flight camera of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DepthCamera {
    /// Its lens.
    pub lens: Intrinsics,
    /// From depth-camera axes to color-camera axes.
    pub to_color: RigidTransform,
}

/// How a lamp's light changes with direction: `exp(tilt · u + falloff · |u|²)` for the slope
/// `u = (x/z, y/z)` of the way from the lamp, in the color camera's axes; 1 straight ahead.
///
/// What a lens darkens toward its corners is part of it when it was measured through that lens.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Beam {
    /// Growth to the right and down.
    pub tilt: [f64; 2],
    /// Growth outward; negative for a lamp that is brightest ahead.
    pub falloff: f64,
}

impl Beam {
    /// Slope beyond which a beam does not change any more: it was never measured out there.
    const REACH: f64 = 2.0;

    /// Whether every number lies in [−4, 4]: e⁴ at slope 1 is 5.8 stops.
    pub fn is_sound(&self) -> bool {
        let [right, down] = self.tilt;
        [right, down, self.falloff]
            .into_iter()
            .all(|value| value.abs() <= 4.0)
    }

    /// Light along a way from the lamp, relative to straight ahead.
    pub fn strength(&self, way: DVec3) -> f64 {
        let slope = way.truncate() / way.z.abs().max(f64::MIN_POSITIVE);
        let slope = slope.clamp_length_max(Self::REACH);
        (DVec2::from_array(self.tilt).dot(slope) + self.falloff * slope.length_squared()).exp()
    }
}

/// The flash of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FlashLamp {
    /// Where it sits in the color camera's axes, metres.
    pub position_metres: DVec3,
    /// Scene-linear light (unit exposure) of a white Lambertian patch facing the flash at one
    /// metre; `None` = unknown, and then albedo and relit light are right up to one global scale.
    pub intensity: Option<f32>,
    /// How its light changes with direction.
    #[serde(default)]
    pub beam: Beam,
}

/// Everything fixed about a rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// The color camera's lens; its axes are the rig's axes.
    pub color: Intrinsics,
    /// The depth camera; `None` = its frames already lie on the color grid.
    pub depth: Option<DepthCamera>,
    /// The flash.
    pub flash: FlashLamp,
}

impl Rig {
    /// What is taken for a rig that nobody measured: every camera a pinhole 60° wide at one place, with the
    /// flash at the lens, of unknown intensity. Sizes are `(width, height)`.
    pub fn assumed(color: (usize, usize), depth: Option<(usize, usize)>) -> Self {
        let lens = |size: (usize, usize)| {
            Intrinsics::pinhole(size, size.0 as f64 / 2.0 / 30f64.to_radians().tan())
        };
        Self {
            color: lens(color),
            depth: depth.map(|size| DepthCamera {
                lens: lens(size),
                to_color: RigidTransform::IDENTITY,
            }),
            flash: FlashLamp {
                position_metres: DVec3::ZERO,
                intensity: None,
                beam: Beam::default(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slopes_of_a_bent_lens_are_what_nearby_points_differ_by() {
        const STEP: f64 = 1e-6;
        let lens = Distortion::Rational {
            k1: 0.4,
            k2: -0.3,
            p1: 1e-3,
            p2: -2e-3,
            k3: 0.05,
            k4: 0.7,
            k5: -0.2,
            k6: 0.1,
        };
        for point in [DVec2::ZERO, DVec2::new(0.3, -0.2), DVec2::new(-0.7, 0.5)] {
            let found = lens.slopes(point);
            for (slope, along) in found.into_iter().zip([DVec2::X, DVec2::Y]) {
                let apart = lens.distort(point + STEP * along) - lens.distort(point - STEP * along);
                assert!((slope - apart / (2.0 * STEP)).length() < 1e-7, "{point}");
            }
        }
    }
}
