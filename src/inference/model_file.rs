//! A model's bytes: found, read once, and accepted or refused.

use super::{InferenceError, Model, Settings, Signal, onnx, sizes};
use std::{
    fs::File,
    io::{ErrorKind, Read},
    path::{Path, PathBuf},
};

/// Bytes that are what the manifest states.
#[derive(Debug)]
pub struct ModelFile {
    /// Where they came from.
    pub path: PathBuf,
    /// What the manifest says of them.
    pub model: Model,
    pub(super) bytes: Vec<u8>,
}

/// Folders in which models are looked for, best first: the one asked for and no other, else beside
/// the installed program, else the source tree's.
pub fn places(settings: &Settings) -> Vec<PathBuf> {
    if let Some(asked) = &settings.models {
        return vec![asked.clone()];
    }
    let program = std::env::current_exe().ok();
    let installed =
        program.and_then(|path| Some(path.parent()?.parent()?.join("share/captured/models")));
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    installed.into_iter().chain([source]).collect()
}

impl ModelFile {
    /// Finds a model's file, opens it once, and accepts what was read.
    ///
    /// # Errors
    /// [`InferenceError::NotFound`], [`InferenceError::Read`], else as [`Self::accept`].
    pub fn read(model: &Model, settings: &Settings) -> Result<Self, InferenceError> {
        let tried = places(settings);
        for folder in &tried {
            let path = folder.join(&model.file);
            match File::open(&path) {
                Ok(file) => return Self::accept(model, path, file),
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(source) => return Err(InferenceError::Read { path, source }),
            }
        }
        Err(InferenceError::NotFound {
            file: model.file.clone(),
            tried,
        })
    }

    /// Accepts a file by length, hash and contents, in this order. No more than the stated length is
    /// kept, and no runtime has seen a byte yet.
    ///
    /// # Errors
    /// [`InferenceError::Length`], [`InferenceError::Hash`], [`InferenceError::Onnx`] for external
    /// data, foreign operators and broken bytes, [`InferenceError::Signal`] for inputs or outputs
    /// that the manifest does not state.
    pub fn accept(model: &Model, path: PathBuf, file: impl Read) -> Result<Self, InferenceError> {
        let mut bytes = Vec::with_capacity(model.bytes as usize);
        if let Err(source) = file.take(model.bytes + 1).read_to_end(&mut bytes) {
            return Err(InferenceError::Read { path, source });
        }
        if bytes.len() as u64 != model.bytes {
            let found = if bytes.len() as u64 > model.bytes {
                format!("more than {}", model.bytes)
            } else {
                bytes.len().to_string()
            };
            return Err(InferenceError::Length {
                path,
                found,
                stated: model.bytes,
            });
        }
        let found = blake3::hash(&bytes).to_hex();
        if !found.eq_ignore_ascii_case(&model.blake3) {
            return Err(InferenceError::Hash {
                path,
                found: found.to_string(),
                stated: model.blake3.clone(),
            });
        }
        let inspected = match onnx::inspect(&bytes) {
            Ok(inspected) => inspected,
            Err(source) => return Err(InferenceError::Onnx { path, source }),
        };
        let sides = [
            ("input", &inspected.inputs, &model.inputs),
            ("output", &inspected.outputs, &model.outputs),
        ];
        for (side, found, stated) in sides {
            if let Some(problem) = difference(side, found, stated) {
                return Err(InferenceError::Signal { path, problem });
            }
        }
        Ok(Self {
            path,
            model: model.clone(),
            bytes,
        })
    }

    /// The model for pictures of (width, height) pixels.
    pub(super) fn sized(&self, size: (usize, usize)) -> Result<Vec<u8>, onnx::OnnxError> {
        let sides = |signals: &'_ [Signal]| -> Vec<(String, Vec<u64>)> {
            let sized = |signal: &Signal| (signal.name.clone(), signal.sides(size));
            signals.iter().map(sized).collect()
        };
        sizes::with_sizes(
            &self.bytes,
            &sides(&self.model.inputs),
            &sides(&self.model.outputs),
        )
    }
}

/// How a graph's signals differ from the manifest's, if they do. A free side of a graph fits any.
fn difference(side: &str, found: &[onnx::GraphSignal], stated: &[Signal]) -> Option<String> {
    let names = |of: Vec<&str>| of.join(", ");
    let found_names: Vec<&str> = found.iter().map(|signal| signal.name.as_str()).collect();
    let stated_names: Vec<&str> = stated.iter().map(|signal| signal.name.as_str()).collect();
    let same = |name: &&str| found_names.contains(name);
    if found_names.len() != stated_names.len() || !stated_names.iter().all(same) {
        return Some(format!(
            "{side}s are {}, not {}",
            names(found_names),
            names(stated_names)
        ));
    }
    stated.iter().find_map(|stated| {
        let found = found.iter().find(|signal| signal.name == stated.name)?;
        let name = &stated.name;
        if found.element != onnx::FLOAT {
            let element = found.element;
            return Some(format!(
                "{side} {name:?} is of ONNX's element type {element}, not 1 (32-bit float)"
            ));
        }
        let sides = found.dimensions.as_deref().unwrap_or_default();
        // A fixed height or width would fit one size of picture alone.
        let fits = |(found, stated): (&Option<u64>, &super::Side)| match (found, stated) {
            (None, _) => true,
            (Some(found), super::Side::Fixed(stated)) => found == stated,
            (Some(_), _) => false,
        };
        let fitting = sides.len() == 4 && sides.iter().zip(&stated.shape).all(fits);
        (!fitting).then(|| {
            let words: Vec<String> = sides
                .iter()
                .map(|side| side.map_or_else(|| "free".to_owned(), |side| side.to_string()))
                .collect();
            format!(
                "{side} {name:?} has the shape ({}), not (1, {}, height, width)",
                words.join(", "),
                stated.channels()
            )
        })
    })
}
