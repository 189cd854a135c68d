//! What clients ask of the daemon and what it answers, as JSON.
//!
//! The same words serve the command line: a light typed by a person and one sent by a script are
//! checked by the same code.

mod environment;
mod light;

pub use environment::EnvironmentLight;
pub use light::{CheckedLights, Light, LightError};

use crate::{output::Manifest, relight::networks::Variant};
use drivers::DeviceInfo;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// `POST /v1/shots`: take one shot, now.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShotRequest {
    /// Develop the shot and show it under `lights` and `environment`; false keeps the raw frames alone.
    pub relight: bool,
    /// Lights to show it under, in the order of the numbered results.
    pub lights: Vec<Light>,
    /// Light from all around, whose result comes last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<EnvironmentLight>,
    /// What answers.
    pub tier: Tier,
    /// Which networks, where `tier` is `paper`.
    pub variant: Variant,
    /// Longest time from the shot in memory to the relit pictures in memory, milliseconds, where
    /// `tier` is `auto`; `None` = as long as it takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_ms: Option<f64>,
}

/// What answers for surfaces, shadows and light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tier {
    /// The terms that the shot needs, and time allows.
    #[default]
    Auto,
    /// Closed forms, every one of them; needs no model.
    Closed,
    /// The three networks of Qiu et al. 2020.
    Paper,
}

impl FromStr for Tier {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "closed" => Ok(Self::Closed),
            "paper" => Ok(Self::Paper),
            _ => Err("it must be auto, closed or paper".to_owned()),
        }
    }
}

/// What became of a shot that was asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShotReply {
    /// Name of the shot in the daemon's store.
    pub id: String,
    /// Device that took it.
    pub device: String,
    /// Every file of the shot; fetch one with `GET /v1/shots/{id}/files/{name}`.
    pub files: Vec<String>,
    /// What lowers the trust in this answer, in words.
    pub warnings: Vec<String>,
    /// `shot.json`: time per stage, confidences and the BLAKE3 of every file.
    pub shot: Manifest,
}

/// `GET /v1/status`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StatusReply {
    /// Version of the daemon.
    pub version: String,
    /// The device it owns.
    pub device: DeviceInfo,
    /// True from before the camera streams until after it has stopped.
    pub in_use: bool,
    /// Shots committed since the daemon started.
    pub shots: u64,
    /// Requests that failed since the daemon started.
    pub failures: u64,
    /// Name of the newest shot.
    pub latest: Option<String>,
}

/// `GET /v1/devices`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DevicesReply {
    /// Everything a driver can open now.
    pub devices: Vec<DeviceInfo>,
}

/// Which part could not do its work; the exit code of `capturectl` follows from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// A device broke a clause of the contract.
    Contract,
    /// The request or the command line makes no sense.
    Request,
    /// A file is not what it claims to be.
    Input,
    /// A device is not there, does not answer or was unplugged.
    Device,
    /// A result cannot be written.
    Output,
    /// The shot cannot be developed: no flash in it, no depth in it.
    Shot,
    /// The daemon is overloaded, stopping or broken.
    Daemon,
}

impl FaultKind {
    /// Exit code of a process that ends because of it.
    pub const fn exit_code(self) -> u8 {
        match self {
            Self::Contract => 1,
            Self::Request => 2,
            Self::Input => 3,
            Self::Device => 4,
            Self::Output => 5,
            Self::Shot => 6,
            Self::Daemon => 7,
        }
    }
}

/// The body of every answer that is not a success.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Which part.
    pub kind: FaultKind,
    /// What happened, naming the file or field.
    pub message: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}
