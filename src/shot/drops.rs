//! Frames that became part of no shot, counted by reason.

use serde::{Deserialize, Serialize};

/// How many frames were let go, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct DropCounts {
    /// Refused at the door: wrong size, exposure, levels or samples.
    pub malformed: u64,
    /// Color frames whose pixels could not be read (a broken JPEG).
    pub unreadable: u64,
    /// Seen before: same camera, same time.
    pub duplicate: u64,
    /// Older than what is remembered, so that it cannot be told from a duplicate.
    pub late: u64,
    /// Frames whose stated light the pixels contradict: a flash frame no brighter than a neighbour,
    /// and that neighbour.
    pub contradicted: u64,
    /// Flash frames that the flash lit in a part of the rows only, as under a rolling shutter.
    pub partly_lit: u64,
    /// Flash frames where nothing could be compared (all clipped).
    pub unproven: u64,
    /// Flash frames without an ambient frame near enough in time.
    pub flash_without_ambient: u64,
    /// Flash frames without a depth frame near enough in time.
    pub flash_without_depth: u64,
    /// Good ambient frames that no flash frame needed.
    pub unused_ambient: u64,
    /// Good depth frames that no flash frame needed.
    pub unused_depth: u64,
}

impl DropCounts {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.harmful() + self.unused_ambient + self.unused_depth
    }

    /// All but the frames that were merely not needed.
    pub fn harmful(&self) -> u64 {
        self.malformed
            + self.unreadable
            + self.duplicate
            + self.late
            + self.contradicted
            + self.partly_lit
            + self.unproven
            + self.flash_without_ambient
            + self.flash_without_depth
    }
}
