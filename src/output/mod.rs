//! Encoded results: EXR, PNG, the contact sheet and `shot.json`, in a folder committed atomically.

pub mod commit;
pub mod exr;
pub mod png;
pub mod tone;

pub use commit::{CommitError, Disk, Existing, FileEntry, FileSystem, Staging};
pub use exr::{EncodeError, Precision};
pub use tone::Tone;
