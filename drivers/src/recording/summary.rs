//! What is in a recording, at a glance.

use super::read::Reader;
use crate::{
    admission,
    device::{DeviceInfo, DriverError, Settings},
    frame::{Frame, Illumination, Timestamp},
};
use serde::Serialize;
use std::path::Path;

/// What is in a recording, for `capturectl info`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The device it was recorded from.
    pub device: DeviceInfo,
    /// What was asked of it.
    pub settings: Settings,
    /// Color camera, `(width, height)` in pixels.
    pub color_size: (usize, usize),
    /// Depth camera, `(width, height)` in pixels.
    pub depth_size: (usize, usize),
    /// Color frames in the room's light alone.
    pub ambient_frames: u64,
    /// Color frames with the flash.
    pub flash_frames: u64,
    /// Depth frames.
    pub depth_frames: u64,
    /// Color frames the device counted and the recording lacks.
    pub color_gaps: u64,
    /// Depth frames the device counted and the recording lacks.
    pub depth_gaps: u64,
    /// Time of the earliest frame; `None` without frames.
    pub first: Option<Timestamp>,
    /// Time of the latest frame.
    pub last: Option<Timestamp>,
    /// From the earliest frame to the latest, seconds.
    pub duration_seconds: f64,
    /// Chunks: one for the session, then one per bracket.
    pub chunks: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Byte at which the file is cut; `None` = it was closed properly.
    pub truncated_at: Option<u64>,
}

/// Reads a recording to its end, frame by frame, and sums it up.
///
/// # Errors
/// As [`Reader::open`] and its iterator.
pub fn summarize(path: impl AsRef<Path>) -> Result<Summary, DriverError> {
    let mut reader = Reader::open(path)?;
    let mut summary = Summary {
        device: reader.info().clone(),
        settings: reader.settings().clone(),
        color_size: reader.rig().color.size(),
        depth_size: admission::depth_size(reader.rig()),
        ambient_frames: 0,
        flash_frames: 0,
        depth_frames: 0,
        color_gaps: 0,
        depth_gaps: 0,
        first: None,
        last: None,
        duration_seconds: 0.0,
        chunks: 0,
        bytes: reader.bytes(),
        truncated_at: None,
    };
    let (mut color, mut depth): (Span, Span) = Default::default();
    for frame in reader.by_ref() {
        let frame = frame?;
        let at = frame.at();
        summary.first = Some(summary.first.map_or(at, |first| first.min(at)));
        summary.last = Some(summary.last.map_or(at, |last| last.max(at)));
        match &frame {
            Frame::Color(frame) => {
                color.add(frame.sequence);
                match frame.light {
                    Illumination::Ambient => summary.ambient_frames += 1,
                    Illumination::Flash => summary.flash_frames += 1,
                }
            }
            Frame::Depth(frame) => {
                depth.add(frame.sequence);
                summary.depth_frames += 1;
            }
        }
    }
    summary.color_gaps = color.gaps();
    summary.depth_gaps = depth.gaps();
    if let (Some(first), Some(last)) = (summary.first, summary.last) {
        summary.duration_seconds = last.distance(first).as_secs_f64();
    }
    summary.chunks = reader.chunks();
    summary.truncated_at = reader.truncated_at();
    Ok(summary)
}

/// Sequence numbers seen, however they were ordered.
#[derive(Default)]
struct Span {
    range: Option<(u64, u64)>,
    count: u64,
}

impl Span {
    fn add(&mut self, sequence: u64) {
        let (low, high) = self.range.unwrap_or((sequence, sequence));
        self.range = Some((low.min(sequence), high.max(sequence)));
        self.count += 1;
    }

    fn gaps(&self) -> u64 {
        self.range.map_or(0, |(low, high)| {
            (high - low).saturating_add(1).saturating_sub(self.count)
        })
    }
}
