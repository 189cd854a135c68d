//! The three worlds: a desk, a matte wall, a glossy statue. All lie in view of a camera at the
//! origin that looks along +z with a field of about 53° × 42°.

use super::{
    material::{Material, Pattern, Placement},
    shape::Shape,
};
use crate::chance::Chance;
use glam::{DMat3, DVec3};

/// Which world is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// A table before a wall: a glossy ball, a box, a thin rod, a small ball.
    Desk,
    /// A nearly flat, wholly matte wall with a shelf, a picture, a half ball and a leaning rod.
    Wall,
    /// A glossy figure of balls and limbs on a pedestal before a far wall.
    Statue,
}

impl Layout {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Desk, Self::Wall, Self::Statue];

    /// Its name in addresses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Desk => "desk",
            Self::Wall => "wall",
            Self::Statue => "statue",
        }
    }
}

/// A solid and what it is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    pub shape: Shape,
    pub material: Material,
    pub placement: Placement,
}

/// The solids of a world; the seed moves them a little and changes their colors.
pub(super) fn bodies(layout: Layout, seed: u64) -> Vec<Body> {
    let builder = Builder {
        chance: Chance::new(seed),
        bodies: Vec::new(),
    };
    match layout {
        Layout::Desk => builder.desk(),
        Layout::Wall => builder.wall(),
        Layout::Statue => builder.statue(),
    }
}

/// A level surface: where it is, and its axes right, up and away as columns.
#[derive(Clone, Copy)]
struct Ground {
    origin: DVec3,
    axes: DMat3,
}

impl Ground {
    /// Seen from above at `pitch` radians.
    fn tilted(origin: DVec3, pitch: f64) -> Self {
        let (sin, cos) = pitch.sin_cos();
        let axes = DMat3::from_cols(
            DVec3::X,
            DVec3::new(0.0, -cos, -sin),
            DVec3::new(0.0, -sin, cos),
        );
        Self { origin, axes }
    }

    fn at(&self, right: f64, up: f64, away: f64) -> DVec3 {
        self.origin + self.axes * DVec3::new(right, up, away)
    }

    /// Its axes turned about its vertical.
    fn turned(&self, angle: f64) -> DMat3 {
        self.axes * DMat3::from_rotation_y(angle)
    }
}

/// Normal of a far wall. It faces the camera, not the table, so that no light in front of the camera
/// is behind it.
const BACKDROP: DVec3 = DVec3::new(0.0, 0.03, -1.0);
const MATTE: f32 = 0.9;
const GLOSSY: f32 = 0.3;

struct Builder {
    chance: Chance,
    bodies: Vec<Body>,
}

impl Builder {
    /// A number of its own within ±`reach`, for the `key`-th choice.
    fn wobble(&self, key: u64, reach: f64) -> f64 {
        (self.chance.of(1).unit(key) * 2.0 - 1.0) * reach
    }

