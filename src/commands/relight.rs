//! `relight`: a capture folder or a recording under new light.

use super::{
    Answer, CommandError,
    error::InputError,
    input::{self, Input},
    lights::LightArguments,
    progress::Progress,
};
use crate::{
    api::LightError,
    config::Config,
    darkroom::{self, Order, Source},
    folder::{Limits, Samples, decode_limited},
    output::{Existing, manifest::MANIFEST},
    relight::Environment,
    session,
};
use clap::Args;
use std::path::{Path, PathBuf};

/// Arguments of `relight`.
#[derive(Debug, Args)]
pub struct Relight {
    /// A capture folder, or a recording (.mcap), of which the first shot is taken.
    #[arg(value_name = "FOLDER|RECORDING")]
    input: PathBuf,
    #[command(flatten)]
    lights: LightArguments,
    /// A map of the light all around, .hdr or .exr, twice as wide as high.
    #[arg(long, value_name = "MAP")]
    environment: Option<PathBuf>,
    /// Folder for the results; must not exist yet, or be empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace earlier results in --out.
    #[arg(long)]
    force: bool,
}

impl Relight {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let lights = self.lights.check()?;
        if lights.lamps.is_empty() && self.environment.is_none() {
            return Err(LightError::None.into());
        }
        let progress = Progress::of_unknown("reading");
        let environment = self
            .environment
            .as_deref()
            .map(read_environment)
            .transpose()?;
        let named = self.environment.as_deref().map(environment_label);
        let Input { capture, drops } = input::read(&self.input, config)?;
        let order = Order {
            shot: &capture.shot,
            source: Source {
                name: &self.input.display().to_string(),
                drops,
            },
            lamps: &lights.lamps,
            environment: named.as_deref().zip(environment.as_ref()),
            warnings: lights.warnings,
            attachments: &[],
        };
        let existing = if self.force {
            Existing::Replace
        } else {
            Existing::Refuse
        };
        let manifest = darkroom::print(&order, &self.out, existing, &mut |stage| {
            progress.doing(stage)
        })
        .map_err(session::SessionError::from)?;
        drop(progress);
        let mut lines = vec![format!("{}: {}", self.input.display(), self.out.display())];
        for light in &manifest.lights {
            lines.push(format!(
                "  {:<24} {}",
                light.label,
                self.out.join(&light.relit_png).display()
            ));
        }
        lines.push(format!(
            "  {:<24} {}",
            "all at one look",
            self.out.join("overview.png").display()
        ));
        let total: f64 = manifest.timings_ms.iter().map(|(_, ms)| ms).sum();
        lines.push(format!(
            "  {total:.0} ms; times, confidences and hashes in {MANIFEST}"
        ));
        let json = serde_json::json!({ "out": self.out, "shot": manifest });
        Ok(Answer::new(lines.join("\n"), &json).with_warnings(manifest.warnings))
    }
}

/// Reads a latitude–longitude map of scene-linear light.
fn read_environment(path: &Path) -> Result<Environment, CommandError> {
    let radiance = match decode_limited(path, None, Limits::default())?.samples {
        Samples::RgbF32(plane) => plane,
        Samples::GrayF32(plane) => plane.map(|value| [*value; 3]),
        other => {
            return Err(InputError {
                path: path.to_owned(),
                problem: format!("holds {}", other.describe()),
                remedy: "give a map of linear light: .hdr or .exr",
            }
            .into());
        }
    };
    Environment::new(&radiance).map_err(|error| {
        InputError {
            path: path.to_owned(),
            problem: error.to_string(),
            remedy: "give a latitude–longitude map, twice as wide as high",
        }
        .into()
    })
}

fn environment_label(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "environment".into(), |name| name.to_string_lossy())
        .into_owned()
}
