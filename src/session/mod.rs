//! One shot from a device, in whatever process: taken, developed, kept.

mod burst;
mod calibrated;
mod keep;
mod take;

pub use calibrated::open;
pub use keep::{Kept, keep};
pub use take::{Taken, take, take_watched};

use crate::{
    api::{Fault, FaultKind},
    darkroom::DarkroomError,
    folder::FolderError,
    output::{CommitError, OutputError},
    radiometry::RadiometryError,
    shot::DropCounts,
};
use drivers::DriverError;
use std::{path::PathBuf, time::Duration};
use thiserror::Error;

/// Why there is no shot.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum SessionError {
    #[error(transparent)]
    Device(#[from] DriverError),
    #[error("{device}: no shot within {waited:.1?} ({}); {}", words(.drops), remedy(.drops))]
    NoShot {
        device: String,
        waited: Duration,
        drops: Box<DropCounts>,
    },
    #[error(transparent)]
    Darkroom(#[from] DarkroomError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Radiometry(#[from] RadiometryError),
    #[error(transparent)]
    Rig(#[from] FolderError),
    #[error(
        "{path}: is of another rig ({found}) than {device} ({expected}); calibrate that device"
    )]
    ForeignRig {
        path: PathBuf,
        device: String,
        found: String,
        expected: String,
    },
    #[error(
        "{device} applies the rig file {own} by itself, and captured.toml names {path} for it: distances \
         would lose the offsets of both; take `rig` out of one of the two"
    )]
    TwoRigs {
        path: PathBuf,
        own: PathBuf,
        device: String,
    },
}

impl From<CommitError> for SessionError {
    fn from(error: CommitError) -> Self {
        Self::Output(error.into())
    }
}

impl SessionError {
    /// Which part failed, in which words.
    pub fn fault(&self) -> Fault {
        let kind = match self {
            Self::Device(error) => kind_of(error),
            Self::NoShot { .. } => FaultKind::Device,
            Self::Darkroom(error) => error.kind(),
            Self::Radiometry(_) => FaultKind::Shot,
            Self::Output(_) => FaultKind::Output,
            Self::Rig(_) | Self::ForeignRig { .. } | Self::TwoRigs { .. } => FaultKind::Input,
        };
        Fault {
            kind,
            message: self.to_string(),
            remedy: None,
        }
    }
}

/// Which part a driver's error speaks of: bytes that lie are the file's fault, not the device's.
pub fn kind_of(error: &DriverError) -> FaultKind {
    match error {
        DriverError::Malformed { .. } | DriverError::Io { .. } => FaultKind::Input,
        _ => FaultKind::Device,
    }
}

/// The reasons that apply, with their counts.
fn words(drops: &DropCounts) -> String {
    let reasons = [
        (drops.malformed, "malformed"),
        (drops.unreadable, "unreadable"),
        (drops.duplicate, "seen before"),
        (drops.late, "too late"),
        (drops.contradicted, "of a light their pixels contradict"),
        (drops.partly_lit, "flash frames lit in a part of the rows"),
        (drops.unproven, "flash frames that could not be proved"),
        (
            drops.flash_without_ambient,
            "flash frames without an ambient frame",
        ),
        (drops.flash_without_depth, "flash frames without depth"),
    ];
    let said: Vec<String> = reasons
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, reason)| format!("{count} frames {reason}").replace("frames flash", "flash"))
        .collect();
    if said.is_empty() {
        "no flash frame came".to_owned()
    } else {
        said.join(", ")
    }
}

/// What to do about the commonest reason.
fn remedy(drops: &DropCounts) -> &'static str {
    if drops.contradicted + drops.unproven > 0 {
        "check that the flash fires and that the scene is neither clipped nor too far away"
    } else if drops.partly_lit > 0 {
        "let the flash burn from before the first row's exposure to after the last row's, or \
         lengthen the exposure beyond the sensor's readout"
    } else if drops.flash_without_depth > 0 {
        "check the depth camera and the clocks of the two cameras"
    } else {
        "check the device with `capturectl check-device`, or raise capture.deadline_seconds"
    }
}
