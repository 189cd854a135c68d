//! Lamps of every kind that people set up: distant, near, and so large that their shadows are soft.

use super::{
    Found, Prepared, RelightOptions, Relit,
    emitter::{Emitter, near_from_person},
    lamp::{Lamp, LampError},
    light_set::{MARGIN, NORMAL_95, display::Display},
    prepared::Indirect,
};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_PI_4;

/// A large lamp is seen by so many pixels, nearly, when it is decided how many small ones stand for it.
const PIXELS: usize = 16_384;
/// Small lamps along a side of the large one: those tried, and those that the picture is held against.
const SIDES: [usize; 9] = [1, 2, 3, 4, 5, 6, 7, 8, 10];
const REFERENCE_SIDE: usize = 14;

/// A lamp that somebody set up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Luminaire {
    /// So far away that its rays are parallel.
    Distant(Lamp),
    /// A point near to the scene.
    Near(Emitter),
    /// A shape near to the scene.
    Area(AreaLamp),
}

/// A lamp that is not a point. Its color is the sum over all of it: seen from far away it is a near lamp
/// of that color.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AreaLamp {
    middle: Vec3,
    shape: Shape,
    color: [f32; 3],
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Shape {
    /// As bright all around.
    Ball { radius: f32 },
    /// Halves of its edges, and the unit vector it faces.
    Panel {
        across: Vec3,
        down: Vec3,
        facing: Vec3,
    },
}

impl AreaLamp {
    /// A glowing ball of a radius in metres at a position as people give it: metres from the color
    /// camera's lens, x right, y up, z toward the camera.
    ///
    /// # Errors
    /// [`LampError`] for a position or a radius that means nothing.
    pub fn ball(position: [f32; 3], radius: f32) -> Result<Self, LampError> {
        Ok(Self {
            middle: near_from_person(position)?,
            shape: Shape::Ball {
                radius: extent(radius)?,
            },
            color: [1.0; 3],
        })
    }

    /// A panel of a width and a height in metres with its middle at a position, turned to the point
    /// `toward`; both as in [`Self::ball`]. Its upper edge is level. It shines to that side alone, less
    /// to its sides by the cosine.
    ///
    /// # Errors
    /// [`LampError`] for positions or a size that mean nothing.
    pub fn panel(position: [f32; 3], size: [f32; 2], toward: [f32; 3]) -> Result<Self, LampError> {
        let middle = near_from_person(position)?;
        let way = near_from_person(toward)? - middle;
        let facing = way.try_normalize().ok_or(LampError::Toward)?;
        let level = facing.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
        let [width, height] = size;
        Ok(Self {
            middle,
            shape: Shape::Panel {
                across: 0.5 * extent(width)? * level,
                down: 0.5 * extent(height)? * facing.cross(level),
                facing,
            },
            color: [1.0; 3],
        })
    }

    /// The same lamp in another color.
    ///
    /// # Errors
    /// [`LampError::Color`] for negative or non-finite light.
    pub fn with_color(self, color: [f32; 3]) -> Result<Self, LampError> {
        if color.iter().all(|value| value.is_finite() && *value >= 0.0) {
            Ok(Self { color, ..self })
        } else {
            Err(LampError::Color(color))
        }
    }

    /// `side` × `side` small lamps that stand for it, spread evenly over what is seen of it from `point`
    /// (camera axes, metres); together they have its color.
    pub fn emitters(&self, side: usize, point: Vec3) -> Vec<Emitter> {
        let toward = (self.middle - point).try_normalize().unwrap_or(Vec3::NEG_Z);
        let share = 1.0 / (side * side).max(1) as f32;
        let middles = (0..side * side).map(|cell| {
            let at = Vec2::new((cell % side) as f32 + 0.5, (cell / side) as f32 + 0.5);
            at * 2.0 / side as f32 - 1.0
        });
        let (facing, color) = (self.facing(), self.color.map(|value| value * share));
        let at = |at: Vec2| match self.shape {
            Shape::Panel { across, down, .. } => at.x * across + at.y * down,
            Shape::Ball { radius } => {
                let (across, down) = toward.any_orthonormal_pair();
                let at = radius * on_disk(at);
                at.x * across + at.y * down
            }
        };
        let emitter = |place: Vec2| Emitter {
            origin: super::Origin::Near(self.middle + at(place)),
            facing,
            color,
        };
        middles.map(emitter).collect()
    }

