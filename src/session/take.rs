//! Frames from a device until a shot is whole.

use super::{SessionError, burst};
use crate::{
    config::Capture,
    radiometry::burst::BurstReport,
    shot::{Assembler, DropCounts, Limits, Shot},
};
use drivers::{Device, DeviceInfo, DriverError, Frame, Settings};
use std::time::{Duration, Instant};

/// A shot and where it came from.
#[derive(Debug, Clone)]
pub struct Taken {
    /// The frames.
    pub shot: Shot,
    /// The device.
    pub info: DeviceInfo,
    /// What was asked of it.
    pub settings: Settings,
    /// Frames that became part of no shot while this one was waited for.
    pub drops: DropCounts,
    /// Of a burst: of how many frames it was made.
    pub burst: Option<BurstReport>,
}

/// Longest wait without a word to whoever watches.
const BREATH: Duration = Duration::from_millis(500);

/// Streams from `device` until one shot is whole, of one bracket or with `burst` of so many color frames; the
/// device has stopped when this returns.
///
/// # Errors
/// [`SessionError::Device`] when the device fails or is silent for longer than its patience;
/// [`SessionError::NoShot`] when it streams past the deadline, or ends, without a whole shot. Of a burst, the
/// first bracket has the deadline of a shot and the rest as long again for every eight frames
/// ([`Capture::deadline_of`]). [`SessionError::Radiometry`] for a burst whose frames cannot be averaged.
pub fn take(
    device: &mut dyn Device,
    capture: &Capture,
    burst: Option<u32>,
) -> Result<Taken, SessionError> {
    take_watched(device, capture, burst, &Instant::now, &mut |_| {})
}

/// [`take`] by the clock of `now`; `alive` is called with the number of frames so far, at least every half
/// second for as long as the device keeps its patience.
///
/// # Errors
/// As [`take`].
pub fn take_watched(
    device: &mut dyn Device,
    capture: &Capture,
    burst: Option<u32>,
    now: &dyn Fn() -> Instant,
    alive: &mut dyn FnMut(u64),
) -> Result<Taken, SessionError> {
    let mut watch = Watch {
        capture,
        now,
        alive,
        frames: 0,
    };
    let bracket = bracket(device, &mut watch)?;
    match burst {
        None => Ok(bracket),
        Some(frames) => burst::after(bracket, device, &mut watch, frames),
    }
}

/// The shot of one bracket.
fn bracket(device: &mut dyn Device, watch: &mut Watch<'_>) -> Result<Taken, SessionError> {
    let settings = watch.capture.settings();
    let info = device.info();
    let mut assembler = Assembler::new(device.rig(), Limits::default());
    let mut shot = None;
    let streamed = watch.stream(device, &settings, watch.capture.deadline(), &mut |frame| {
        shot = assembler.push(frame);
        shot.is_some()
    })?;
    if streamed.ended {
        shot = assembler.finish().into_iter().next();
    }
    let drops = *assembler.drops();
    let shot = shot.ok_or_else(|| SessionError::NoShot {
        device: info.address.clone(),
        waited: streamed.took,
        drops: Box::new(drops),
    })?;
    Ok(Taken {
        shot,
        info,
        settings,
        drops,
        burst: None,
    })
}

/// Whoever waits for a shot, and by which clock.
pub(super) struct Watch<'a> {
    pub capture: &'a Capture,
    now: &'a dyn Fn() -> Instant,
    alive: &'a mut dyn FnMut(u64),
    /// Frames so far.
    frames: u64,
}

/// How a stream went.
pub(super) struct Streamed {
    /// By the device's own doing: a recording has no more frames.
    pub ended: bool,
    /// From its start on.
    pub took: Duration,
}

impl Watch<'_> {
    /// Streams until `push` says that it has enough, the device has no more, or the deadline has passed.
    pub fn stream(
        &mut self,
        device: &mut dyn Device,
        settings: &Settings,
        deadline: Duration,
        push: &mut dyn FnMut(Frame) -> bool,
    ) -> Result<Streamed, SessionError> {
        let patience = self.capture.patience();
        let started = (self.now)();
        let since = |moment: Instant| (self.now)().saturating_duration_since(moment);
        let mut heard = started;
        let mut stream = device.start(settings)?;
        let ended = loop {
            let left = deadline.saturating_sub(since(started));
            if left.is_zero() {
                break false;
            }
            (self.alive)(self.frames);
            match stream.next_frame(patience.min(left).min(BREATH)) {
                Ok(frame) => {
                    self.frames += 1;
                    heard = (self.now)();
                    if push(frame) {
                        break false;
                    }
                }
                Err(DriverError::Ended { .. }) => break true,
                // A stream may be asked again after a silence; how long in all, the owner decides.
                Err(DriverError::Timeout { .. }) if since(heard) < patience => {}
                Err(DriverError::Timeout { device, .. }) => {
                    return Err(DriverError::Timeout { device, patience }.into());
                }
                Err(error) => return Err(error.into()),
            }
        };
        drop(stream);
        let took = since(started);
        Ok(Streamed { ended, took })
    }
}
