//! `relight`: a capture folder or a recording under new light.

use super::{
    Answer, CommandError,
    inference::TierArguments,
    input::{self, Input},
    lights::LightArguments,
    progress::Progress,
};
use crate::{
    api::{CheckedLights, LightError},
    config::Config,
    darkroom::{self, Order, Source},
    infrared::lit_by_infrared,
    output::{Destination, Disk, Existing, manifest::MANIFEST},
    session,
};
use clap::Args;
use std::path::PathBuf;

/// Most lights one command takes.
const MOST_LIGHTS: usize = 4096;

/// What a result under `--no-flash` says of itself.
const BY_INFRARED: &str = "lit by the depth camera's infrared light, not by the flash: how bright a color is was judged mostly in infrared";

/// Arguments of `relight`.
#[derive(Debug, Args)]
pub struct Relight {
    /// A capture folder, or a recording (.mcap), of which the first shot is taken.
    #[arg(value_name = "FOLDER|RECORDING")]
    input: PathBuf,
    #[command(flatten)]
    lights: LightArguments,
    #[command(flatten)]
    tier: TierArguments,
    /// Take the depth camera's infrared light for the flash: the photograph without flash and the infrared
    /// picture are used, that with flash is not.
    #[arg(long)]
    no_flash: bool,
    /// Folder for the results; must not exist yet, or be empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace earlier results in --out.
    #[arg(long)]
    force: bool,
}

impl Relight {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let progress = Progress::of_unknown("reading");
        let environment = self.lights.read_environment()?;
        let lights = CheckedLights::new(&self.lights.read()?, MOST_LIGHTS, environment.as_ref())?;
        if lights.is_empty() {
            return Err(LightError::None.into());
        }
        let (answering, said) = self.tier.ready(config)?;
        let Input { mut capture, drops } = input::read(&self.input, config)?;
        let mut warnings: Vec<String> = lights.warnings.into_iter().chain(said).collect();
        if self.no_flash {
            capture.shot = lit_by_infrared(&capture.shot)?;
            warnings.push(BY_INFRARED.to_owned());
        }
        let order = Order {
            shot: &capture.shot,
            source: Source {
                name: &self.input.display().to_string(),
                drops,
                burst: None,
            },
            lamps: &lights.lamps,
            environment: lights
                .environment
                .as_ref()
                .map(|(name, environment)| (name.as_str(), environment)),
            answering: &answering,
            warnings,
            attachments: &[],
        };
        let existing = if self.force {
            Existing::Replace
        } else {
            Existing::Refuse
        };
        let to = Destination {
            disk: &Disk,
            folder: &self.out,
            existing,
        };
        let manifest = darkroom::print(&order, &to, &mut |stage| progress.doing(stage))
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
        if let Some(line) = environment_line(&manifest.report) {
            lines.push(line);
        }
        let total: f64 = manifest.timings_ms.iter().map(|(_, ms)| ms).sum();
        lines.push(format!(
            "  {total:.0} ms; times, confidences and hashes in {MANIFEST}"
        ));
        let json = serde_json::json!({ "out": self.out, "shot": manifest });
        Ok(Answer::new(lines.join("\n"), &json).with_warnings(manifest.warnings))
    }
}

/// How many lights stand for the environment, and how near they come to all of it.
fn environment_line(report: &serde_json::Value) -> Option<String> {
    let found = &report["environment"];
    let (lights, of) = (found["lights"].as_u64()?, found["of"].as_u64()?);
    let (change, noise) = (found["rms_change"].as_f64()?, found["noise"].as_f64()?);
    Some(if lights == of {
        format!("  environment: all {of} lights")
    } else {
        format!(
            "  environment: {lights} of {of} lights, which changes the picture by {:.2} of 255 steps; its noise is {:.2}",
            255.0 * change,
            255.0 * noise
        )
    })
}