    fn facing(&self) -> Option<Vec3> {
        match self.shape {
            Shape::Ball { .. } => None,
            Shape::Panel { facing, .. } => Some(facing),
        }
    }
}

/// From a square to a disk, both of half-width 1, keeping areas (Shirley & Chiu 1997).
fn on_disk(at: Vec2) -> Vec2 {
    let (radius, angle) = if at.x.abs() > at.y.abs() {
        (at.x, FRAC_PI_4 * at.y / at.x)
    } else if at.y != 0.0 {
        (at.y, FRAC_PI_4 * (2.0 - at.x / at.y))
    } else {
        return Vec2::ZERO;
    };
    radius * Vec2::from_angle(angle)
}

/// An extent of a lamp, if it has one.
fn extent(metres: f32) -> Result<f32, LampError> {
    if (1e-4..=1e3).contains(&metres) {
        Ok(metres)
    } else {
        Err(LampError::Extent(metres))
    }
}

impl Luminaire {
    /// True for a distant lamp behind the scene: it can light only what is turned away from the camera.
    pub fn is_behind(&self) -> bool {
        matches!(self, Self::Distant(lamp) if lamp.is_behind())
    }

    /// The direction of a distant lamp, or the place of a near one's middle in metres, as people give
    /// them: x right, y up, z toward the camera.
    pub fn person_origin(&self) -> [f32; 3] {
        match self {
            Self::Distant(lamp) => lamp.person_direction(),
            Self::Near(lamp) => lamp.person_origin(),
            Self::Area(lamp) => [lamp.middle.x, -lamp.middle.y, -lamp.middle.z],
        }
    }
}

impl Prepared {
    /// The fewest small lamps, `side` × `side` of them, under which the picture is that of the large one
    /// within its noise: as that of many more, on a small copy of the scene.
    ///
    /// `relative_noise` as in [`Self::light_set`].
    pub fn area_set(
        &self,
        lamp: &AreaLamp,
        relative_noise: &dyn Fn(usize, usize) -> f32,
    ) -> (Vec<Emitter>, Found) {
        let (small, factor) = self.reduced(PIXELS);
        let middle = self.surfaces.middle();
        let options = RelightOptions {
            indirect: Indirect::None,
            ..RelightOptions::default()
        };
        let seen = |side: usize| {
            let mut sum = vec![[0.0f32; 3]; small.width * small.height];
            for emitter in lamp.emitters(side, middle) {
                let lit = small.relight(emitter, options).light.0;
                for (sum, lit) in sum.iter_mut().zip(lit.samples()) {
                    *sum = std::array::from_fn(|c| sum[c] + lit[c]);
                }
            }
            sum
        };
        let whole = seen(REFERENCE_SIDE);
        let known: Vec<usize> = (0..whole.len())
            .filter(|&at| whole[at][0].is_finite())
            .collect();
        let light: Vec<[f32; 3]> = known.iter().map(|&at| whole[at]).collect();
        let noise = known.iter().map(|at| {
            let (x, y) = (at % small.width, at / small.width);
            let middle = (factor - 1) / 2;
            let at = |index: usize, size: usize| (factor * index + middle).min(size - 1);
            relative_noise(at(x, self.width), at(y, self.height))
        });
        let display = Display::new(&light, &vec![1.0; light.len()], noise);
        let mut found = Found {
            lights: 0,
            of: REFERENCE_SIDE * REFERENCE_SIDE,
            rms_change: 0.0,
            change_95: 0.0,
            noise: display.noise,
            capped: true,
        };
        for side in SIDES {
            let few = seen(side);
            let change: Vec<[f32; 3]> = known
                .iter()
                .map(|&at| std::array::from_fn(|c| few[at][c] - whole[at][c]))
                .collect();
            found.lights = side * side;
            found.rms_change = display.root_mean_square(&change);
            found.change_95 = display.quantile_95(&change);
            let enough = MARGIN * display.noise;
            if found.rms_change <= enough && found.change_95 <= NORMAL_95 * enough {
                found.capped = false;
                break;
            }
        }
        let side = found.lights.isqrt();
        (lamp.emitters(side, middle), found)
    }
}

