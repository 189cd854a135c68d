//! How a light moves: around the camera's axis, across, with the environment, or from key to key.

use crate::{api::Light, commands::small_file};
use glam::Vec3;
use serde::Deserialize;
use std::{f32::consts::TAU, path::Path, str::FromStr};

/// A light's way through a film.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum LightPath {
    /// A distant light once around the camera's axis, so many degrees off it.
    Orbit { off_axis_degrees: f32 },
    /// A distant light from so many degrees left to as many right, at eye level.
    Arc { reach_degrees: f32 },
    /// The environment once around.
    Turn,
    /// From key to key; at least two, in the order of time, all of one kind.
    Keys(Vec<Key>),
}

/// Where the light is at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Key {
    seconds: f64,
    light: Option<Light>,
    rotate_environment: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathFile {
    key: Vec<ListedKey>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedKey {
    seconds: f64,
    direction: Option<[f32; 3]>,
    position: Option<[f32; 3]>,
    radius: Option<f32>,
    size: Option<[f32; 2]>,
    toward: Option<[f32; 3]>,
    intensity: Option<[f32; 3]>,
    rotate_environment: Option<f32>,
}

impl FromStr for LightPath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, given) = match text.split_once(':') {
            Some((name, given)) if name == "orbit" || name == "arc" => (name, Some(given)),
            _ => (text, None),
        };
        let degrees = |usual: f32, most: f32| match given {
            None => Ok(usual),
            Some(given) => match given.parse::<f32>() {
                Ok(degrees) if (0.0..=most).contains(&degrees) => Ok(degrees),
                _ => Err(format!("{given:?} is no angle from 0 to {most} degrees")),
            },
        };
        match name {
            "orbit" => Ok(Self::Orbit {
                off_axis_degrees: degrees(45.0, 110.0)?,
            }),
            "arc" => Ok(Self::Arc {
                reach_degrees: degrees(75.0, 110.0)?,
            }),
            "turn" => Ok(Self::Turn),
            _ if Path::new(name).extension().is_some_and(|end| end == "toml") => {
                read(Path::new(name))
            }
            _ => {
                Err("give orbit[:DEGREES], arc[:DEGREES], turn or a .toml file of keys".to_owned())
            }
        }
    }
}

fn read(path: &Path) -> Result<LightPath, String> {
    let said = |problem: String| format!("{}: {problem}", path.display());
    let text = small_file::read(path).map_err(said)?;
    parse(&text).map_err(said)
}

fn parse(text: &str) -> Result<LightPath, String> {
    let file: PathFile =
        toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
    let keys: Vec<Key> = file.key.into_iter().map(key).collect();
    let [first, .., last] = keys.as_slice() else {
        return Err("give at least two [[key]] tables".to_owned());
    };
    let in_order = keys
        .windows(2)
        .all(|pair| pair[0].seconds < pair[1].seconds);
    if first.seconds != 0.0 || !last.seconds.is_finite() || !in_order {
        return Err("seconds of keys begin at 0 and grow".to_owned());
    }
    for (index, key) in keys.iter().enumerate() {
        if let Some(light) = &key.light {
            let meant = light.luminaire();
            meant.map_err(|fault| format!("key {index}: {fault}"))?;
        }
        if key
            .rotate_environment
            .is_some_and(|degrees| !degrees.is_finite())
        {
            return Err(format!("key {index}: rotate_environment is no number"));
        }
        if key.kind() != first.kind() {
            return Err(format!(
                "key {index} has other fields than key 0; a light keeps its kind on its way"
            ));
        }
    }
    if first.kind() == [false; 6] {
        return Err("keys say neither direction, position nor rotate_environment".to_owned());
    }
    Ok(LightPath::Keys(keys))
}

fn key(listed: ListedKey) -> Key {
    let light = Light {
        direction: listed.direction,
        position: listed.position,
        radius: listed.radius,
        size: listed.size,
        toward: listed.toward,
        intensity: listed.intensity.unwrap_or([1.0; 3]),
    };
    let given = light.direction.is_some()
        || light.position.is_some()
        || light.radius.is_some()
        || light.size.is_some()
        || light.toward.is_some()
        || listed.intensity.is_some();
    Key {
        seconds: listed.seconds,
        light: given.then_some(light),
        rotate_environment: listed.rotate_environment,
    }
}

