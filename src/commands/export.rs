//! `export`: a capture's surfaces in a file of a neighbouring tool.

use super::{
    Answer, CommandError, error::InputError, inference::BackendArguments, input, progress::Progress,
};
use crate::{
    config::Config,
    darkroom::DarkroomError,
    develop::{Options, Stage, develop},
    export::{Format, encoded},
    inference,
    output::StagedFile,
    session::SessionError,
};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct Export {
    /// A capture folder, or a recording (.mcap), of which the first shot is taken.
    #[arg(value_name = "FOLDER|RECORDING")]
    input: PathBuf,
    /// The file to write, which must not exist yet: .glb (a mesh with textures of albedo, normals and
    /// roughness), .ply (a mesh at full detail), .exr (every plane as a layer), .ptm (for RTI viewers).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Leave surfaces as the closed form finds them; else the compact network corrects them.
    #[arg(long)]
    closed: bool,
    #[command(flatten)]
    backend: BackendArguments,
}

impl Export {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let extension = self.out.extension().unwrap_or_default().to_string_lossy();
        let format: Format = extension.parse().map_err(|problem| {
            CommandError::Arguments(format!("--out {}: {problem}", self.out.display()))
        })?;
        let unmade = |error: DarkroomError| CommandError::from(SessionError::from(error));
        let network = if self.closed {
            None
        } else {
            let settings = self.backend.settings(config);
            Some(inference::load_compact(&settings)?.surfaces)
        };
        let progress = Progress::of_unknown("reading");
        let capture = input::read(&self.input, config)?.capture;
        let mut told = |stage: Stage| progress.doing(stage.description());
        let options = Options::default();
        let mut development =
            develop(&capture.shot, &options, &mut told).map_err(|error| unmade(error.into()))?;
        if let Some(network) = network {
            progress.doing("correcting surfaces with a network");
            let refined = development.refine(&capture.shot, network.as_ref());
            refined.map_err(|error| unmade(error.into()))?;
        }
        progress.doing("writing");
        let (scene, prepared) = (&development.scene, &development.prepared);
        let file = encoded(scene, prepared, format).map_err(|error| InputError {
            path: self.input.clone(),
            problem: error.to_string(),
            remedy: "name a capture in which something is seen",
        })?;
        StagedFile::write(&self.out, &file)?;
        drop(progress);
        let (width, height) = scene.albedo.size();
        let text = format!(
            "{}: {width}×{height}, {:.1} MB",
            self.out.display(),
            file.len() as f64 / 1e6
        );
        let json = serde_json::json!({
            "out": self.out, "width": width, "height": height, "bytes": file.len()
        });
        Ok(Answer::new(text, &json))
    }
}
