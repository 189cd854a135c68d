//! Why a capture folder was not read.

use super::decode::ImageError;
use crate::output::CommitError;
use drivers::DriverError;
use std::path::PathBuf;
use thiserror::Error;

/// A capture folder that contradicts itself; every message names file, field and remedy.
#[derive(Debug, Error)]
pub enum FolderError {
    /// A file the folder cannot do without.
    #[error("{path}: missing; {remedy}")]
    Missing {
        /// What was looked for.
        path: PathBuf,
        /// What to do.
        remedy: String,
    },
    /// The operating system refused.
    #[error("{path}: {source}; check that it exists, may be accessed and has space")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// A TOML file that does not parse, or has an unknown or missing key.
    #[error("{path}: {problem}; correct that key (the capture-folder format lists all of them)")]
    Toml {
        /// The file.
        path: PathBuf,
        /// Line, column and key.
        problem: String,
    },
    /// A field with a value that cannot be.
    #[error("{path}: {field} {problem}; {remedy}")]
    Field {
        /// The file.
        path: PathBuf,
        /// The field, as `table.key`.
        field: String,
        /// What is wrong with it.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// An image that cannot be decoded or has the wrong size.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A shot that a capture folder cannot hold.
    #[error("{path}: {problem}; {remedy}")]
    Unwritable {
        /// Where it was to be written.
        path: PathBuf,
        /// What cannot be held.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// The folder could not be written whole, and so was not.
    #[error(transparent)]
    Commit(#[from] CommitError),
    /// The recording could not be written.
    #[error(transparent)]
    Recording(#[from] DriverError),
}
