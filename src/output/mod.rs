//! Encoded results: EXR, PNG, the contact sheet and `shot.json`, in a folder committed atomically.

pub mod commit;
pub mod exr;
mod file_system;
pub mod film;
pub mod label;
pub mod manifest;
pub mod png;
mod results;
pub mod sheet;
mod staged_file;
pub mod tone;

pub use commit::{CommitError, Destination, Existing, FileEntry, JOURNAL, Staging, UNFINISHED};
pub use exr::{EncodeError, Precision};
pub use file_system::{Disk, FileSystem, NewFile};
pub use film::{Film, FilmError, FilmFormat};
pub use manifest::{LightEntry, Manifest, ManifestError};
pub use results::{FRAMES, OutputError, RelitView, Results, write};
pub use staged_file::StagedFile;
pub use tone::Tone;
