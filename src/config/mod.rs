//! `captured.toml`: what the daemon and `capturectl` are told by whoever owns the machine.
//!
//! `config/captured.toml` explains every key; a test holds that it says exactly the defaults here.

mod sections;

pub use sections::{Access, Capture, Limits, Shots, Viewer};

use crate::inference::Settings;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The largest file that is read as a configuration, bytes.
const LARGEST_FILE: u64 = 1 << 20;

/// The whole file. A key that is left out has the default of `config/captured.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Addresses of the devices, as `capturectl devices` lists them; the first is used where none is
    /// asked for.
    pub devices: Vec<String>,
    /// The measured rig (`rig.toml`) of the first device; `None` = what the device says of itself.
    pub rig: Option<PathBuf>,
    /// Where the daemon listens; `None` = `captured/captured.sock` in the run folder.
    pub socket: Option<PathBuf>,
    /// Folder in which the daemon keeps its shots; `None` = the state folder.
    pub state: Option<PathBuf>,
    /// How a shot is taken.
    pub capture: Capture,
    /// What one client may ask for.
    pub limits: Limits,
    /// How long shots are kept, and how much room they may take.
    pub shots: Shots,
    /// Who may do what.
    pub access: Access,
    /// The page on which to look at shots.
    pub viewer: Viewer,
    /// Networks, and what runs them.
    pub inference: Settings,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            devices: vec!["synthetic:desk".to_owned()],
            rig: None,
            socket: None,
            state: None,
            capture: Capture::default(),
            limits: Limits::default(),
            shots: Shots::default(),
            access: Access::default(),
            viewer: Viewer::default(),
            inference: Settings::default(),
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
    #[error("{path}, line {line}: {field} is {found}; it must be {allowed}")]
    Field {
        path: PathBuf,
        line: usize,
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
        config.check(path, text)?;
        Ok(config)
    }

    /// Checks every range of what `text` says.
    fn check(&self, path: &Path, text: &str) -> Result<(), ConfigError> {
        let Self {
            devices,
            rig: _,
            socket: _,
            state: _,
            capture,
            limits,
            shots,
            access: _,
            viewer,
            inference,
        } = self;
        let rules: [(bool, &'static str, String, &'static str); 18] = [
            (
                (1..=8).contains(&devices.len())
                    && !devices.iter().any(String::is_empty)
                    && (1..devices.len()).all(|at| !devices[..at].contains(&devices[at])),
                "devices",
                format!("{devices:?}"),
                "one to eight addresses of different devices, such as [\"synthetic:desk\"]",
            ),
            (
                viewer.address.ip().is_loopback(),
                "viewer.address",
                viewer.address.to_string(),
                "a loopback address such as 127.0.0.1:8377; from elsewhere come through a tunnel",
            ),
            (
                viewer.hosts.iter().all(|host| is_host(host)),
                "viewer.hosts",
                format!("{:?}", viewer.hosts),
                "a list of name:port",
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
                (2..=64).contains(&limits.burst),
                "limits.burst",
                limits.burst.to_string(),
                "from 2 to 64",
            ),
            (
                (1..=1024).contains(&limits.connections),
                "limits.connections",
                limits.connections.to_string(),
                "from 1 to 1024",
            ),
            (
                shots.quota_bytes.is_none_or(|bytes| bytes >= 1 << 20),
                "shots.quota_bytes",
                format!("{:?}", shots.quota_bytes),
                "at least 1048576",
            ),
            (
                shots.keep_free_bytes <= 1 << 50,
                "shots.keep_free_bytes",
                shots.keep_free_bytes.to_string(),
                "at most 1125899906842624",
            ),
            (
                shots.keep_newest.is_none_or(|count| count >= 1),
                "shots.keep_newest",
                format!("{:?}", shots.keep_newest),
                "at least 1",
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
                line: line_of(text, field),
                field,
                found,
                allowed,
            }),
        }
    }

    /// The measured rig of the device at `address`: it is the first device's and no other's.
    pub fn rig_of(&self, address: &str) -> Option<&Path> {
        let first = self.devices.first().is_some_and(|first| first == address);
        self.rig.as_deref().filter(|_| first)
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

/// The line, from 1, on which a file gives `table.key` its value.
fn line_of(text: &str, field: &str) -> usize {
    let (table, key) = field.split_once('.').unwrap_or(("", field));
    let mut inside = "";
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if let Some(name) = line
            .strip_prefix('[')
            .and_then(|rest| rest.split(']').next())
        {
            inside = name.trim();
        }
        let value = line.strip_prefix(key).map(str::trim_start);
        if inside == table && value.is_some_and(|rest| rest.starts_with('=')) {
            return number + 1;
        }
    }
    1
}

/// True for `name:port` as it stands in a `Host` header.
fn is_host(text: &str) -> bool {
    let plain = |name: &str| {
        !name.is_empty()
            && name
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || b"-.[]:".contains(&b))
    };
    text.rsplit_once(':')
        .is_some_and(|(name, port)| plain(name) && port.parse::<u16>().is_ok())
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
        assert!(config.shots.quota_bytes.is_some() && config.shots.keep_newest.is_some());
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
            Case("device = 'x'", "device"),
            Case("devices = []", "devices"),
            Case("devices = ['']", "devices"),
            Case("devices = ['a:', 'a:']", "devices"),
            Case("[viewer]\naddress = '0.0.0.0:80'", "viewer.address"),
            Case("[viewer]\nhosts = ['evil/../x']", "viewer.hosts"),
            Case("[access]\nshooter_uids = [-1]", "shooter_uids"),
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
            Case("[limits]\nburst = 65", "limits.burst"),
            Case("[inference]\nthreads = 0", "inference.threads"),
            Case("[shots]\nquota_bytes = 5", "shots.quota_bytes"),
            Case("[shots]\nkeep_newest = 0", "shots.keep_newest"),
            Case("devices = ", "devices"),
        ];
        for Case(text, named) in cases {
            let message = Config::parse(text, Path::new("here.toml"))
                .unwrap_err()
                .to_string();
            let line = format!("line {}", text.lines().count());
            assert!(
                message.contains(named) && message.contains("here.toml") && message.contains(&line),
                "{text}: {message}"
            );
        }
    }
}
