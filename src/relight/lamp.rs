//! Directional lamps, as people write them and as the camera sees them.

use glam::Vec3;
use thiserror::Error;

/// A lamp so far away that its rays are parallel.
///
/// A white Lambertian (albedo 1) that faces a lamp of color 1 has value 1.0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Unit vector toward the lamp in camera axes (x right, y down, z forward).
    toward: Vec3,
    /// Linear red, green, blue; ≥ 0.
    pub color: [f32; 3],
}

/// A direction no lamp can stand in.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LampError {
    /// NaN or infinity.
    #[error("light direction {0:?} is not finite; give three numbers x,y,z")]
    NotFinite([f32; 3]),
    /// No length.
    #[error(
        "light direction is 0,0,0; give where the light stands, e.g. 0,0,1 for the flash's own direction"
    )]
    Zero,
    /// A place that is not finite or too far away.
    #[error(
        "light position {0:?} must be finite and within 100 km; give metres from the camera's lens, or a direction for a light that is far away"
    )]
    Position([f32; 3]),
    /// A shape without a size.
    #[error("light of {0} m: a radius or an edge must be between 0.0001 and 1000 m")]
    Extent(f32),
    /// A panel turned to itself.
    #[error("light turned toward where it stands; give another point in `toward`")]
    Toward,
    /// Not one kind of light.
    #[error("{0}")]
    Kind(&'static str),
    /// A color that is negative or not finite.
    #[error("light color {0:?} must be finite and not negative")]
    Color([f32; 3]),
}

impl Lamp {
    /// A white lamp from a direction as people give it: x right, y up, z toward the camera,
    /// pointing toward the lamp; any length but zero.
    ///
    /// # Errors
    /// [`LampError`] for a direction without a direction.
    pub fn from_person(direction: [f32; 3]) -> Result<Self, LampError> {
        if !direction.iter().all(|value| value.is_finite()) {
            return Err(LampError::NotFinite(direction));
        }
        // Scaled first so that tiny and huge directions survive the squaring.
        let largest = direction
            .iter()
            .fold(0.0f32, |most, value| most.max(value.abs()));
        if largest == 0.0 {
            return Err(LampError::Zero);
        }
        let [x, y, z] = direction.map(|value| value / largest);
        Ok(Self {
            toward: Vec3::new(x, -y, -z).normalize(),
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
    pub fn white(&self) -> Self {
        Self {
            color: [1.0; 3],
            ..*self
        }
    }

    /// Unit vector toward the lamp in camera axes (x right, y down, z forward).
    pub fn toward(&self) -> Vec3 {
        self.toward
    }

    /// The direction as people give it: x right, y up, z toward the camera, unit length.
    pub fn person_direction(&self) -> [f32; 3] {
        [self.toward.x, -self.toward.y, -self.toward.z]
    }

    /// True for a lamp behind the scene: it can light only what is turned away from the camera.
    pub fn is_behind(&self) -> bool {
        self.toward.z >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_and_the_camera_mean_the_same_direction() {
        let lamp = Lamp::from_person([0.3, 0.4, 2.0]).unwrap();
        assert!(lamp.toward().y < 0.0 && lamp.toward().z < 0.0 && !lamp.is_behind());
        let back = Lamp::from_person(lamp.person_direction()).unwrap();
        assert!((back.toward() - lamp.toward()).length() < 1e-6);
    }

    #[test]
    fn directions_without_a_direction_are_refused() {
        assert_eq!(Lamp::from_person([0.0; 3]), Err(LampError::Zero));
        assert!(matches!(
            Lamp::from_person([f32::NAN, 0.0, 1.0]),
            Err(LampError::NotFinite(_))
        ));
        assert!(Lamp::from_person([1e-30, 0.0, 1e-30]).is_ok());
        assert!(Lamp::from_person([f32::MAX, 0.0, f32::MAX]).is_ok());
    }
}
