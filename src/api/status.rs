//! How the daemon and its devices are.

use drivers::DeviceInfo;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What a device is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Nothing; its camera is off.
    Idle,
    /// Its camera streams, for a shot that is about to come or for somebody who looks through it.
    Armed,
    /// It takes the frames of a shot.
    Bracketing,
    /// A shot of it is developed and written.
    Committing,
    /// It is lost or silent; it is opened again as soon as it is back.
    Degraded,
}

impl Phase {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Idle,
        Self::Armed,
        Self::Bracketing,
        Self::Committing,
        Self::Degraded,
    ];

    /// Its name in JSON and metrics.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Armed => "armed",
            Self::Bracketing => "bracketing",
            Self::Committing => "committing",
            Self::Degraded => "degraded",
        }
    }
}

/// One device of the daemon.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviceStatus {
    /// Its address as it is configured.
    pub address: String,
    /// What it is, with its address in full.
    #[schema(value_type = Object)]
    pub device: DeviceInfo,
    /// What it is doing.
    pub phase: Phase,
    /// True from before its camera streams until after it has stopped.
    pub in_use: bool,
    /// What is wrong with it and what to do; only where `phase` is `degraded`.
    pub problem: Option<String>,
    /// How often it was opened again.
    pub reconnects: u64,
}

/// `GET /v1/status`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatusReply {
    /// Version of the daemon.
    pub version: String,
    /// The devices it owns, in the order of the configuration.
    pub devices: Vec<DeviceStatus>,
    /// True while any camera streams.
    pub in_use: bool,
    /// Shots committed since the daemon started.
    pub shots: u64,
    /// Shots that failed since the daemon started.
    pub failures: u64,
    /// Name of the newest shot.
    pub latest: Option<String>,
    /// Bytes of all shots in the store.
    pub used_bytes: u64,
    /// What the caller may do.
    pub role: Role,
}

/// What a caller may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// See devices, previews and shots.
    Look,
    /// Also take and delete shots.
    Shoot,
}

/// `GET /v1/devices`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DevicesReply {
    /// Everything a driver can open now.
    #[schema(value_type = Vec<Object>)]
    pub devices: Vec<DeviceInfo>,
}

/// One line of `GET /v1/events`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case", tag = "event")]
pub enum Event {
    /// A device does something else now.
    Device {
        /// The device.
        address: String,
        /// What it does.
        phase: Phase,
        /// What is wrong with it.
        problem: Option<String>,
    },
    /// A shot is safe on the disk.
    Committed {
        /// The shot.
        id: String,
    },
    /// A shot is gone.
    Deleted {
        /// The shot.
        id: String,
    },
    /// The configuration was read again.
    Reloaded {
        /// What of it takes a restart, or why the last good one stays.
        notes: Vec<String>,
    },
}
