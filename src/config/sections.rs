//! The tables of `captured.toml`.

use serde::{Deserialize, Serialize};
use std::{net::SocketAddr, time::Duration};

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
    /// Color frames of one burst; in 2..=64.
    pub burst: u32,
    /// Connections open at once; one more waits. In 1..=1024.
    pub connections: usize,
}

/// How long shots are kept, and how much room they may take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Shots {
    /// Most bytes of all shots together; a shot that may exceed it is refused before the flash
    /// fires. `None` = as much as the disk has.
    pub quota_bytes: Option<u64>,
    /// Bytes that stay free on the disk.
    pub keep_free_bytes: u64,
    /// How many shots are kept: with one more the oldest is deleted. `None` = none is ever deleted
    /// unasked.
    pub keep_newest: Option<usize>,
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

impl Default for Shots {
    fn default() -> Self {
        Self {
            quota_bytes: None,
            keep_free_bytes: 256 << 20,
            keep_newest: None,
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
            burst: 32,
            connections: 128,
        }
    }
}

impl Capture {
    /// What is asked of the device.
    pub fn settings(&self) -> drivers::Settings {
        drivers::Settings {
            exposure_seconds: self.exposure_seconds,
            gain: self.gain,
            flash_every: self.flash_every,
            flash_run: 1,
        }
    }

    /// Longest silence of the device.
    pub fn patience(&self) -> Duration {
        Duration::from_secs_f64(self.patience_seconds)
    }

    /// Longest wait for one shot of one bracket.
    pub fn deadline(&self) -> Duration {
        Duration::from_secs_f64(self.deadline_seconds)
    }

    /// Longest wait for one shot, of a burst of so many color frames: a bracket to measure the noise by,
    /// and as long again for every eight frames.
    pub fn deadline_of(&self, burst: Option<u32>) -> Duration {
        self.deadline() * (1 + burst.map_or(0, |frames| frames.div_ceil(8)))
    }
}

impl Limits {
    /// Longest time for one request.
    pub fn request_time(&self) -> Duration {
        Duration::from_secs_f64(self.request_seconds)
    }
}

/// Who may do what over the Unix socket. Whoever may open the socket may look.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Access {
    /// User ids that may take and delete shots, besides root and the daemon's own.
    pub shooter_uids: Vec<u32>,
    /// Group ids whose members may, when it is their process's own group.
    pub shooter_gids: Vec<u32>,
}

/// The page on which to look at shots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Viewer {
    /// Whether it is served.
    pub enabled: bool,
    /// Where; a loopback address.
    pub address: SocketAddr,
    /// Whether whoever has the token may take and delete shots, and not only look.
    pub may_shoot: bool,
    /// Further names by which browsers reach it, as `name:port`: the near end of a tunnel.
    pub hosts: Vec<String>,
}

impl Default for Viewer {
    fn default() -> Self {
        Self {
            enabled: false,
            address: SocketAddr::from(([127, 0, 0, 1], 8377)),
            may_shoot: true,
            hosts: Vec::new(),
        }
    }
}
