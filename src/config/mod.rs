//! `captured.toml`: what the daemon and `capturectl` are told by whoever owns the machine.
//!
//! `config/captured.toml` explains every key; a test holds that it says exactly the defaults here.

use crate::inference::Settings;
use serde::{Deserialize, Serialize};
use std::{
    path::{Path, PathBuf},
    time::Duration,
};
use thiserror::Error;

/// The largest file that is read as a configuration, bytes.
const LARGEST_FILE: u64 = 1 << 20;

/// The whole file. A key that is left out has the default of `config/captured.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Address of the device, as `capturectl devices` lists them.
    pub device: String,
    /// Where the daemon listens; `None` = `captured/captured.sock` in the run folder.
    pub socket: Option<PathBuf>,
    /// Folder in which the daemon keeps its shots; `None` = the state folder.
    pub state: Option<PathBuf>,
    /// How a shot is taken.
    pub capture: Capture,
    /// What one client may ask for.
    pub limits: Limits,
    /// Networks, and what runs them.
    pub inference: Settings,
}

/// How a shot is taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Capture {
    /// Exposure asked for, seconds in (0, 60]; `None` = the device's own choice.
    pub exposure_seconds: Option<f32>,
    /// Linear gain asked for, ≥ 1; `None` = the device's own choice.
    pub gain: Option<f32>,
    /// The flash fires on every such color frame; in 2..=16.
    pub flash_every: u32,
    /// Longest silence of the device, seconds in (0, 60].
    pub patience_seconds: f64,
    /// Longest wait for one whole shot, seconds in (0, 600].
    pub deadline_seconds: f64,
}

/// What one client may ask for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest request body, bytes.
    pub request_bytes: usize,
    /// Longest time from a request's first byte to its answer, seconds in (0, 3600].
    pub request_seconds: f64,
    /// Shots waiting for the camera; one more is refused. In 1..=64.
    pub queue: usize,
    /// Lights in one request; in 1..=4096.
    pub lights: usize,
    /// Connections open at once; one more waits. In 1..=1024.
    pub connections: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            device: "synthetic:desk".to_owned(),
            socket: None,
            state: None,
            capture: Capture::default(),
            limits: Limits::default(),
            inference: Settings::default(),
        }
    }
}

impl Default for Capture {
    fn default() -> Self {
        Self {
            exposure_seconds: None,
            gain: None,
            flash_every: 3,
            patience_seconds: 2.0,
            deadline_seconds: 20.0,
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            request_bytes: 65_536,
            request_seconds: 120.0,
            queue: 4,
            lights: 64,
            connections: 32,
        }
    }
}

/// Why a configuration cannot be used.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum ConfigError {
    #[error("{path}: cannot be read: {source}")]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path}: larger than {LARGEST_FILE} bytes; this is not a configuration")]
    TooLarge { path: PathBuf },
    #[error("{path}: {problem}")]
    Parse { path: PathBuf, problem: String },
    #[error("{path}: {field} is {found}; it must be {allowed}")]
    Field {
        path: PathBuf,
        field: &'static str,
        found: String,
        allowed: &'static str,
    },
}

