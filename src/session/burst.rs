//! Many frames become one shot with less noise.

use super::{
    SessionError, Taken,
    take::{Streamed, Watch},
};
use crate::{
    radiometry::burst::{BurstReport, merge, noise_ratio, pattern, split},
    shot::{Gathering, Limits},
};
use drivers::{Device, Settings};

/// Measures the noise of both lights by a first bracket, then takes `frames` color frames, shared out so
/// that the flash's light has the least noise, and makes one shot of them. What a device leaves out, or
/// ends before, is missing in it and said.
pub(super) fn after(
    bracket: Taken,
    device: &mut dyn Device,
    watch: &mut Watch<'_>,
    frames: u32,
) -> Result<Taken, SessionError> {
    let noise_ratio = noise_ratio(&bracket.shot)?;
    let [run, rest] = pattern(noise_ratio);
    let wanted = split(frames, noise_ratio);
    let settings = Settings {
        flash_every: run + rest,
        flash_run: run,
        ..watch.capture.settings()
    };
    let mut gathering = Gathering::new(
        device.rig(),
        Limits::default(),
        wanted.map(|count| count as usize),
    );
    let deadline = watch.capture.deadline_of(Some(frames)) - watch.capture.deadline();
    let Streamed { took, .. } = watch.stream(device, &settings, deadline, &mut |frame| {
        gathering.push(frame)
    })?;
    let (burst, drops) = gathering.finish();
    let burst = burst.ok_or_else(|| SessionError::NoShot {
        device: bracket.info.address.clone(),
        waited: took,
        drops: Box::new(drops),
    })?;
    let used = [&burst.flash, &burst.ambient].map(|frames| frames.len() as u32);
    Ok(Taken {
        shot: merge(&burst)?,
        settings,
        drops,
        burst: Some(BurstReport::new(frames, noise_ratio, used)),
        ..bracket
    })
}
