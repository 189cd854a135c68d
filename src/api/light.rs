//! Lights as people and scripts give them, and the checks every list of them passes.

use super::EnvironmentLight;
use crate::relight::{AreaLamp, Emitter, Environment, Lamp, LampError, Luminaire};
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use thiserror::Error;

/// A light: a distant one in a `direction`, or a near one at a `position`, there a point, a ball with a
/// `radius` or a panel of a `size`.
///
/// Directions and positions: x right, y up, z toward the camera; positions in metres from the color camera's
/// lens, so that what the camera sees has negative z.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Toward a distant light; any length but zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f32; 3]>,
    /// Where a near light stands, or the middle of a large one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[f32; 3]>,
    /// Of a glowing ball, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<f32>,
    /// Width and height of a panel, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[f32; 2]>,
    /// The point that a panel is turned to, metres; it shines to that side alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub toward: Option<[f32; 3]>,
    /// Linear red, green, blue; ≥ 0; `[1, 1, 1]` shows a white patch facing the light as 1.0, for a near
    /// light at one metre: it falls with the square of the distance.
    #[serde(default = "Light::white")]
    pub intensity: [f32; 3],
}

impl Light {
    const fn white() -> [f32; 3] {
        [1.0; 3]
    }

    const fn nowhere() -> Self {
        Self {
            direction: None,
            position: None,
            radius: None,
            size: None,
            toward: None,
            intensity: Self::white(),
        }
    }

    /// A white light from `direction`.
    pub const fn from_direction(direction: [f32; 3]) -> Self {
        Self {
            direction: Some(direction),
            ..Self::nowhere()
        }
    }

    /// A white light that is a point at `position`.
    pub const fn at(position: [f32; 3]) -> Self {
        Self {
            position: Some(position),
            ..Self::nowhere()
        }
    }
}

/// Why a light cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum LightError {
    #[error("light {text:?}: expected three numbers x,y,z (x right, y up, z toward the camera)")]
    Text { text: String },
    #[error("light {index}: {fault}")]
    Lamp { index: usize, fault: LampError },
    #[error(
        "no light given; add --light x,y,z (x right, y up, z toward the camera), --light-at x,y,z, --lights FILE or --environment MAP"
    )]
    None,
    #[error("environment {name:?}: {problem}")]
    Environment { name: String, problem: String },
    #[error("{found} lights given, at most {limit} are taken at once; ask in several goes")]
    TooMany { found: usize, limit: usize },
}

/// Reads `x,y,z`.
fn three_numbers(text: &str) -> Result<[f32; 3], LightError> {
    let refused = || LightError::Text {
        text: text.chars().take(80).collect(),
    };
    let numbers: Vec<f32> = text
        .split(',')
        .map(|number| number.trim().parse().map_err(|_| refused()))
        .collect::<Result<_, _>>()?;
    <[f32; 3]>::try_from(numbers).map_err(|_| refused())
}

impl FromStr for Light {
    type Err = LightError;

    /// Reads the direction `x,y,z`.
    fn from_str(text: &str) -> Result<Self, LightError> {
        three_numbers(text).map(Self::from_direction)
    }
}

impl Light {
    /// Reads the position `x,y,z`.
    ///
    /// # Errors
    /// [`LightError::Text`] for anything but three numbers.
    pub fn parse_position(text: &str) -> Result<Self, LightError> {
        three_numbers(text).map(Self::at)
    }

    /// The lamp it means, in the axes of the camera.
    ///
    /// # Errors
    /// [`LampError`] for places, sizes and intensities that mean nothing.
    pub fn luminaire(&self) -> Result<Luminaire, LampError> {
        let color = self.intensity;
        let position = match (self.direction, self.position) {
            (Some(_), None) => return Ok(Luminaire::Distant(self.distant()?)),
            (None, Some(position)) => position,
            _ => {
                return Err(LampError::Kind(
                    "a light has either a direction (distant) or a position (near)",
                ));
            }
        };
        let area = match (self.radius, self.size, self.toward) {
            (None, None, None) => {
                return Ok(Luminaire::Near(
                    Emitter::at_person(position)?.with_color(color)?,
                ));
            }
            (Some(radius), None, None) => AreaLamp::ball(position, radius)?,
            (None, Some(size), Some(toward)) => AreaLamp::panel(position, size, toward)?,
            _ => {
                return Err(LampError::Kind(
                    "a large light has either a radius (a ball), or a size and the point `toward` which it is turned (a panel)",
                ));
            }
        };
        Ok(Luminaire::Area(area.with_color(color)?))
    }

    /// The distant lamp it means.
    ///
    /// # Errors
    /// [`LampError`] for a near light, and for directions and intensities that mean nothing.
    pub fn distant(&self) -> Result<Lamp, LampError> {
        match self {
            Self {
                direction: Some(direction),
                position: None,
                radius: None,
                size: None,
                toward: None,
                intensity,
            } => Lamp::from_person(*direction)?.with_color(*intensity),
            _ => Err(LampError::Kind(
                "a distant light has a direction, and no position, radius, size or toward",
            )),
        }
    }
}

/// Lights that passed every check, and what should be said about them.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedLights {
    /// In the order given.
    pub lamps: Vec<Luminaire>,
    /// Light from all around and what it is called.
    pub environment: Option<(String, Environment)>,
    /// One sentence for each light whose answer deserves little trust.
    pub warnings: Vec<String>,
}