impl Config {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`ConfigError`], naming the file and the key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let read = |source| ConfigError::Read {
            path: path.to_owned(),
            source,
        };
        if std::fs::metadata(path).map_err(read)?.len() > LARGEST_FILE {
            return Err(ConfigError::TooLarge {
                path: path.to_owned(),
            });
        }
        Self::parse(&std::fs::read_to_string(path).map_err(read)?, path)
    }

    /// Reads and checks the text of the file at `path`.
    ///
    /// # Errors
    /// [`ConfigError`], naming the file and the key.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text).map_err(|problem| ConfigError::Parse {
            path: path.to_owned(),
            problem: problem.to_string().trim_end().to_owned(),
        })?;
        config.check(path)?;
        Ok(config)
    }

    /// Checks every range.
    fn check(&self, path: &Path) -> Result<(), ConfigError> {
        let Self {
            device,
            socket: _,
            state: _,
            capture,
            limits,
            inference,
        } = self;
        let rules: [(bool, &'static str, String, &'static str); 12] = [
            (
                !device.is_empty(),
                "device",
                format!("{device:?}"),
                "the address of a device, such as synthetic:desk",
            ),
            (
                capture
                    .exposure_seconds
                    .is_none_or(|s| s > 0.0 && s <= 60.0),
                "capture.exposure_seconds",
                format!("{:?}", capture.exposure_seconds),
                "above 0 and at most 60",
            ),
            (
                capture.gain.is_none_or(|gain| (1.0..=1e6).contains(&gain)),
                "capture.gain",
                format!("{:?}", capture.gain),
                "at least 1",
            ),
            (
                (2..=16).contains(&capture.flash_every),
                "capture.flash_every",
                capture.flash_every.to_string(),
                "from 2 to 16",
            ),
            (
                capture.patience_seconds > 0.0 && capture.patience_seconds <= 60.0,
                "capture.patience_seconds",
                capture.patience_seconds.to_string(),
                "above 0 and at most 60",
            ),
            (
                capture.deadline_seconds > 0.0 && capture.deadline_seconds <= 600.0,
                "capture.deadline_seconds",
                capture.deadline_seconds.to_string(),
                "above 0 and at most 600",
            ),
            (
                (256..=1 << 24).contains(&limits.request_bytes),
                "limits.request_bytes",
                limits.request_bytes.to_string(),
                "from 256 to 16777216",
            ),
            (
                limits.request_seconds > 0.0 && limits.request_seconds <= 3600.0,
                "limits.request_seconds",
                limits.request_seconds.to_string(),
                "above 0 and at most 3600",
            ),
            (
                (1..=64).contains(&limits.queue),
                "limits.queue",
                limits.queue.to_string(),
                "from 1 to 64",
            ),
            (
                (1..=4096).contains(&limits.lights),
                "limits.lights",
                limits.lights.to_string(),
                "from 1 to 4096",
            ),
            (
                (1..=1024).contains(&limits.connections),
                "limits.connections",
                limits.connections.to_string(),
                "from 1 to 1024",
            ),
            (
                inference.threads.is_none_or(|n| (1..=64).contains(&n)),
                "inference.threads",
                format!("{:?}", inference.threads),
                "from 1 to 64",
            ),
        ];
        match rules.into_iter().find(|(kept, ..)| !kept) {
            None => Ok(()),
            Some((_, field, found, allowed)) => Err(ConfigError::Field {
                path: path.to_owned(),
                field,
                found,
                allowed,
            }),
        }
    }

    /// Where the daemon listens: the configured path, else `captured.sock` in systemd's runtime
    /// folder of this service, else in the user's run folder, else in `/run/captured`.
    pub fn socket_path(&self) -> PathBuf {
        if let Some(path) = &self.socket {
            return path.clone();
        }
        let folder = env_folder("RUNTIME_DIRECTORY")
            .or_else(|| env_folder("XDG_RUNTIME_DIR").map(|run| run.join("captured")))
            .unwrap_or_else(|| PathBuf::from("/run/captured"));
        folder.join("captured.sock")
    }

    /// Sockets at which a client looks for a daemon, best first.
    pub fn socket_candidates(&self) -> Vec<PathBuf> {
        if self.socket.is_some() {
            return vec![self.socket_path()];
        }
        let system = PathBuf::from("/run/captured/captured.sock");
        let mut candidates = vec![self.socket_path()];
        if !candidates.contains(&system) {
            candidates.push(system);
        }
        candidates
    }

    /// Where the daemon keeps its shots: the configured folder, else systemd's state folder of
    /// this service, else `captured` in the user's state folder.
    pub fn state_path(&self) -> PathBuf {
        if let Some(path) = &self.state {
            return path.clone();
        }
        env_folder("STATE_DIRECTORY")
            .or_else(|| env_folder("XDG_STATE_HOME").map(|state| state.join("captured")))
            .or_else(|| env_folder("HOME").map(|home| home.join(".local/state/captured")))
            .unwrap_or_else(|| PathBuf::from("/var/lib/captured"))
    }
}

