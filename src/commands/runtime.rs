//! `runtime`: what runs the networks of `--tier paper`, and how to get a faster one.

use super::{Answer, CommandError, inference::BackendArguments};
use crate::{
    config::Config,
    inference::{self, Backend, Manifest, ModelFile, Settings},
};
use clap::{Args, Subcommand};
use std::fmt::Write as _;

/// What to say.
#[derive(Debug, Subcommand)]
pub enum Runtime {
    /// Say which backend runs the networks, why, and which models it would run.
    Status(Status),
    /// Say how to get ONNX Runtime's library and where to put it; nothing is downloaded.
    Fetch,
}

/// Arguments of `runtime status`.
#[derive(Debug, Args)]
pub struct Status {
    #[command(flatten)]
    backend: BackendArguments,
}

impl Runtime {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        match self {
            Self::Status(status) => say(&status.backend.settings(config)),
            Self::Fetch => Ok(fetch()),
        }
    }
}

fn say(settings: &Settings) -> Result<Answer, CommandError> {
    let runtime = inference::Runtime::start(settings)?;
    let threads = runtime.backend.threads(settings.threads());
    let mut text = match &runtime.backend {
        Backend::OnnxRuntime { library, version } => {
            format!(
                "ONNX Runtime {version}, {threads} threads: {}",
                library.display()
            )
        }
        Backend::Tract { because } => format!(
            "{}, 1 thread, part of this program\nnot ONNX Runtime: {because}; `capturectl runtime fetch` says how to get it",
            runtime.backend.description()
        ),
    };
    let places = inference::library_places();
    text.push_str("\nlibraries are looked for in:");
    for place in &places {
        _ = write!(text, "\n  {}", place.display());
    }
    let mut models = Vec::new();
    text.push_str("\nmodels:");
    let manifest = Manifest::embedded()?;
    for model in manifest.models() {
        let found = ModelFile::read(model, settings);
        let said = match &found {
            Ok(file) => file.path.display().to_string(),
            Err(error) => format!("unusable: {error}"),
        };
        _ = write!(text, "\n  {:<10} {:<6} {said}", model.name, model.variant);
        models.push(serde_json::json!({
            "name": model.name,
            "variant": model.variant,
            "blake3": model.blake3,
            "path": found.as_ref().ok().map(|file| &file.path),
            "problem": found.as_ref().err().map(ToString::to_string),
        }));
    }
    if manifest.models().is_empty() {
        text.push_str(" none; this program was built before any was trained");
    }
    let json = serde_json::json!({
        "backend": runtime.backend,
        "threads": threads,
        "libraries_looked_for_in": places,
        "models_looked_for_in": inference::model_places(settings),
        "models": models,
    });
    let warnings = runtime.warning.iter().cloned().collect();
    Ok(Answer::new(text, &json).with_warnings(warnings))
}

fn fetch() -> Answer {
    let folder = inference::fetch_folder().map_or_else(
        || "/usr/local/lib".to_owned(),
        |folder| folder.display().to_string(),
    );
    let processor = if cfg!(target_arch = "aarch64") {
        "arm64"
    } else {
        "x64"
    };
    let ways = [
        (
            "from Python's package index",
            format!(
                "python3 -m pip install --no-deps --target download onnxruntime && \
                 install -D -t {folder} download/onnxruntime/capi/libonnxruntime.so.*"
            ),
        ),
        (
            "from npm",
            format!(
                "npm install --ignore-scripts --prefix download onnxruntime-node && \
                 install -D -t {folder} download/node_modules/onnxruntime-node/bin/napi-v6/linux/{processor}/libonnxruntime.so.1"
            ),
        ),
        (
            "from a distribution, where it is 1.24 or newer",
            "apt install libonnxruntime-dev, dnf install onnxruntime, or pacman -S onnxruntime"
                .to_owned(),
        ),
    ];
    let mut text = format!(
        "ONNX Runtime 1.24 or newer runs the networks faster than tract, which is part of this program.\n\
         Its library belongs into {folder} (or say --runtime PATH, or inference.runtime in captured.toml):"
    );
    for (from, command) in &ways {
        _ = write!(text, "\n\n{from}:\n  {command}");
    }
    text.push_str("\n\nthen: capturectl runtime status");
    let commands: Vec<&String> = ways.iter().map(|(_, command)| command).collect();
    Answer::new(
        text,
        &serde_json::json!({ "folder": folder, "commands": commands }),
    )
}
