//! Pictures of one running camera: taken, dated, and looked at before they are believed.

use super::{buffers::Buffers, camera::Camera, clock::Clock, plan::CameraPlan, unpack::Unpacker};
use crate::{
    device::DriverError,
    frame::Timestamp,
    node::{Event, Filled, is_gone, refused},
};
use rustix::io::Errno;
use std::{io, time::Duration};

/// One running camera.
pub(super) struct Flow {
    pub buffers: Buffers,
    pub clock: Clock,
    unpacker: Unpacker,
    /// Pictures that were flagged, short or not what was granted, and how many of them in a row.
    pub broken: u64,
    broken_in_a_row: u32,
    /// When it last delivered anything.
    pub heard: Timestamp,
}

/// Wrong pictures in a row after which the device itself is.
const MOST_BROKEN: u32 = 16;

/// What a buffer turned out to be.
pub(super) enum Taken<A> {
    /// A picture of this time and number.
    Picture(Timestamp, u64, A),
    /// Nothing that goes any further.
    Nothing,
}

impl Flow {
    /// Starts the camera.
    pub fn start(camera: Camera, plan: &CameraPlan) -> Result<Self, DriverError> {
        let path = camera.node.path().to_owned();
        let clock = Clock::new(
            plan.stamp,
            plan.offset_seconds,
            Duration::from_secs_f64(plan.readout_seconds),
        );
        let multiplanar = camera.capabilities.multiplanar;
        let buffers = Buffers::start(camera.node, multiplanar, plan.buffers)
            .map_err(|error| refused(&path, "starting the stream", error))?;
        Ok(Self {
            buffers,
            clock,
            unpacker: camera.unpacker,
            broken: 0,
            broken_in_a_row: 0,
            heard: Timestamp::now(),
        })
    }

    /// Takes what has arrived, if anything has, and lets `read` make a picture of it. `read` answers
    /// `Ok(None)` for a picture that is sound and not wanted.
    ///
    /// # Errors
    /// [`DriverError::Unplugged`] when the device has gone; [`DriverError::Hardware`] when it failed;
    /// [`DriverError::Malformed`] when it delivers nothing but wrong pictures.
    pub fn take<A>(
        &mut self,
        exposure: Duration,
        read: impl FnOnce(&Unpacker, Timestamp, &[&[u8]]) -> Result<Option<A>, String>,
    ) -> Result<Taken<A>, DriverError> {
        let now = Timestamp::now();
        let (clock, unpacker) = (&mut self.clock, &self.unpacker);
        let taken = self.buffers.take(|filled: &Filled, planes| {
            let placed = clock.place(filled, exposure, now);
            if filled.flags.error {
                return Err("flagged as wrong by the device".to_owned());
            }
            let Some((at, sequence)) = placed else {
                return Ok(None);
            };
            let picture = read(unpacker, at, planes)?;
            Ok(picture.map(|picture| (at, sequence, picture)))
        });
        match taken.map_err(|error| self.failed(error))? {
            None => Ok(Taken::Nothing),
            Some(Ok(picture)) => {
                self.heard = now;
                self.broken_in_a_row = 0;
                Ok(match picture {
                    Some((at, sequence, picture)) => Taken::Picture(at, sequence, picture),
                    None => Taken::Nothing,
                })
            }
            Some(Err(problem)) => {
                self.heard = now;
                self.broken += 1;
                self.broken_in_a_row += 1;
                if self.broken_in_a_row < MOST_BROKEN {
                    return Ok(Taken::Nothing);
                }
                Err(DriverError::Malformed {
                    path: self.buffers.node().path().to_owned(),
                    problem: format!("{MOST_BROKEN} wrong pictures in a row, the last {problem}"),
                    remedy: "check cable and hub, ask for a smaller size, or plug the device in anew",
                })
            }
        }
    }

    /// Takes the events that wait; answers whether exposure or gain were changed by somebody.
    pub fn events(&self) -> Result<bool, DriverError> {
        let node = self.buffers.node();
        let mut changed = false;
        loop {
            match node.event() {
                Ok(Event::ControlChanged(_)) => changed = true,
                Ok(Event::SourceChanged) => {
                    return Err(DriverError::Hardware {
                        device: node.path().display().to_string(),
                        problem: "its picture changed size or kind while streaming".into(),
                        remedy: "start again",
                    });
                }
                Ok(Event::Other) => {}
                Err(error) if is_gone(&error) => {
                    return Err(refused(node.path(), "asking for events", error));
                }
                Err(_) => return Ok(changed),
            }
        }
    }

    /// What a refusal in the middle of a stream means.
    pub fn failed(&self, error: io::Error) -> DriverError {
        let node = self.buffers.node();
        // A driver that is unbound under a stream may answer EINVAL before its node goes.
        let invalid = Errno::from_io_error(&error) == Some(Errno::INVAL);
        let gone = invalid
            && (!node.path().exists() || node.capabilities().is_err_and(|error| is_gone(&error)));
        if gone {
            return DriverError::Unplugged {
                device: node.path().display().to_string(),
            };
        }
        refused(node.path(), "taking a picture", error)
    }
}
