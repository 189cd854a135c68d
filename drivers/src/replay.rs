//! A recording as a device: the same frames in the same order, as often as it is started.

use crate::{
    calibration::Rig,
    device::{Device, DeviceInfo, DriverError, Settings, Stream},
    frame::Frame,
    recording::Reader,
};
use std::{
    path::{Path, PathBuf},
    time::Duration,
};

/// A device whose frames come from a file. It is finite and never waits.
#[derive(Debug, Clone)]
pub struct Replay {
    path: PathBuf,
    info: DeviceInfo,
    rig: Rig,
}

impl Replay {
    /// Opens a recording to be played.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, DriverError> {
        let path = path.as_ref();
        let reader = Reader::open(path)?;
        let recorded = reader.info();
        let info = DeviceInfo {
            address: format!("replay:{}", path.display()),
            driver: "replay".into(),
            model: format!("{} ({})", recorded.model, recorded.address),
            finite: true,
        };
        Ok(Self {
            path: path.to_owned(),
            info,
            rig: *reader.rig(),
        })
    }
}

impl Device for Replay {
    fn info(&self) -> DeviceInfo {
        self.info.clone()
    }

    fn rig(&self) -> Rig {
        self.rig
    }

    /// Plays from the beginning. `settings` cannot change what was recorded: each frame states
    /// the exposure that was granted then.
    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        let reader = Reader::open(&self.path)?;
        if *reader.rig() != self.rig {
            return Err(DriverError::Malformed {
                path: self.path.clone(),
                problem: "the rig is not the one it had when it was opened".into(),
                remedy: "open the recording again",
            });
        }
        let device = self.info.address.clone();
        Ok(Box::new(Playing {
            reader,
            settings: settings.clone(),
            device,
        }))
    }
}

struct Playing {
    reader: Reader,
    settings: Settings,
    device: String,
}

impl Stream for Playing {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, _patience: Duration) -> Result<Frame, DriverError> {
        self.reader.next().unwrap_or_else(|| {
            Err(DriverError::Ended {
                device: self.device.clone(),
            })
        })
    }
}
