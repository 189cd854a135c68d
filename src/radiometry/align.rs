//! Alignment of an ambient frame on the flash frame.

use serde::Serialize;

/// What alignment came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AlignmentOutcome {
    /// There was nothing to align.
    NotNeeded,
    /// It was switched off.
    NotAsked,
    /// The pair lies on each other as well as can be told; nothing was moved.
    AlreadyAligned,
    /// The ambient frame was resampled.
    Aligned,
    /// Too few patches look the same under both lights; nothing was moved.
    TooLittleTexture,
}
