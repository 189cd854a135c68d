//! Models from files, good and evil: what is accepted, what runs it, and that both backends agree.
//!
//! `tests/models/*.onnx` and their manifest are written by `python3 -m models.fixtures`.

mod accepted;
mod backends;
mod paper;
mod refused;
mod rows;

use captured::{
    inference::{InferenceError, Manifest, ModelFile, NetworkSession, Runtime, Settings},
    relight::networks::{Channels, Network, Paper, Variant},
};
use std::path::{Path, PathBuf};

/// The folder of the tiny models.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models")
}

fn settings() -> Settings {
    Settings {
        models: Some(folder()),
        ..Settings::default()
    }
}

fn manifest() -> Manifest {
    let text = std::fs::read_to_string(folder().join("manifest.toml")).unwrap();
    Manifest::parse(&text).unwrap()
}

fn read(name: &str, variant: &str) -> Result<ModelFile, InferenceError> {
    ModelFile::read(manifest().model(name, variant).unwrap(), &settings())
}

/// A tiny network on whatever backend this process has.
fn network(name: &str, variant: &str) -> NetworkSession {
    let runtime = Runtime::start(&Settings::default()).unwrap();
    NetworkSession::new(read(name, variant).unwrap(), runtime, 2)
}

fn paper() -> Paper {
    let boxed = |name| -> Box<dyn Network> { Box::new(network(name, "clean")) };
    Paper {
        variant: Variant::Clean,
        decompose: boxed("decompose"),
        shadow: boxed("shadow"),
        synthesis: boxed("synthesis"),
    }
}

/// Pictures whose numbers differ from pixel to pixel, in [0, 1).
fn pictures(count: usize, (width, height): (usize, usize), seed: usize) -> Channels {
    let number = |index: usize| ((index * 37 + seed * 101) % 1009) as f32 / 1009.0;
    Channels {
        size: (width, height),
        count,
        samples: (0..count * width * height).map(number).collect(),
    }
}
