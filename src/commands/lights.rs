//! Lights from the command line: `--light`, `--lights FILE`, `--environment MAP`.

use super::error::{CommandError, InputError};
use crate::{
    api::{EnvironmentLight, Light, LightError},
    folder::{self, Samples, decode_limited},
    relight::Environment,
};
use clap::Args;
use drivers::Plane;
use serde::Deserialize;
use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

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
    /// A map of the light all around, .hdr or .exr, twice as wide as high.
    #[arg(long, value_name = "MAP")]
    environment: Option<PathBuf>,
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

    /// Light from all around, where a map of it is given.
    pub fn read_environment(&self) -> Result<Option<EnvironmentLight>, CommandError> {
        self.environment.as_deref().map(read_map).transpose()
    }
}

/// Reads a picture of scene-linear light.
pub(super) fn linear_picture(path: &Path) -> Result<Plane<[f32; 3]>, CommandError> {
    match decode_limited(path, None, folder::Limits::default())?.samples {
        Samples::RgbF32(plane) => Ok(plane),
        Samples::GrayF32(plane) => Ok(plane.map(|value| [*value; 3])),
        other => Err(InputError {
            path: path.to_owned(),
            problem: format!("holds {}", other.describe()),
            remedy: "give linear light: .hdr or .exr",
        }
        .into()),
    }
}

/// Reads a latitude–longitude map of scene-linear light.
fn read_map(path: &Path) -> Result<EnvironmentLight, CommandError> {
    let radiance = linear_picture(path)?;
    let environment = Environment::new(&radiance).map_err(|error| InputError {
        path: path.to_owned(),
        problem: error.to_string(),
        remedy: "give a latitude–longitude map, twice as wide as high",
    })?;
    let name = path
        .file_stem()
        .map_or_else(|| "environment".into(), |name| name.to_string_lossy());
    Ok(EnvironmentLight::new(&name, &environment))
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
            environment: None,
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
                environment: None,
            };
            let message = arguments.read().unwrap_err().to_string();
            assert!(
                message.contains(named) && message.contains("lights.toml"),
                "{message}"
            );
        }
    }
}
