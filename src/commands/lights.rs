//! Lights from the command line: `--light`, `--lights FILE`.

use super::error::{CommandError, InputError};
use crate::api::{CheckedLights, Light, LightError};
use clap::Args;
use serde::Deserialize;
use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

/// Most lights one command takes.
const MOST_LIGHTS: usize = 4096;
/// Largest file of lights, bytes.
const LARGEST_FILE: u64 = 1 << 20;

/// Lights to show a shot under.
#[derive(Debug, Clone, Default, Args)]
pub struct LightArguments {
    /// A distant light: x right, y up, z toward the camera, pointing toward the light; may be repeated.
    #[arg(long = "light", value_name = "X,Y,Z", allow_hyphen_values = true)]
    light: Vec<String>,
    /// A TOML file of lights: [[light]] direction = [x, y, z], intensity = [r, g, b] (optional).
    #[arg(long = "lights", value_name = "FILE")]
    lights: Option<PathBuf>,
}

/// The file of `--lights`; the same keys as a capture folder's `truth/lights.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LightsFile {
    #[serde(rename = "scale")]
    _scale: Option<String>,
    light: Vec<ListedLight>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedLight {
    direction: [f32; 3],
    intensity: Option<[f32; 3]>,
    #[serde(rename = "image")]
    _image: Option<String>,
    #[serde(rename = "shadow")]
    _shadow: Option<String>,
}

impl LightArguments {
    /// The lights, those of `--light` first.
    pub fn read(&self) -> Result<Vec<Light>, CommandError> {
        let mut lights = self
            .light
            .iter()
            .map(|text| text.parse())
            .collect::<Result<Vec<Light>, LightError>>()?;
        if let Some(path) = &self.lights {
            lights.extend(read_file(path)?);
        }
        Ok(lights)
    }

    /// The lights, each of them checked.
    pub fn check(&self) -> Result<CheckedLights, CommandError> {
        Ok(CheckedLights::new(&self.read()?, MOST_LIGHTS)?)
    }
}

fn read_file(path: &Path) -> Result<Vec<Light>, CommandError> {
    let refused = |problem: String| InputError {
        path: path.to_owned(),
        problem,
        remedy: "write [[light]] tables with direction = [x, y, z] and, if wanted, intensity = [r, g, b]",
    };
    let unread = |error: std::io::Error| refused(format!("cannot be read: {error}"));
    let mut text = String::new();
    let file = File::open(path).map_err(unread)?;
    file.take(LARGEST_FILE + 1)
        .read_to_string(&mut text)
        .map_err(unread)?;
    if text.len() as u64 > LARGEST_FILE {
        return Err(refused(format!("larger than {LARGEST_FILE} bytes")).into());
    }
    let file: LightsFile =
        toml::from_str(&text).map_err(|error| refused(error.to_string().trim_end().to_owned()))?;
    let white = Light::from_direction([0.0, 0.0, 1.0]).intensity;
    Ok(file
        .light
        .into_iter()
        .map(|light| Light {
            direction: light.direction,
            intensity: light.intensity.unwrap_or(white),
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_true_lights_can_be_used_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lights.toml");
        std::fs::write(
            &path,
            "scale = \"unknown\"\n[[light]]\ndirection = [0.1, 0.2, 0.9]\nimage = \"relit_000.png\"\n\
             intensity = [0.5, 0.6, 0.7]\n[[light]]\ndirection = [0, 0, 1]\n",
        )
        .unwrap();
        let arguments = LightArguments {
            light: vec!["1,0,1".into()],
            lights: Some(path),
        };
        let lights = arguments.read().unwrap();
        assert_eq!(lights.len(), 3);
        assert_eq!(lights[1].intensity, [0.5, 0.6, 0.7]);
        assert_eq!(lights[2], Light::from_direction([0.0, 0.0, 1.0]));
    }

    #[test]
    fn a_bad_file_is_named_with_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lights.toml");
        for (text, named) in [
            ("[[light]]\ndirection = [0, 1]\n", "direction"),
            ("[[light]]\ndirection = [0, 0, 1]\ncolour = 1\n", "colour"),
            ("[[lamp]]\n", "lamp"),
        ] {
            std::fs::write(&path, text).unwrap();
            let arguments = LightArguments {
                light: vec![],
                lights: Some(path.clone()),
            };
            let message = arguments.read().unwrap_err().to_string();
            assert!(
                message.contains(named) && message.contains("lights.toml"),
                "{message}"
            );
        }
    }
}