/// The sum of answers of one size, each the scene under a light: light is added, shadow averaged. `None`
/// of none.
///
/// # Errors
/// The first of them.
pub fn summed<E>(answers: impl IntoIterator<Item = Result<Relit, E>>) -> Result<Option<Relit>, E> {
    let mut answers = answers.into_iter();
    let Some(mut sum) = answers.next().transpose()? else {
        return Ok(None);
    };
    let mut count = 1.0;
    for next in answers {
        let next = next?;
        count += 1.0;
        let pixels = sum.light.0.samples_mut().iter_mut();
        for (sum, pixel) in pixels.zip(next.light.0.samples()) {
            *sum = std::array::from_fn(|c| sum[c] + pixel[c]);
        }
        let shades = sum.shadow.samples_mut().iter_mut();
        for (sum, value) in shades.zip(next.shadow.samples()) {
            *sum += value;
        }
        sum.unseen_path_fraction = sum.unseen_path_fraction.max(next.unseen_path_fraction);
    }
    if count > 1.0 {
        for share in sum.shadow.samples_mut() {
            *share /= count;
        }
    }
    Ok(Some(sum))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::relight::Origin;
    use proptest::prelude::*;

    fn position() -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3(-2.0f32..2.0)
    }

    proptest! {
        #[test]
        fn a_large_lamp_sends_as_much_light_however_many_small_ones_stand_for_it(
            place in position(),
            toward in position(),
            size in prop::array::uniform2(0.01f32..1.0),
            side in 1usize..9,
        ) {
            prop_assume!(Vec3::from(place).distance(toward.into()) > 0.1);
            let panel = AreaLamp::panel(place, size, toward).unwrap();
            let ball = AreaLamp::ball(place, size[0]).unwrap();
            for lamp in [panel, ball] {
                let lamp = lamp.with_color([1.0, 2.0, 0.5]).unwrap();
                let small = lamp.emitters(side, Vec3::Z);
                prop_assert_eq!(small.len(), side * side);
                for (channel, wanted) in [1.0, 2.0, 0.5].into_iter().enumerate() {
                    let sum: f32 = small.iter().map(|one| one.color[channel]).sum();
                    prop_assert!((sum - wanted).abs() < 1e-4);
                }
                // They lie evenly around its middle, within it.
                let mut mean = Vec3::ZERO;
                for one in &small {
                    let Origin::Near(at) = one.origin else {
                        return Err(TestCaseError::fail("a large lamp is near"));
                    };
                    let away = at - lamp.middle;
                    prop_assert!(away.length() <= size[0].hypot(size[1]));
                    mean += away / small.len() as f32;
                }
                prop_assert!(mean.length() < 1e-4);
            }
        }
    }

    #[test]
    fn lamps_without_an_extent_or_a_side_are_refused() {
        let place = [0.0, 1.0, -1.0];
        for radius in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(matches!(
                AreaLamp::ball(place, radius),
                Err(LampError::Extent(_))
            ));
        }
        let turned = AreaLamp::panel(place, [1.0, 1.0], place);
        assert_eq!(turned, Err(LampError::Toward));
        // Straight down: no edge is more level than another.
        assert!(AreaLamp::panel(place, [1.0, 1.0], [0.0, 0.0, -1.0]).is_ok());
    }
}
