//! What clients ask of the daemon and what it answers, as JSON.
//!
//! The same words serve the command line: a light typed by a person and one sent by a script are
//! checked by the same code.

mod environment;
mod light;
mod status;
mod view;

pub use environment::EnvironmentLight;
pub use light::{CheckedLights, Light, LightError};
pub use status::{DeviceStatus, DevicesReply, Event, Phase, Role, StatusReply};
pub use view::{Detail, Layer, PictureFormat, PreviewQuery, ViewRequest};

use crate::{output::Manifest, relight::networks::Variant};
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use utoipa::ToSchema;

/// `POST /v1/shots`: take one shot, now.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ShotRequest {
    /// Address of the device that takes it; `None` = the first that the daemon owns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Make the shot of so many color frames, from 2 to `limits.burst` of the configuration: less noise,
    /// more time. `None` = of one bracket.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub burst: Option<u32>,
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
    #[schema(value_type = String)]
    pub variant: Variant,
    /// Longest time from the shot in memory to the relit pictures in memory, milliseconds, where
    /// `tier` is `auto`; `None` = as long as it takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_ms: Option<f64>,
}

impl ShotRequest {
    /// Checks the number of frames asked for.
    ///
    /// # Errors
    /// In words, for fewer than two frames and for more than `most`.
    pub fn check_burst(&self, most: u32) -> Result<(), String> {
        match self.burst {
            Some(frames) if !(2..=most).contains(&frames) => Err(format!(
                "burst is {frames}; it must be from 2 to {most} (limits.burst of the configuration)"
            )),
            _ => Ok(()),
        }
    }
}

/// What answers for surfaces, shadows and light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Tier {
    /// The terms that the shot needs, and time allows.
    #[default]
    Auto,
    /// Closed forms, every one of them; needs no model.
    Closed,
    /// Closed forms, corrected by two compact networks.
    Compact,
    /// The three networks of Qiu et al. 2020.
    Paper,
}

impl FromStr for Tier {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "closed" => Ok(Self::Closed),
            "compact" => Ok(Self::Compact),
            "paper" => Ok(Self::Paper),
            _ => Err("it must be auto, closed, compact or paper".to_owned()),
        }
    }
}

/// What became of a shot that was asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
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
    #[schema(value_type = Object)]
    pub shot: Manifest,
}

/// `POST /v1/shots/{id}/relight`: develop a kept shot once more and keep what comes of it as a new one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RelightRequest {
    /// Lights to show it under, in the order of the numbered results.
    pub lights: Vec<Light>,
    /// Light from all around, whose result comes last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<EnvironmentLight>,
    /// What answers.
    pub tier: Tier,
    /// Which networks, where `tier` is `paper`.
    #[schema(value_type = String)]
    pub variant: Variant,
    /// As in [`ShotRequest`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_ms: Option<f64>,
}

/// One shot of `GET /v1/shots`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShotEntry {
    /// Its name.
    pub id: String,
    /// When it was taken, milliseconds since 1970, UTC.
    pub at_ms: u64,
    /// The device or shot it came from.
    pub source: String,
    /// Pixels per row; 0 where it was salvaged.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What the lights of its numbered results are called.
    pub lights: Vec<String>,
    /// What lowers the trust in it.
    pub warnings: Vec<String>,
    /// Every file of it.
    pub files: Vec<String>,
}

/// `GET /v1/shots`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShotsReply {
    /// How many are kept.
    pub count: usize,
    /// Newest first.
    pub shots: Vec<ShotEntry>,
}

/// Which part could not do its work; the exit code of `capturectl` follows from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
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
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Fault {
    /// Which part.
    pub kind: FaultKind,
    /// What happened, naming the file or field.
    pub message: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}
