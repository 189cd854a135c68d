//! One point that light comes from: so far away that its rays are parallel, or near.

use super::lamp::{Lamp, LampError};
use glam::Vec3;

/// The least distance that light falls off over, metres: no lamp is smaller than this.
const LEAST_METRES: f32 = 0.01;
/// The furthest a near lamp may stand, metres; further ones are distant.
const MOST_METRES: f32 = 1e5;

/// Where the light of an [`Emitter`] comes from; camera axes (x right, y down, z forward).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// The unit vector toward a lamp whose rays are parallel.
    Distant(Vec3),
    /// Where a lamp stands, in metres from the color camera's lens.
    Near(Vec3),
}

/// Light from one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Emitter {
    /// Where it comes from.
    pub origin: Origin,
    /// Which way a lamp shines that is not as bright all around: a unit vector in camera axes, away from
    /// which its light falls with the cosine and behind which there is none. Of near lamps only.
    pub facing: Option<Vec3>,
    /// Linear red, green, blue; ≥ 0. What a white Lambertian shows that faces a distant lamp, or a near
    /// one at one metre: a near lamp's light falls with the square of the distance.
    pub color: [f32; 3],
}

impl From<&Lamp> for Emitter {
    fn from(lamp: &Lamp) -> Self {
        Self {
            origin: Origin::Distant(lamp.toward()),
            facing: None,
            color: lamp.color,
        }
    }
}

impl From<&Emitter> for Emitter {
    fn from(lamp: &Emitter) -> Self {
        *lamp
    }
}

impl Emitter {
    /// A white near lamp at a position as people give it: metres from the color camera's lens, x right, y
    /// up, z toward the camera, so that what the camera sees has negative z.
    ///
    /// # Errors
    /// [`LampError`] for a position that is not finite or further than a near lamp may stand.
    pub fn at_person(position: [f32; 3]) -> Result<Self, LampError> {
        let origin = Origin::Near(near_from_person(position)?);
        Ok(Self {
            origin,
            facing: None,
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

    /// The same lamp, of color 1.
    pub fn white(self) -> Self {
        Self {
            color: [1.0; 3],
            ..self
        }
    }

    /// Unit vector toward the lamp from `point`, and what a white Lambertian there that faces a lamp of
    /// color 1 shows; both in camera axes and metres.
    pub fn seen_from(&self, point: Vec3) -> (Vec3, f32) {
        match self.origin {
            Origin::Distant(toward) => (toward, 1.0),
            Origin::Near(position) => {
                let way = position - point;
                let squared = way.length_squared().max(LEAST_METRES * LEAST_METRES);
                let toward = way / squared.sqrt();
                let turned = self.facing.map_or(1.0, |facing| -facing.dot(toward));
                (toward, turned.max(0.0) / squared)
            }
        }
    }

    /// The place or direction as people give it: x right, y up, z toward the camera.
    pub fn person_origin(&self) -> [f32; 3] {
        let (Origin::Distant(v) | Origin::Near(v)) = self.origin;
        [v.x, -v.y, -v.z]
    }
}

/// A place in metres as people give it (x right, y up, z toward the camera), in camera axes.
pub(super) fn near_from_person([x, y, z]: [f32; 3]) -> Result<Vec3, LampError> {
    let position = Vec3::new(x, -y, -z);
    if position.is_finite() && position.length() <= MOST_METRES {
        Ok(position)
    } else {
        Err(LampError::Position([x, y, z]))
    }
}

/// The square of the least distance that light falls off over.
pub(super) const LEAST_SQUARE: f32 = LEAST_METRES * LEAST_METRES;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_falls_with_the_square_of_the_distance_and_the_cosine_of_a_panel() {
        let lamp = Emitter::at_person([0.0, 2.0, -1.0]).unwrap();
        let (toward, light) = lamp.seen_from(Vec3::new(0.0, 0.0, 1.0));
        // Straight up is −y.
        assert_eq!((toward, light), (Vec3::NEG_Y, 0.25));
        let panel = Emitter {
            facing: Some(Vec3::new(0.0, 0.5, 0.75f32.sqrt())),
            ..lamp
        };
        let (_, light) = panel.seen_from(Vec3::new(0.0, 0.0, 1.0));
        assert!((light - 0.125).abs() < 1e-6);
        let (_, light) = panel.seen_from(Vec3::new(0.0, -4.0, 1.0));
        assert_eq!(light, 0.0, "behind a panel it is dark");
    }

    #[test]
    fn positions_that_are_nowhere_are_refused() {
        for position in [
            [f32::NAN, 0.0, 0.0],
            [0.0, f32::INFINITY, 0.0],
            [1e6, 0.0, 0.0],
        ] {
            let refused = Emitter::at_person(position);
            assert!(
                matches!(refused, Err(LampError::Position(_))),
                "{position:?}"
            );
        }
        assert!(
            Emitter::at_person([0.0; 3]).is_ok(),
            "the flash's own place"
        );
    }
}
