//! Frames from a device until a shot is whole.

use super::SessionError;
use crate::{
    config::Capture,
    radiometry::burst::BurstReport,
    shot::{Assembler, DropCounts, Limits, Shot},
};
use drivers::{Device, DeviceInfo, DriverError, Settings};
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

/// Streams from `device` until one shot is whole; the device has stopped when this returns.
///
/// # Errors
/// [`SessionError::Device`] when the device fails or is silent for longer than its patience;
/// [`SessionError::NoShot`] when it streams past the deadline, or ends, without a whole shot.
pub fn take(device: &mut dyn Device, capture: &Capture) -> Result<Taken, SessionError> {
    take_watched(device, capture, &Instant::now, &mut |_| {})
}

/// [`take`] by the clock of `now`; `alive` is called with the number of frames so far, at least every
/// half second for as long as the device keeps its patience.
///
/// # Errors
/// As [`take`].
pub fn take_watched(
    device: &mut dyn Device,
    capture: &Capture,
    now: &dyn Fn() -> Instant,
    alive: &mut dyn FnMut(u64),
) -> Result<Taken, SessionError> {
    let settings = capture.settings();
    let info = device.info();
    let mut assembler = Assembler::new(device.rig(), Limits::default());
    let started = now();
    let since = |moment: Instant| now().saturating_duration_since(moment);
    let mut heard = started;
    let mut frames = 0;
    let mut stream = device.start(&settings)?;
    let shot = loop {
        let left = capture.deadline().saturating_sub(since(started));
        if left.is_zero() {
            break None;
        }
        alive(frames);
        match stream.next_frame(capture.patience().min(left).min(BREATH)) {
            Ok(frame) => {
                frames += 1;
                heard = now();
                if let Some(shot) = assembler.push(frame) {
                    break Some(shot);
                }
            }
            Err(DriverError::Ended { .. }) => break assembler.finish().into_iter().next(),
            // A stream may be asked again after a silence; how long in all, the owner decides.
            Err(DriverError::Timeout { .. }) if since(heard) < capture.patience() => {}
            Err(DriverError::Timeout { device, .. }) => {
                let patience = capture.patience();
                return Err(DriverError::Timeout { device, patience }.into());
            }
            Err(error) => return Err(error.into()),
        }
    };
    drop(stream);
    let drops = *assembler.drops();
    let waited = since(started);
    let shot = shot.ok_or_else(|| SessionError::NoShot {
        device: info.address.clone(),
        waited,
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
