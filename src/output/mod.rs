//! Encoded results: EXR, PNG, the contact sheet and `shot.json`, in a folder committed atomically.

pub mod commit;
pub mod exr;
pub mod label;
pub mod manifest;
pub mod png;
mod results;
pub mod sheet;
mod staged_file;
pub mod tone;

pub use commit::{CommitError, Disk, Existing, FileEntry, FileSystem, Staging};
pub use exr::{EncodeError, Precision};
pub use manifest::{LightEntry, Manifest, ManifestError};
pub use results::{FRAMES, OutputError, RelitView, Results, write};
pub use staged_file::StagedFile;
pub use tone::Tone;
