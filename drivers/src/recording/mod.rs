//! The on-disk form of what a device delivered: one MCAP file that any Foxglove viewer opens.
//!
//! | topic | schema | says |
//! |---|---|---|
//! | `/session` | `captured.Session` (JSON) | device, rig and settings, exactly; first in the file |
//! | `/color/calibration`, `/depth/calibration`, `/tf` | Foxglove's | the rig again, for viewers |
//! | `/frame` | `captured.FrameMetadata` (JSON) | time, sequence, light, exposure, curve of the frame whose images follow |
//! | `/color/image` or `/color/jpeg` | `foxglove.RawImage`, `foxglove.CompressedImage` | the picture |
//! | `/depth/image`, `/depth/amplitude`, `/depth/sigma` | `foxglove.RawImage`, `32FC1` | depth in metres, infrared, metres |
//!
//! Chunks are not compressed and end with each bracket, written and synced by
//! [`Writer::finish_bracket`]: after a crash a [`Reader`] gives every bracket that was finished and
//! says where the file is cut. Reading checks every length against the bytes that are there before
//! it allocates, and holds one chunk at a time.

mod container;
mod decode;
mod protobuf;
mod read;
mod schema;
mod summary;
mod write;

pub use read::Reader;
pub use summary::{Summary, summarize};
pub use write::Writer;

use crate::device::DriverError;
use std::path::Path;

/// Version of the layout of topics and messages.
const FORMAT: u32 = 1;
/// Largest chunk (one bracket) that is read, in bytes; three frames of 12 megapixels in floating
/// point fit.
pub const MAX_CHUNK_BYTES: u64 = 1 << 29;

const SESSION: &str = "/session";
const FRAME: &str = "/frame";
const COLOR_IMAGE: &str = "/color/image";
const COLOR_JPEG: &str = "/color/jpeg";
const COLOR_CALIBRATION: &str = "/color/calibration";
const DEPTH_IMAGE: &str = "/depth/image";
const DEPTH_AMPLITUDE: &str = "/depth/amplitude";
const DEPTH_SIGMA: &str = "/depth/sigma";
const DEPTH_CALIBRATION: &str = "/depth/calibration";
const TRANSFORM: &str = "/tf";

fn malformed(path: &Path, problem: impl Into<String>, remedy: &'static str) -> DriverError {
    DriverError::Malformed {
        path: path.to_owned(),
        problem: problem.into(),
        remedy,
    }
}

fn io(path: &Path, source: std::io::Error) -> DriverError {
    DriverError::Io {
        path: path.to_owned(),
        source,
    }
}