impl Capture {
    /// What is asked of the device.
    pub fn settings(&self) -> drivers::Settings {
        drivers::Settings {
            exposure_seconds: self.exposure_seconds,
            gain: self.gain,
            flash_every: self.flash_every,
        }
    }

    /// Longest silence of the device.
    pub fn patience(&self) -> Duration {
        Duration::from_secs_f64(self.patience_seconds)
    }

    /// Longest wait for one shot.
    pub fn deadline(&self) -> Duration {
        Duration::from_secs_f64(self.deadline_seconds)
    }
}

impl Limits {
    /// Longest time for one request.
    pub fn request_time(&self) -> Duration {
        Duration::from_secs_f64(self.request_seconds)
    }
}

/// A folder named by an environment variable; relative and empty names are ignored, as the XDG
/// base directory specification asks. systemd separates several folders by colons: the first counts.
fn env_folder(variable: &str) -> Option<PathBuf> {
    let value = std::env::var_os(variable)?;
    let first = value.to_str()?.split(':').next()?;
    let folder = PathBuf::from(first);
    folder.is_absolute().then_some(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../../config/captured.toml");

    #[test]
    fn the_shipped_file_is_valid_and_says_the_defaults() {
        let shipped = Config::parse(SHIPPED, Path::new("config/captured.toml")).unwrap();
        assert_eq!(shipped, Config::default());
    }

    #[test]
    fn the_shipped_file_names_every_key_and_its_examples_are_valid() {
        // Keys without a value by default stand in the file as `#key = example`.
        let examples: String = SHIPPED
            .lines()
            .map(|line| {
                line.strip_prefix('#')
                    .filter(|rest| rest.starts_with(char::is_alphabetic))
                    .unwrap_or(line)
            })
            .flat_map(|line| [line, "\n"])
            .collect();
        let config = Config::parse(&examples, Path::new("examples")).unwrap();
        assert!(config.socket.is_some() && config.state.is_some());
        assert!(config.capture.exposure_seconds.is_some() && config.capture.gain.is_some());
        assert!(config.inference.models.is_some() && config.inference.threads.is_some());
        let table = toml::Table::try_from(&config).unwrap();
        let written: toml::Table = toml::from_str(&examples).unwrap();
        for (key, value) in &table {
            assert!(written.contains_key(key), "{key} is not explained");
            for inner in value.as_table().into_iter().flatten() {
                assert!(
                    written[key].get(inner.0).is_some(),
                    "{key}.{} is not explained",
                    inner.0
                );
            }
        }
    }

    #[test]
    fn wrong_values_and_unknown_keys_are_named() {
        struct Case(&'static str, &'static str);
        let cases = [
            Case("devcie = 'x'", "devcie"),
            Case("device = ''", "device"),
            Case("[capture]\nflash_every = 1", "capture.flash_every"),
            Case(
                "[capture]\nexposure_seconds = nan",
                "capture.exposure_seconds",
            ),
            Case(
                "[capture]\npatience_seconds = nan",
                "capture.patience_seconds",
            ),
            Case(
                "[capture]\ndeadline_seconds = inf",
                "capture.deadline_seconds",
            ),
            Case("[capture]\ngain = 0.0", "capture.gain"),
            Case("[limits]\nqueue = 0", "limits.queue"),
            Case("[limits]\nrequest_bytes = -1", "request_bytes"),
            Case("[limits]\nlights = 1000000", "limits.lights"),
            Case("[inference]\nthreads = 0", "inference.threads"),
            Case("device = ", "device"),
        ];
        for Case(text, named) in cases {
            let message = Config::parse(text, Path::new("here.toml"))
                .unwrap_err()
                .to_string();
            assert!(
                message.contains(named) && message.contains("here.toml"),
                "{text}: {message}"
            );
        }
    }
}