impl Key {
    /// Which fields it has; of one kind all that follows can be mixed.
    fn kind(&self) -> [bool; 6] {
        let has = |field: fn(&Light) -> bool| self.light.as_ref().is_some_and(field);
        [
            has(|light| light.direction.is_some()),
            has(|light| light.position.is_some()),
            has(|light| light.radius.is_some()),
            has(|light| light.size.is_some()),
            has(|light| light.toward.is_some()),
            self.rotate_environment.is_some(),
        ]
    }

    /// On the way to `next`, after a share of it.
    fn toward(&self, next: &Self, share: f32) -> (Option<Light>, f32) {
        let degrees = mixed1(
            self.rotate_environment.unwrap_or(0.0),
            next.rotate_environment.unwrap_or(0.0),
            share,
        );
        let light = self.light.zip(next.light).map(|(from, to)| {
            let three = |from: Option<[f32; 3]>, to: Option<[f32; 3]>| {
                from.zip(to).map(|(from, to)| mixed(from, to, share))
            };
            Light {
                direction: from
                    .direction
                    .zip(to.direction)
                    .map(|(from, to)| turned(from, to, share)),
                position: three(from.position, to.position),
                radius: from
                    .radius
                    .zip(to.radius)
                    .map(|(from, to)| mixed1(from, to, share)),
                size: from
                    .size
                    .zip(to.size)
                    .map(|(from, to)| mixed(from, to, share)),
                toward: three(from.toward, to.toward),
                intensity: mixed(from.intensity, to.intensity, share),
            }
        });
        (light, degrees)
    }
}

fn mixed1(from: f32, to: f32, share: f32) -> f32 {
    from + (to - from) * share
}

fn mixed<const N: usize>(from: [f32; N], to: [f32; N], share: f32) -> [f32; N] {
    std::array::from_fn(|at| mixed1(from[at], to[at], share))
}

/// Along the great circle between two directions, at an even pace (Shoemake 1985); between opposite
/// ones any circle does.
fn turned(from: [f32; 3], to: [f32; 3], share: f32) -> [f32; 3] {
    let [from, to] = [from, to].map(|v| Vec3::from(v).normalize_or(Vec3::Z));
    let across = to - from.dot(to) * from;
    let across = across
        .try_normalize()
        .unwrap_or_else(|| from.any_orthonormal_vector());
    let angle = from.angle_between(to) * share;
    (from * angle.cos() + across * angle.sin()).to_array()
}

impl LightPath {
    /// How long it says to take, seconds.
    pub fn seconds(&self) -> Option<f64> {
        match self {
            Self::Keys(keys) => keys.last().map(|key| key.seconds),
            Self::Orbit { .. } | Self::Arc { .. } | Self::Turn => None,
        }
    }

    /// True when the environment turns.
    pub fn turns(&self) -> bool {
        match self {
            Self::Keys(keys) => keys.iter().any(|key| key.rotate_environment.is_some()),
            Self::Turn => true,
            Self::Orbit { .. } | Self::Arc { .. } => false,
        }
    }