    /// A color of its own: `base` with each channel up to a fifth darker.
    fn tint(&self, key: u64, base: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            base[c] * (1.0 - 0.2 * self.chance.of(2 + c as u64).unit(key) as f32)
        })
    }

    fn add(&mut self, shape: Shape, axes: DMat3, pattern: Pattern, roughness: f32) {
        let anchor = match shape {
            Shape::Plane { point, .. } => point,
            Shape::Sphere { centre, .. } | Shape::Box { centre, .. } => centre,
            Shape::Capsule { from, .. } => from,
        };
        let infrared = match pattern {
            Pattern::Plain(c) | Pattern::Checker(c, ..) | Pattern::Stripes(c, ..) => {
                0.3 + 0.5 * (c[0] + c[1] + c[2]) / 3.0
            }
        };
        let material = Material {
            pattern,
            roughness,
            infrared,
        };
        self.bodies.push(Body {
            shape,
            material,
            placement: Placement { anchor, axes },
        });
    }

    fn plane(&mut self, point: DVec3, normal: DVec3, pattern: Pattern) {
        let right = DVec3::Y.cross(normal).normalize();
        let axes = DMat3::from_cols(right, normal.cross(right), normal);
        self.add(Shape::Plane { point, normal }, axes, pattern, MATTE);
    }

    fn desk(mut self) -> Vec<Body> {
        let ground = Ground::tilted(DVec3::new(0.0, 0.2, 1.15), 0.42);
        let wood = Pattern::Stripes(
            self.tint(0, [0.62, 0.45, 0.3]),
            self.tint(1, [0.5, 0.35, 0.22]),
            0.06,
        );
        let table = Shape::Box {
            centre: ground.at(0.0, -0.02, 0.0),
            half: DVec3::new(0.75, 0.02, 0.42),
            axes: ground.axes,
        };
        self.add(table, ground.axes, wood, 0.6);
        let paint = Pattern::Checker(
            self.tint(2, [0.7, 0.7, 0.68]),
            self.tint(3, [0.55, 0.6, 0.65]),
            0.16,
        );
        self.plane(DVec3::new(0.0, 0.0, 1.7), BACKDROP.normalize(), paint);
        let x = -0.22 + self.wobble(4, 0.03);
        let ball = Shape::Sphere {
            centre: ground.at(x, 0.12, 0.08),
            radius: 0.12,
        };
        let red = Pattern::Plain(self.tint(5, [0.75, 0.2, 0.16]));
        self.add(ball, ground.axes, red, GLOSSY);
        let axes = ground.turned(0.5 + self.wobble(6, 0.3));
        let half = DVec3::new(0.1, 0.09, 0.07);
        let block = Shape::Box {
            centre: ground.at(0.24, half.y, 0.02 + self.wobble(7, 0.03)),
            half,
            axes,
        };
        let check = Pattern::Checker(
            self.tint(8, [0.8, 0.8, 0.75]),
            self.tint(9, [0.2, 0.3, 0.55]),
            0.05,
        );
        self.add(block, axes, check, MATTE);
        let foot = self.wobble(10, 0.03);
        let rod = Shape::Capsule {
            from: ground.at(foot, 0.0, -0.12),
            to: ground.at(foot + 0.03, 0.3, -0.1),
            radius: 0.007,
        };
        self.add(rod, ground.axes, Pattern::Plain([0.7, 0.7, 0.7]), 0.5);
        let small = Shape::Sphere {
            centre: ground.at(0.05 + self.wobble(11, 0.02), 0.05, 0.2),
            radius: 0.05,
        };
        let green = Pattern::Plain(self.tint(12, [0.25, 0.6, 0.3]));
        self.add(small, ground.axes, green, MATTE);
        self.bodies
    }

    fn wall(mut self) -> Vec<Body> {
        let normal = DVec3::new(-0.1 + self.wobble(0, 0.05), -0.06, -1.0).normalize();
        let point = DVec3::new(0.0, 0.0, 1.25);
        let bricks = Pattern::Checker(
            self.tint(1, [0.68, 0.5, 0.42]),
            self.tint(2, [0.6, 0.58, 0.5]),
            0.12,
        );
        self.plane(point, normal, bricks);
        let axes = self.bodies[0].placement.axes;
        // Along the wall's own axes: right, up, out of it.
        let at = move |x: f64, y: f64, out: f64| point + axes * DVec3::new(x, y, out);
        let shelf = Shape::Box {
            centre: at(0.12, 0.12, 0.06),
            half: DVec3::new(0.22, 0.012, 0.06),
            axes,
        };
        let pale = Pattern::Plain(self.tint(3, [0.78, 0.76, 0.7]));
        self.add(shelf, axes, pale, MATTE);
        let picture = Shape::Box {
            centre: at(-0.28, -0.12 + self.wobble(4, 0.04), 0.012),
            half: DVec3::new(0.14, 0.1, 0.012),
            axes,
        };
        let print = Pattern::Stripes(
            self.tint(5, [0.25, 0.4, 0.65]),
            self.tint(6, [0.8, 0.75, 0.35]),
            0.04,
        );
        self.add(picture, axes, print, MATTE);
        let bump = Shape::Sphere {
            centre: at(0.2, -0.18, 0.0),
            radius: 0.1 + self.wobble(7, 0.02),
        };
        let plaster = Pattern::Plain(self.tint(8, [0.75, 0.72, 0.68]));
        self.add(bump, axes, plaster, MATTE);
        let rod = Shape::Capsule {
            from: at(-0.05, 0.5, 0.18),
            to: at(0.0, -0.25, 0.012),
            radius: 0.009,
        };
        let stick = Pattern::Plain(self.tint(9, [0.4, 0.3, 0.2]));
        self.add(rod, axes, stick, MATTE);
        self.bodies
    }

    fn statue(mut self) -> Vec<Body> {
        let ground = Ground::tilted(DVec3::new(0.0, 0.36, 1.1), 0.2);
        let stone = Pattern::Checker(
            self.tint(0, [0.5, 0.5, 0.52]),
            self.tint(1, [0.4, 0.4, 0.43]),
            0.2,
        );
        let floor = Shape::Box {
            centre: ground.at(0.0, -0.12, 0.1),
            half: DVec3::new(0.6, 0.02, 0.45),
            axes: ground.axes,
        };
        self.add(floor, ground.axes, stone, MATTE);
        let cloth = Pattern::Stripes(
            self.tint(2, [0.6, 0.55, 0.5]),
            self.tint(3, [0.52, 0.48, 0.46]),
            0.1,
        );
        self.plane(DVec3::new(0.0, 0.0, 1.75), BACKDROP.normalize(), cloth);
        let axes = ground.turned(self.wobble(4, 0.5));
        let pedestal = Shape::Box {
            centre: ground.at(0.0, -0.05, 0.0),
            half: DVec3::new(0.15, 0.05, 0.15),
            axes,
        };
        self.add(pedestal, axes, Pattern::Plain([0.45, 0.42, 0.4]), MATTE);
        let bronze = self.tint(5, [0.72, 0.55, 0.35]);
        let skin = Pattern::Plain(bronze);
        let turn = self.wobble(6, 0.02);
        let mut limb = |from: [f64; 3], to: [f64; 3], radius: f64| {
            let point = |p: [f64; 3]| ground.at(p[0], p[1], p[2]);
            let shape = Shape::Capsule {
                from: point(from),
                to: point(to),
                radius,
            };
            self.add(shape, ground.axes, skin, GLOSSY);
        };
        limb([-0.06, 0.04, 0.0], [-0.045, 0.2, 0.0], 0.042);
        limb([0.06, 0.04, 0.0], [0.045, 0.2, 0.0], 0.042);
        limb([0.0, 0.22, 0.0], [0.0, 0.36, -0.01], 0.08);
        limb([-0.09, 0.38, 0.0], [-0.22, 0.26, -0.08 + turn], 0.03);
        limb([0.09, 0.38, 0.0], [0.2, 0.52, -0.06], 0.03);
        // A lance: the thin thing.
        limb([0.22, 0.0, -0.07], [0.19, 0.68, -0.05], 0.008);
        let mut ball = |p: [f64; 3], radius: f64| {
            let shape = Shape::Sphere {
                centre: ground.at(p[0], p[1], p[2]),
                radius,
            };
            self.add(shape, ground.axes, skin, GLOSSY);
        };
        ball([0.0, 0.51, -0.01], 0.07);
        ball([turn, 0.505, -0.085], 0.014);
        self.bodies
    }
}
