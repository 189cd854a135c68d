//! `relight`: a capture folder or a recording under new light.

use super::{Answer, CommandError, info::Kind, lights::LightArguments, progress::Progress};
use crate::{
    api::LightError,
    config::Config,
    darkroom::{self, Order, Source},
    folder::{self, read_mask_beside},
    output::{Existing, FRAMES, manifest::MANIFEST},
    session,
    shot::{DropCounts, Shot},
};
use clap::Args;
use drivers::replay::Replay;
use std::path::{Path, PathBuf};

/// Arguments of `relight`.
#[derive(Debug, Args)]
pub struct Relight {
    /// A capture folder, or a recording (.mcap), of which the first shot is taken.
    #[arg(value_name = "FOLDER|RECORDING")]
    input: PathBuf,
    #[command(flatten)]
    lights: LightArguments,
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
        if lights.lamps.is_empty() {
            return Err(LightError::None.into());
        }
        let progress = Progress::of_unknown("reading");
        let (shot, drops) = read_shot(&self.input, config)?;
        let order = Order {
            shot: &shot,
            source: Source {
                name: &self.input.display().to_string(),
                drops,
            },
            lamps: &lights.lamps,
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

/// The shot of a capture folder, or the first of a recording.
fn read_shot(input: &Path, config: &Config) -> Result<(Shot, Option<DropCounts>), CommandError> {
    match Kind::of(input)? {
        Kind::Capture => Ok((folder::read(input)?.shot, None)),
        Kind::Recording => play(input, config),
        // A shot that was kept holds its own frames.
        Kind::Results => play(&input.join(FRAMES), config),
    }
}

/// The first shot that the frames of a recording make, with the mask that lies beside it.
fn play(path: &Path, config: &Config) -> Result<(Shot, Option<DropCounts>), CommandError> {
    let mut replay = Replay::open(path)?;
    let taken = session::take(&mut replay, &config.capture)?;
    let mask = read_mask_beside(path, taken.shot.rig.color.size())?;
    Ok((Shot { mask, ..taken.shot }, Some(taken.drops)))
}