impl CheckedLights {
    /// Checks a list of at most `limit` lights, and light from all around; both may be missing.
    ///
    /// # Errors
    /// [`LightError`] for the first light that means nothing, or when there are too many.
    pub fn new(
        lights: &[Light],
        limit: usize,
        environment: Option<&EnvironmentLight>,
    ) -> Result<Self, LightError> {
        if lights.len() > limit {
            return Err(LightError::TooMany {
                found: lights.len(),
                limit,
            });
        }
        let mut lamps = Vec::with_capacity(lights.len());
        let mut warnings = Vec::new();
        for (index, light) in lights.iter().enumerate() {
            let lamp = light
                .luminaire()
                .map_err(|fault| LightError::Lamp { index, fault })?;
            lamps.push(lamp);
            if lamp.is_behind() {
                warnings.push(format!(
                    "light {index} shines from behind the scene: only what the camera sees facing \
                     it is lit, and what stands behind the photograph is unknown; low confidence"
                ));
            }
        }
        let environment = environment
            .map(|light| Ok((light.name.clone(), light.check()?)))
            .transpose()?;
        Ok(Self {
            lamps,
            environment,
            warnings,
        })
    }

    /// True when there is nothing to light with.
    pub fn is_empty(&self) -> bool {
        self.lamps.is_empty() && self.environment.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn three_numbers_make_a_white_light() {
        let light: Light = "0.6, -0.5,0.62".parse().unwrap();
        assert_eq!(light, Light::from_direction([0.6, -0.5, 0.62]));
    }

    #[test]
    fn nonsense_is_refused_with_its_text_or_its_index() {
        for text in ["", "1,2", "1,2,3,4", "a,b,c", "1;2;3"] {
            assert!(
                matches!(text.parse::<Light>(), Err(LightError::Text { .. })),
                "{text}"
            );
        }
    }

    #[test]
    fn a_light_that_means_nothing_is_refused_with_its_index() {
        let front = Light::from_direction([0.0, 0.0, 1.0]);
        let refused = |light| CheckedLights::new(&[front, light], 9, None).unwrap_err();
        for text in ["nan,0,1", "0,0,inf", "1e99,0,1", "0,0,0"] {
            let error = refused(text.parse().unwrap());
            assert!(
                matches!(error, LightError::Lamp { index: 1, .. }),
                "{text}: {error}"
            );
        }
        let negative = Light {
            intensity: [1.0, -1.0, 1.0],
            ..front
        };
        assert!(matches!(
            refused(negative),
            LightError::Lamp {
                fault: LampError::Color(_),
                ..
            }
        ));
    }

    #[test]
    fn a_light_is_of_one_kind() {
        let (place, front) = (
            Light::at([0.5, 0.5, -1.0]),
            Light::from_direction([0.0, 0.0, 1.0]),
        );
        let (radius, size, toward) = (Some(0.1), Some([0.4, 0.3]), Some([0.0, 0.0, -1.5]));
        let ball = Light { radius, ..place };
        let panel = Light {
            size,
            toward,
            ..place
        };
        assert!(matches!(place.luminaire(), Ok(Luminaire::Near(_))));
        assert!(matches!(ball.luminaire(), Ok(Luminaire::Area(_))));
        assert!(matches!(panel.luminaire(), Ok(Luminaire::Area(_))));
        for neither in [
            Light::nowhere(),
            Light {
                position: place.position,
                ..front
            },
            Light { radius, ..front },
            Light {
                size,
                toward,
                ..front
            },
            Light { size, ..place },
            Light { toward, ..place },
            Light { radius, ..panel },
        ] {
            let refused = neither.luminaire();
            assert!(
                matches!(refused, Err(LampError::Kind(_))),
                "{neither:?}: {refused:?}"
            );
            assert!(neither.distant().is_err());
        }
        // Older clients and files say directions alone.
        let old: Light = serde_json::from_str(r#"{"direction": [0, 0, 1]}"#).unwrap();
        assert_eq!(old, front);
        assert_eq!(
            serde_json::to_value(front)
                .unwrap()
                .as_object()
                .unwrap()
                .len(),
            2
        );
    }

    #[test]
    fn a_light_from_behind_is_answered_with_a_warning_and_one_from_the_front_is_not() {
        let of = |z| CheckedLights::new(&[Light::from_direction([0.3, 0.0, z])], 1, None).unwrap();
        assert_eq!(of(0.5).warnings.len(), 0);
        assert_eq!(of(-0.5).warnings.len(), 1);
        assert_eq!(of(0.0).warnings.len(), 1);
    }

    #[test]
    fn more_lights_than_the_limit_are_refused() {
        let many = [Light::from_direction([0.0, 0.0, 1.0]); 3];
        assert_eq!(
            CheckedLights::new(&many, 2, None),
            Err(LightError::TooMany { found: 3, limit: 2 })
        );
    }

    proptest! {
        #[test]
        fn any_text_is_a_light_or_an_error_but_never_a_panic(text in ".{0,40}") {
            if let Ok(lamp) = text.parse::<Light>().map_err(drop).and_then(|light| light.distant().map_err(drop)) {
                prop_assert!((lamp.toward().length() - 1.0).abs() < 1e-4);
            }
        }
    }
}