    /// The light after a share of the way, 0 to 1, and by how many degrees the environment is turned.
    pub fn at(&self, share: f64) -> (Option<Light>, f32) {
        let turn = share as f32;
        match self {
            Self::Orbit { off_axis_degrees } => {
                let (away, ahead) = off_axis_degrees.to_radians().sin_cos();
                // Begins above and goes clockwise, as seen by the camera.
                let (right, up) = (turn * TAU).sin_cos();
                let direction = [away * right, away * up, ahead];
                (Some(Light::from_direction(direction)), 0.0)
            }
            Self::Arc { reach_degrees } => {
                let angle = (2.0 * turn - 1.0) * reach_degrees.to_radians();
                let direction = [angle.sin(), 0.0, angle.cos()];
                (Some(Light::from_direction(direction)), 0.0)
            }
            Self::Turn => (None, 360.0 * turn),
            Self::Keys(keys) => {
                let seconds = share * keys[keys.len() - 1].seconds;
                let after = keys.iter().position(|key| key.seconds > seconds);
                let after = after.unwrap_or(keys.len() - 1).max(1);
                let (from, to) = (&keys[after - 1], &keys[after]);
                let share = (seconds - from.seconds) / (to.seconds - from.seconds);
                from.toward(to, share as f32)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orbit_keeps_its_angle_and_comes_back() {
        let path: LightPath = "orbit:30".parse().unwrap();
        for step in 0..=8 {
            let (light, turn) = path.at(f64::from(step) / 8.0);
            let toward = Vec3::from(light.unwrap().direction.unwrap());
            assert!((toward.angle_between(Vec3::Z).to_degrees() - 30.0).abs() < 1e-2);
            assert_eq!(turn, 0.0);
        }
        let [first, last] = [0.0, 1.0].map(|at| path.at(at).0.unwrap().direction.unwrap());
        assert!(Vec3::from(first).distance(last.into()) < 1e-5);
        assert!(first[1] > 0.49, "it begins above");
    }

    #[test]
    fn directions_turn_at_an_even_pace_on_a_great_circle() {
        let path = parse(
            "[[key]]\nseconds = 0\ndirection = [1, 0, 0]\n[[key]]\nseconds = 2\ndirection = [0, 0, 5]\n\
             [[key]]\nseconds = 3\ndirection = [0, 3, 0]\nintensity = [3, 1, 1]\n",
        )
        .unwrap();
        assert_eq!(path.seconds(), Some(3.0));
        for step in 0..=12 {
            let seconds = 0.25 * f64::from(step);
            let light = path.at(seconds / 3.0).0.unwrap();
            let toward = Vec3::from(light.direction.unwrap());
            let angle = toward.angle_between(Vec3::X).to_degrees();
            let expected = if step <= 8 {
                45.0 * seconds as f32
            } else {
                90.0
            };
            assert!(
                (angle - expected).abs() < 0.1,
                "{seconds}: {angle} {expected}"
            );
            assert!((toward.length() - 1.0).abs() < 1e-5);
        }
        assert_eq!(path.at(1.0).0.unwrap().intensity, [3.0, 1.0, 1.0]);
        assert_eq!(path.at(5.0 / 6.0).0.unwrap().intensity, [2.0, 1.0, 1.0]);
    }

    #[test]
    fn a_near_light_moves_on_a_straight_line_and_an_environment_turns() {
        let path = parse(
            "[[key]]\nseconds = 0\nposition = [0, 0, -1]\nradius = 0.1\nrotate_environment = -90\n\
             [[key]]\nseconds = 4\nposition = [1, 0, -1]\nradius = 0.3\nrotate_environment = 90\n",
        )
        .unwrap();
        let (light, turn) = path.at(0.25);
        let light = light.unwrap();
        assert_eq!(light.position, Some([0.25, 0.0, -1.0]));
        assert!((light.radius.unwrap() - 0.15).abs() < 1e-6);
        assert_eq!(turn, -45.0);
        assert!(path.turns());
        let turning = "[[key]]\nseconds = 0\nrotate_environment = 0\n[[key]]\nseconds = 1\nrotate_environment = 10\n";
        assert_eq!(parse(turning).unwrap().at(0.5), (None, 5.0));
    }

    #[test]
    fn paths_that_lead_nowhere_are_refused_with_their_key() {
        for (text, named) in [
            ("[[key]]\nseconds = 0\ndirection = [0, 0, 1]\n", "two"),
            ("[[key]]\nseconds = 0\n[[key]]\nseconds = 1\n", "neither"),
            (
                "[[key]]\nseconds = 1\ndirection = [0, 0, 1]\n[[key]]\nseconds = 0\ndirection = [0, 0, 1]\n",
                "grow",
            ),
            (
                "[[key]]\nseconds = 0\ndirection = [0, 0, 1]\n[[key]]\nseconds = inf\ndirection = [0, 0, 1]\n",
                "grow",
            ),
            (
                "[[key]]\nseconds = 0\ndirection = [0, 0, 1]\n[[key]]\nseconds = 1\nposition = [0, 0, 1]\n",
                "key 1",
            ),
            (
                "[[key]]\nseconds = 0\ndirection = [0, 0, 0]\n[[key]]\nseconds = 1\ndirection = [0, 0, 1]\n",
                "key 0",
            ),
            ("[[key]]\nseconds = 0\nangle = 3\n", "angle"),
        ] {
            let refused = parse(text).unwrap_err();
            assert!(refused.contains(named), "{text}: {refused}");
        }
        for text in ["", "orbit:x", "orbit:200", "spiral", "nothing.toml"] {
            assert!(text.parse::<LightPath>().is_err(), "{text}");
        }
    }
}
