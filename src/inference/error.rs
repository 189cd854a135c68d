//! Why there is no network to ask.

use super::{library::LibraryError, onnx::OnnxError};
use std::path::PathBuf;
use thiserror::Error;

/// Why there is no network to ask. Nothing of it touches the closed-form tier.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum InferenceError {
    #[error("models/manifest.toml: {problem}; this build is broken, install another")]
    Manifest { problem: String },
    #[error(
        "models/manifest.toml of this program lists no {name} network of variant {variant} (it lists {listed}); use --tier closed, which needs no network"
    )]
    NotListed {
        name: String,
        variant: String,
        listed: String,
    },
    #[error(
        "{file}: not found in {}; give the folder of the models with --models DIR or inference.models in captured.toml, or use --tier closed, which needs no network",
        list(.tried)
    )]
    NotFound { file: String, tried: Vec<PathBuf> },
    #[error("{path}: cannot be read: {source}; use --tier closed, which needs no network")]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(
        "{path}: {found} bytes, but models/manifest.toml states {stated}: the file is truncated or another; fetch it again, or use --tier closed, which needs no network"
    )]
    Length {
        path: PathBuf,
        found: String,
        stated: u64,
    },
    #[error(
        "{path}: its BLAKE3 is {found}, but models/manifest.toml states {stated}: the file was altered; fetch it again, or use --tier closed, which needs no network"
    )]
    Hash {
        path: PathBuf,
        found: String,
        stated: String,
    },
    #[error("{path}: {source}; export it again, or use --tier closed, which needs no network")]
    Onnx { path: PathBuf, source: OnnxError },
    #[error(
        "{path}: {problem}, which is not what models/manifest.toml states; export it again, or use --tier closed, which needs no network"
    )]
    Signal { path: PathBuf, problem: String },
    #[error(transparent)]
    Library(#[from] LibraryError),
    #[error(
        "inference cannot start: {problem}; see `capturectl runtime status`, or use --tier closed, which needs no network"
    )]
    Start { problem: String },
}

fn list(paths: &[PathBuf]) -> String {
    let names: Vec<String> = paths
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    names.join(", ")
}
