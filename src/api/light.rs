//! Lights as people and scripts give them, and the checks every list of them passes.

use super::EnvironmentLight;
use crate::relight::{Environment, Lamp, LampError};
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use thiserror::Error;

/// A distant light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Toward the light: x right, y up, z toward the camera; any length but zero.
    pub direction: [f32; 3],
    /// Linear red, green, blue; ≥ 0; `[1, 1, 1]` shows a white patch facing the light as 1.0.
    #[serde(default = "Light::white")]
    pub intensity: [f32; 3],
}

impl Light {
    const fn white() -> [f32; 3] {
        [1.0; 3]
    }

    /// A white light from `direction`.
    pub const fn from_direction(direction: [f32; 3]) -> Self {
        Self {
            direction,
            intensity: Self::white(),
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
        "no light given; add --light x,y,z (x right, y up, z toward the camera), --lights FILE or --environment MAP"
    )]
    None,
    #[error("environment {name:?}: {problem}")]
    Environment { name: String, problem: String },
    #[error("{found} lights given, at most {limit} are taken at once; ask in several goes")]
    TooMany { found: usize, limit: usize },
}

impl FromStr for Light {
    type Err = LightError;

    /// Reads `x,y,z`.
    fn from_str(text: &str) -> Result<Self, LightError> {
        let refused = || LightError::Text {
            text: text.chars().take(80).collect(),
        };
        let numbers: Vec<f32> = text
            .split(',')
            .map(|number| number.trim().parse().map_err(|_| refused()))
            .collect::<Result<_, _>>()?;
        let direction = <[f32; 3]>::try_from(numbers).map_err(|_| refused())?;
        Ok(Self::from_direction(direction))
    }
}

impl Light {
    /// The lamp it means, in the axes of the camera.
    ///
    /// # Errors
    /// [`LampError`] for directions and intensities that mean nothing.
    pub fn lamp(&self) -> Result<Lamp, LampError> {
        Lamp::from_person(self.direction)?.with_color(self.intensity)
    }
}

/// Lights that passed every check, and what should be said about them.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedLights {
    /// In the order given.
    pub lamps: Vec<Lamp>,
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
                .lamp()
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
        assert_eq!(
            light,
            Light {
                direction: [0.6, -0.5, 0.62],
                intensity: [1.0; 3]
            }
        );
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
            if let Ok(lamp) = text.parse::<Light>().map_err(drop).and_then(|light| light.lamp().map_err(drop)) {
                prop_assert!((lamp.toward().length() - 1.0).abs() < 1e-4);
            }
        }
    }
}
