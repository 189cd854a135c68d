//! Many frames become one shot with less noise.

use super::{SessionError, Taken, take};
use crate::{
    config::Capture,
    radiometry::burst::{BurstReport, merge, noise_ratio, pattern, split},
    shot::{Gathering, Limits},
};
use drivers::{Device, DriverError, Settings};
use std::time::Instant;

/// Takes one bracket to measure the noise of both lights, then `frames` color frames, shared out so that
/// the flash's light has the least noise, and makes one shot of them. What a device leaves out, or ends
/// before, is missing in it and said.
///
/// # Errors
/// As [`take`], which the first bracket is; the burst has as long again for every eight frames.
pub fn take_burst(
    device: &mut dyn Device,
    capture: &Capture,
    frames: u32,
) -> Result<Taken, SessionError> {
    let metering = take(device, capture)?;
    let noise_ratio = noise_ratio(&metering.shot)?;
    let [run, rest] = pattern(noise_ratio);
    let wanted = split(frames, noise_ratio);
    let settings = Settings {
        flash_every: run + rest,
        flash_run: run,
        ..capture.settings()
    };
    let mut gathering = Gathering::new(
        device.rig(),
        Limits::default(),
        wanted.map(|count| count as usize),
    );
    let mut stream = device.start(&settings)?;
    let (started, mut heard) = (Instant::now(), Instant::now());
    let deadline = capture.deadline() * frames.div_ceil(8);
    while started.elapsed() < deadline {
        match stream.next_frame(capture.patience()) {
            Ok(frame) => {
                heard = Instant::now();
                if gathering.push(frame) {
                    break;
                }
            }
            Err(DriverError::Ended { .. }) => break,
            Err(DriverError::Timeout { .. }) if heard.elapsed() < capture.patience() => {}
            Err(error) => return Err(error.into()),
        }
    }
    drop(stream);
    let (burst, drops) = gathering.finish();
    let burst = burst.ok_or_else(|| SessionError::NoShot {
        device: metering.info.address.clone(),
        waited: started.elapsed(),
        drops: Box::new(drops),
    })?;
    let used = [&burst.flash, &burst.ambient].map(|frames| frames.len() as u32);
    Ok(Taken {
        shot: merge(&burst)?,
        settings,
        drops,
        burst: Some(BurstReport::new(frames, noise_ratio, used)),
        ..metering
    })
}
