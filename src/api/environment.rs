//! Light from all around as it is sent.

use super::{Light, LightError};
use crate::relight::{Environment, EnvironmentError, Lamp};
use serde::{Deserialize, Serialize};

/// Light from all around, as distant lights.
///
/// A map has millions of pixels, but each cell of the visibility map sees one light from it: so
/// many are sent in a few kilobytes, and whoever develops the shot needs no rights in the map's
/// folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentLight {
    /// What it is called in the results; at most 100 characters.
    pub name: String,
    /// Its lights; those further than 20° behind the scene light nothing.
    pub lights: Vec<Light>,
}

impl EnvironmentLight {
    /// Most characters of a name.
    pub const LONGEST_NAME: usize = 100;

    /// The lights of `environment`.
    pub fn new(name: &str, environment: &Environment) -> Self {
        let lights = environment.lamps().map(|lamp| Light {
            intensity: lamp.color,
            ..Light::from_direction(lamp.person_direction())
        });
        Self {
            name: name
                .chars()
                .filter(|letter| !letter.is_control())
                .take(Self::LONGEST_NAME)
                .collect(),
            lights: lights.collect(),
        }
    }

    /// The environment it means.
    ///
    /// # Errors
    /// [`LightError`] for a name or a light that means nothing, or when nothing is lit.
    pub(super) fn check(&self) -> Result<Environment, LightError> {
        let said = |problem: String| LightError::Environment {
            name: self.name.chars().take(Self::LONGEST_NAME).collect(),
            problem,
        };
        if self.name.chars().count() > Self::LONGEST_NAME || self.name.contains(char::is_control) {
            return Err(said("the name is no line of 100 characters".to_owned()));
        }
        let lamp = |(index, light): (usize, &Light)| {
            let lamp = light.distant();
            lamp.map_err(|fault| said(format!("light {index}: {fault}")))
        };
        let lamps: Vec<Lamp> = self
            .lights
            .iter()
            .enumerate()
            .map(lamp)
            .collect::<Result<_, _>>()?;
        Environment::from_lamps(&lamps).map_err(|error: EnvironmentError| said(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::CheckedLights;
    use drivers::Plane;

    #[test]
    fn an_environment_survives_being_sent() {
        let map = Plane::from_fn(64, 32, |x, y| [(x % 7) as f32, (y % 5) as f32, 0.3]);
        let sent = EnvironmentLight::new("sky\n", &Environment::new(&map).unwrap());
        assert_eq!(sent.name, "sky");
        let text = serde_json::to_string(&sent).unwrap();
        assert!(text.len() < 40_000, "{} bytes", text.len());
        let heard: EnvironmentLight = serde_json::from_str(&text).unwrap();
        assert_eq!(heard, sent);
        let (_, environment) = CheckedLights::new(&[], 0, Some(&heard))
            .unwrap()
            .environment
            .unwrap();
        let power = |environment: &Environment| -> f32 {
            environment
                .lamps()
                .map(|lamp| lamp.color.iter().sum::<f32>())
                .sum()
        };
        let before = power(&Environment::new(&map).unwrap());
        assert!((power(&environment) / before - 1.0).abs() < 1e-5);
    }

    #[test]
    fn an_environment_that_means_nothing_is_refused_by_name() {
        let refused = |name: &str, lights: Vec<Light>| {
            let environment = EnvironmentLight {
                name: name.to_owned(),
                lights,
            };
            CheckedLights::new(&[], 9, Some(&environment))
                .unwrap_err()
                .to_string()
        };
        let behind = Light::from_direction([0.0, 0.0, -1.0]);
        assert!(refused("night", vec![behind]).contains("night"));
        assert!(refused("night", Vec::new()).contains("sends no light"));
        let nowhere = Light::from_direction([0.0; 3]);
        assert!(refused("night", vec![behind, nowhere]).contains("light 1"));
        assert!(refused(&"n".repeat(101), vec![behind]).contains("100 characters"));
    }
}
