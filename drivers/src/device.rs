//! Devices and their streams: the trait every driver implements.

use crate::{calibration::Rig, frame::Frame};
use serde::{Deserialize, Serialize};
use std::{
    path::{Path, PathBuf},
    time::Duration,
};
use thiserror::Error;

/// What a device is, for people and for logs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceInfo {
    /// The address that opens it again, e.g. `synthetic:desk` or `replay:/path/to/file.mcap`.
    pub address: String,
    /// Driver name.
    pub driver: String,
    /// Human-readable model.
    pub model: String,
    /// True when its frames end by themselves, as a recording's do.
    pub finite: bool,
}

/// What is *asked* of a device for one session; what was granted stands in every frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Exposure wanted for both lights, seconds; `None` = the device's own choice.
    pub exposure_seconds: Option<f32>,
    /// Linear gain wanted; `None` = the device's own choice.
    pub gain: Option<f32>,
    /// Flash pattern: flash fires on every `flash_every`-th color frame; ≥ 2, so that brackets
    /// ambient–flash–ambient exist. 0 = it never fires, for looking through the camera; a driver
    /// that cannot keep it from firing refuses that.
    pub flash_every: u32,
    /// How many color frames in a row are lit each time, in 1..`flash_every`: more than one for bursts,
    /// where flash frames have more noise than the others.
    #[serde(skip_serializing_if = "is_one")]
    pub flash_run: u32,
}

/// What goes without saying is not written into recordings.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_one(count: &u32) -> bool {
    *count == 1
}

impl Settings {
    /// Refuses a flash pattern that is none.
    ///
    /// # Errors
    /// [`DriverError::Setting`] with what is possible.
    pub fn check_pattern(&self, device: &str) -> Result<(), DriverError> {
        let Self {
            flash_every: every,
            flash_run: run,
            ..
        } = *self;
        let refuse = |setting, reason| {
            Err(DriverError::Setting {
                device: device.to_owned(),
                setting,
                reason,
            })
        };
        if every == 1 {
            let reason =
                "1; at least 2, so that ambient frames exist, or 0 for no flash".to_owned();
            return refuse("flash_every", reason);
        }
        if run == 0 || (every > 0 && run >= every) {
            let reason = format!("{run}; at least 1 and fewer than flash_every, which is {every}");
            return refuse("flash_run", reason);
        }
        Ok(())
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            exposure_seconds: None,
            gain: None,
            flash_every: 3,
            flash_run: 1,
        }
    }
}

/// Why a device gave no frame.
#[derive(Debug, Error)]
pub enum DriverError {
    /// Nothing arrived within the patience given; the stream may be asked again.
    #[error("{device}: no frame within {patience:?}; check the cable or raise the patience")]
    Timeout {
        /// Device address.
        device: String,
        /// How long was waited.
        patience: Duration,
    },
    /// The device is gone; close it, and open it again when it is back.
    #[error("{device}: unplugged; plug it in and start again")]
    Unplugged {
        /// Device address.
        device: String,
    },
    /// A finite device has no frame left.
    #[error("{device}: end of recording")]
    Ended {
        /// Device address.
        device: String,
    },
    /// A setting the device cannot grant.
    #[error("{device}: cannot set {setting}: {reason}")]
    Setting {
        /// Device address.
        device: String,
        /// Name of the setting.
        setting: &'static str,
        /// What is possible instead.
        reason: String,
    },
    /// Bytes that are not what they claim to be.
    #[error("{path}: {problem}; {remedy}")]
    Malformed {
        /// The file (or device address).
        path: PathBuf,
        /// What is wrong, with the field or byte offset.
        problem: String,
        /// What to do.
        remedy: &'static str,
    },
    /// No such driver or device.
    #[error("no device at {address:?}: {reason}")]
    NoDevice {
        /// Address asked for.
        address: String,
        /// What was looked for.
        reason: String,
    },
    /// The device is there and does not do what it should.
    #[error("{device}: {problem}; {remedy}")]
    Hardware {
        /// Device address or node.
        device: String,
        /// What went wrong, in which part.
        problem: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The operating system refused.
    #[error("{path}: {source}; check that it exists, may be accessed and has space")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
}

/// Something that takes pictures.
pub trait Device: Send {
    /// What it is.
    fn info(&self) -> DeviceInfo;

    /// Its geometry.
    fn rig(&self) -> Rig;

    /// The file in which its rig was measured, where it applies one by itself: distances have then lost
    /// that file's offset, and must not lose another's too.
    fn rig_file(&self) -> Option<&Path> {
        None
    }

    /// Whether it is still there, asked several times a second while nothing streams: it must neither
    /// wake the device nor take a millisecond, and what a device does between two sessions is no loss.
    ///
    /// # Errors
    /// [`DriverError::Unplugged`] when it is gone.
    fn presence(&mut self) -> Result<(), DriverError> {
        Ok(())
    }

    /// Starts streaming. Frames come in the order each camera took them; the two cameras may
    /// interleave in any way.
    ///
    /// # Errors
    /// [`DriverError::Setting`] for settings it cannot grant; [`DriverError::Unplugged`] or
    /// [`DriverError::Io`] when it cannot start.
    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError>;
}

/// A running capture; dropping it stops the device and puts its flash out.
pub trait Stream {
    /// What was asked for when it started.
    fn settings(&self) -> &Settings;

    /// Waits for the next frame.
    ///
    /// # Errors
    /// [`DriverError::Timeout`] after `patience` without a frame (the stream stays usable),
    /// [`DriverError::Ended`] at the end of a finite device, [`DriverError::Unplugged`] when the
    /// device is gone, [`DriverError::Malformed`] for a frame that is not what it claims to be,
    /// [`DriverError::Hardware`] when the device is there and fails.
    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError>;

    /// Frames that were not delivered since the stream started.
    fn losses(&self) -> Losses {
        Losses::default()
    }
}

/// Frames that a stream did not deliver, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Losses {
    /// Gaps in the device's own count.
    pub missed: u64,
    /// Flagged as wrong by the device, too short, or not what was negotiated.
    pub broken: u64,
    /// Of unknown light: exposed while the flash went on or off, or while a control settled.
    pub unlit: u64,
    /// Delivered by the device with a time that its clock cannot have had; the time of arrival was
    /// used instead. These were delivered all the same.
    pub misdated: u64,
}
