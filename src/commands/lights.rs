//! Lights from the command line: `--light`, `--lights FILE`, `--environment MAP`.

use super::{
    error::{CommandError, InputError},
    small_file,
};
use crate::{
    api::{EnvironmentLight, Light, LightError},
    folder::{self, Samples, decode_limited},
    relight::Environment,
};
use clap::Args;
use drivers::Plane;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Lights to show a shot under.
#[derive(Debug, Clone, Default, Args)]
pub struct LightArguments {
    /// A distant light: x right, y up, z toward the camera, pointing toward the light; may be repeated.
    #[arg(long = "light", value_name = "X,Y,Z", allow_hyphen_values = true)]
    light: Vec<String>,
    /// A near light: metres from the color camera's lens, x right, y up, z toward the camera, so that what the
    /// camera sees has negative z; as bright as to show a white patch at one metre as 1; may be repeated.
    #[arg(long = "light-at", value_name = "X,Y,Z", allow_hyphen_values = true)]
    light_at: Vec<String>,
    /// A TOML file of lights: [[light]] with direction = [x, y, z] for a distant one, or position = [x, y, z] in
    /// metres for a near one; a large one with radius = r, or size = [w, h] and toward = [x, y, z]; and, if
    /// wanted, intensity = [r, g, b].
    #[arg(long = "lights", value_name = "FILE")]
    lights: Option<PathBuf>,
    /// A map of the light all around, .hdr or .exr, twice as wide as high.
    #[arg(long, value_name = "MAP")]
    environment: Option<PathBuf>,
    /// Turn the map about the vertical: what stood straight ahead goes to the right.
    #[arg(
        long,
        value_name = "DEGREES",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        requires = "environment"
    )]
    rotate_environment: f32,
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
    direction: Option<[f32; 3]>,
    position: Option<[f32; 3]>,
    radius: Option<f32>,
    size: Option<[f32; 2]>,
    toward: Option<[f32; 3]>,
    intensity: Option<[f32; 3]>,
    #[serde(rename = "image")]
    _image: Option<String>,
    #[serde(rename = "shadow")]
    _shadow: Option<String>,
}

impl LightArguments {
    /// The lights, those of `--light` first, then those of `--light-at`.
    pub fn read(&self) -> Result<Vec<Light>, CommandError> {
        let mut lights = self
            .light
            .iter()
            .map(|text| text.parse())
            .collect::<Result<Vec<Light>, LightError>>()?;
        for text in &self.light_at {
            lights.push(Light::parse_position(text)?);
        }
        if let Some(path) = &self.lights {
            lights.extend(read_file(path)?);
        }
        Ok(lights)
    }

    /// Light from all around, where a map of it is given.
    pub fn read_environment(&self) -> Result<Option<EnvironmentLight>, CommandError> {
        let Some(path) = &self.environment else {
            return Ok(None);
        };
        let environment = gathered(path, &linear_picture(path)?, self.turn()?)?;
        Ok(Some(EnvironmentLight::new(&name_of(path), &environment)))
    }

    /// The map that is given, for one that turns.
    pub fn read_map(&self) -> Result<Option<TurningMap>, CommandError> {
        let Some(path) = &self.environment else {
            return Ok(None);
        };
        let map = TurningMap {
            path: path.clone(),
            radiance: reduced(linear_picture(path)?),
            degrees: self.turn()?,
        };
        // What cannot be an environment is said before anything is made.
        map.turned(0.0)?;
        Ok(Some(map))
    }

    fn turn(&self) -> Result<f32, CommandError> {
        let degrees = self.rotate_environment;
        if degrees.is_finite() {
            return Ok(degrees);
        }
        Err(CommandError::Arguments(format!(
            "--rotate-environment {degrees}: give a number of degrees"
        )))
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

/// A map of light from all around that is to be turned often.
pub struct TurningMap {
    path: PathBuf,
    radiance: Plane<[f32; 3]>,
    degrees: f32,
}

impl TurningMap {
    /// Turned by so many degrees more than asked for.
    pub fn turned(&self, degrees: f32) -> Result<Environment, CommandError> {
        gathered(&self.path, &self.radiance, self.degrees + degrees)
    }
}

/// A map is gathered into cells of 11°: so many columns are finer by far.
const TURNED_COLUMNS: usize = 1024;

/// The mean of squares of pixels, where the map is finer than needed and its sides can be halved.
fn reduced(mut map: Plane<[f32; 3]>) -> Plane<[f32; 3]> {
    while map.width() > TURNED_COLUMNS
        && map.width().is_multiple_of(4)
        && map.height().is_multiple_of(2)
    {
        let quarter = |x: usize, y: usize, c: usize| {
            let pixels = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let values = pixels.map(|(dx, dy)| map[(2 * x + dx, 2 * y + dy)][c]);
            values.iter().sum::<f32>() / 4.0
        };
        map = Plane::from_fn(map.width() / 2, map.height() / 2, |x, y| {
            std::array::from_fn(|c| quarter(x, y, c))
        });
    }
    map
}

fn name_of(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "environment".into(), |name| name.to_string_lossy())
        .into_owned()
}

fn gathered(
    path: &Path,
    radiance: &Plane<[f32; 3]>,
    degrees: f32,
) -> Result<Environment, CommandError> {
    Environment::turned(radiance, degrees).map_err(|error| {
        InputError {
            path: path.to_owned(),
            problem: error.to_string(),
            remedy: "give a latitude–longitude map, twice as wide as high",
        }
        .into()
    })
}

fn read_file(path: &Path) -> Result<Vec<Light>, CommandError> {
    let refused = |problem: String| InputError {
        path: path.to_owned(),
        problem,
        remedy: "write [[light]] tables with direction = [x, y, z] or position = [x, y, z] and, if wanted, intensity = [r, g, b]",
    };
    let text = small_file::read(path).map_err(refused)?;
    let file: LightsFile =
        toml::from_str(&text).map_err(|error| refused(error.to_string().trim_end().to_owned()))?;
    let white = Light::from_direction([0.0, 0.0, 1.0]).intensity;
    Ok(file
        .light
        .into_iter()
        .map(|light| Light {
            direction: light.direction,
            position: light.position,
            radius: light.radius,
            size: light.size,
            toward: light.toward,
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
            ..LightArguments::default()
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
                lights: Some(path.clone()),
                ..LightArguments::default()
            };
            let message = arguments.read().unwrap_err().to_string();
            assert!(
                message.contains(named) && message.contains("lights.toml"),
                "{message}"
            );
        }
    }
}
