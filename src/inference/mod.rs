//! Networks from files: which are accepted, where they are looked for, and what runs them.
//!
//! A model is accepted only by the BLAKE3 that this program was built with (`models/manifest.toml`),
//! and never with parts in other files. ONNX Runtime runs it where its library is configured or
//! found, else tract, which is part of this program.

mod error;
mod library;
mod manifest;
mod model_file;
mod onnx;
mod protobuf;
mod runtime;
mod session;
mod sizes;

pub use error::InferenceError;
pub use library::{Found, LibraryError, Refused, fetch_folder, find, places as library_places};
pub use manifest::{Manifest, Model, Side, Signal};
pub use model_file::{ModelFile, places as model_places};
pub use onnx::{OnnxError, inspect};
pub use runtime::{Backend, Runtime};
pub use session::NetworkSession;

use crate::relight::networks::{Network, Paper, Variant, compact::Compact};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What the owner of the machine says about inference; `None` = found by itself.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Folder that holds the model files, as `models/` of the source tree does.
    pub models: Option<PathBuf>,
    /// ONNX Runtime's shared library.
    pub runtime: Option<PathBuf>,
    /// Threads that one network may use, in 1..=64.
    pub threads: Option<usize>,
}

/// Most threads that a network is given unasked: beyond them small pictures gain nothing.
const USUAL_THREADS: usize = 8;

impl Settings {
    /// Threads that one network may use.
    pub fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| {
            std::thread::available_parallelism().map_or(1, |found| found.get().min(USUAL_THREADS))
        })
    }
}

/// Reads and checks the three files of a variant without starting anything.
///
/// # Errors
/// [`InferenceError`] of the first file that is missing or not what the manifest states.
pub fn check_paper(variant: Variant, settings: &Settings) -> Result<(), InferenceError> {
    let manifest = Manifest::embedded()?;
    for name in ["decompose", "shadow", "synthesis"] {
        ModelFile::read(manifest.model(name, variant.name())?, settings)?;
    }
    Ok(())
}

/// Reads and checks the file of one network, and loads nothing.
///
/// # Errors
/// [`InferenceError`] as [`load`].
pub fn check(name: &str, variant: &str, settings: &Settings) -> Result<(), InferenceError> {
    ModelFile::read(Manifest::embedded()?.model(name, variant)?, settings).map(drop)
}

/// Loads the paper's three networks, and starts the runtime if none runs yet.
///
/// # Errors
/// [`InferenceError`] as [`load`].
pub fn load_paper(variant: Variant, settings: &Settings) -> Result<Paper, InferenceError> {
    let network = |name| load(name, variant.name(), settings);
    Ok(Paper {
        variant,
        decompose: network("decompose")?,
        shadow: network("shadow")?,
        synthesis: network("synthesis")?,
    })
}

/// Loads the two compact networks, and starts the runtime if none runs yet.
///
/// # Errors
/// [`InferenceError`] as [`load`].
pub fn load_compact(settings: &Settings) -> Result<Compact, InferenceError> {
    let network = |name| load(name, Variant::COMPACT, settings);
    Ok(Compact {
        surfaces: network("surfaces")?,
        light: network("light")?,
    })
}

/// Reads and checks the files of both compact networks without starting anything.
///
/// # Errors
/// [`InferenceError`] of the first file that is missing or not what the manifest states.
pub fn check_compact(settings: &Settings) -> Result<(), InferenceError> {
    check("surfaces", Variant::COMPACT, settings)?;
    check("light", Variant::COMPACT, settings)
}

/// Loads one network of this program's manifest.
///
/// # Errors
/// [`InferenceError`] where the manifest lists no such model, its file is missing or is not what the
/// manifest states, or no runtime starts.
pub fn load(
    name: &str,
    variant: &str,
    settings: &Settings,
) -> Result<Box<dyn Network>, InferenceError> {
    let file = ModelFile::read(Manifest::embedded()?.model(name, variant)?, settings)?;
    let runtime = Runtime::start(settings)?;
    Ok(Box::new(NetworkSession::new(
        file,
        runtime,
        settings.threads(),
    )))
}
