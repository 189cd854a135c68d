//! `corrupt`: a capture made worse on purpose, as a folder like the one it came from.

use super::{
    Answer, CommandError, corruption_sheet, error::InputError, input, input::Kind,
    progress::Progress,
};
use crate::{
    config::Config,
    corruption::{CORRUPTIONS, Corruption, MOST_SEVERE},
    folder::{FolderError, truth_beside, write, write_with_truth},
    output::{FRAMES, StagedFile},
};
use clap::Args;
use std::path::{Path, PathBuf};

/// Arguments of `corrupt`.
#[derive(Debug, Args)]
#[command(after_help = listed())]
pub struct Corrupt {
    /// A capture folder, or a recording (.mcap), of which the first shot is taken.
    #[arg(value_name = "FOLDER|RECORDING")]
    input: PathBuf,
    /// What to do to it, and how severely, from 0 (nothing) to 5; several in the order given.
    #[arg(long = "with", value_name = "NAME:SEVERITY", required_unless_present = "sheet", value_parser = asked)]
    with: Vec<Asked>,
    /// Other dice.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The capture folder to write; must not exist yet, or be empty. Truth is copied unchanged.
    #[arg(long, value_name = "DIR", required_unless_present = "sheet")]
    out: Option<PathBuf>,
    /// Instead: draw all of them at every severity on one page, a file that must not exist yet.
    #[arg(long, value_name = "PNG", conflicts_with_all = ["with", "out"])]
    sheet: Option<PathBuf>,
}

/// One `NAME:SEVERITY`.
#[derive(Debug, Clone, Copy)]
struct Asked {
    corruption: &'static Corruption,
    severity: u8,
}

impl Corrupt {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        for (place, asked) in self.with.iter().enumerate() {
            let name = asked.corruption.name;
            if self.with[..place]
                .iter()
                .any(|earlier| earlier.corruption.name == name)
            {
                return Err(CommandError::Arguments(format!(
                    "--with: {name} is given twice; give each corruption once"
                )));
            }
        }
        let out = match (&self.sheet, &self.out) {
            (Some(sheet), _) => return self.draw(sheet, config),
            (None, Some(out)) => out.clone(),
            (None, None) => {
                return Err(CommandError::Arguments("give --out or --sheet".to_owned()));
            }
        };
        let progress = Progress::of(self.with.len(), "reading");
        let capture = input::read(&self.input, config)?.capture;
        let truth = match &capture.truth {
            Some(truth) if truth.has_depth_in_other_steps() => {
                return Err(InputError {
                    path: self.input,
                    problem: "its truth has depth in steps that the written folder cannot state"
                        .to_owned(),
                    remedy: "store truth/depth as OpenEXR, in metres",
                }
                .into());
            }
            Some(_) => Some(truth_of(&self.input)?),
            None => None,
        };
        let mut shot = capture.shot;
        for asked in &self.with {
            progress.doing(asked.corruption.name);
            shot = asked.corruption.on_shot(&shot, asked.severity, self.seed)?;
            progress.step();
        }
        progress.doing("writing");
        let losses = match &truth {
            Some(truth) => write_with_truth(&out, &shot, truth),
            None => write(&out, &shot),
        }
        .map_err(|error| match error {
            FolderError::Io { .. } => CommandError::Folder(error),
            other => CommandError::Unwritten(other),
        })?;
        drop(progress);
        Ok(self.answer(&out, truth.is_some(), &losses))
    }

    /// All of them on one page.
    fn draw(&self, sheet: &Path, config: &Config) -> Result<Answer, CommandError> {
        let progress = Progress::of_share("reading");
        let capture = input::read(&self.input, config)?.capture;
        let page = corruption_sheet::drawn(&capture.name, &capture.shot, self.seed, &progress)?;
        StagedFile::write(sheet, &page)?;
        drop(progress);
        let text = format!("{}: {}", self.input.display(), sheet.display());
        let json = serde_json::json!({ "sheet": sheet, "seed": self.seed });
        Ok(Answer::new(text, &json))
    }

    fn answer(&self, out: &Path, truth: bool, losses: &[String]) -> Answer {
        let mut lines = vec![format!("{}: {}", self.input.display(), out.display())];
        lines.extend(self.with.iter().map(Asked::line));
        lines.push(match truth {
            true => "  truth copied unchanged".to_owned(),
            false => "  no truth to copy".to_owned(),
        });
        let done: Vec<serde_json::Value> = self.with.iter().map(Asked::json).collect();
        let json = serde_json::json!({
            "out": out,
            "seed": self.seed,
            "corruptions": done,
            "truth": truth,
            "lost": losses,
        });
        Answer::new(lines.join("\n"), &json)
    }
}

impl Asked {
    /// How much happened; `None` for severity 0.
    fn level(&self) -> Option<f32> {
        let step = usize::from(self.severity).checked_sub(1)?;
        self.corruption.levels.get(step).copied()
    }

    fn line(&self) -> String {
        let Corruption { name, unit, .. } = self.corruption;
        match self.level() {
            Some(level) => format!("  {name}:{}  {level} {unit}", self.severity),
            None => format!("  {name}:0  unchanged"),
        }
    }

    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "name": self.corruption.name,
            "severity": self.severity,
            "level": self.level(),
            "unit": self.corruption.unit,
        })
    }
}

/// Where the truth of a capture lies that has one.
fn truth_of(input: &Path) -> Result<PathBuf, InputError> {
    Ok(match Kind::of(input)? {
        Kind::Capture => input.join("truth"),
        Kind::Recording => truth_beside(input),
        Kind::Results => truth_beside(&input.join(FRAMES)),
    })
}

/// Reads `NAME:SEVERITY`.
fn asked(text: &str) -> Result<Asked, String> {
    let (name, severity) = text
        .split_once(':')
        .ok_or("give NAME:SEVERITY, as in tof-noise:3")?;
    let corruption = Corruption::named(name).map_err(|error| error.to_string())?;
    let severity = severity
        .parse()
        .ok()
        .filter(|severity| *severity <= MOST_SEVERE)
        .ok_or_else(|| {
            format!("severity \"{severity}\" is no whole number from 0 (unchanged) to {MOST_SEVERE} (worst)")
        })?;
    Ok(Asked {
        corruption,
        severity,
    })
}

/// All corruptions with their levels, for the help.
fn listed() -> String {
    let mut text = "Corruptions, with severities 1 to 5 (pixels at 256×256):".to_owned();
    for corruption in &CORRUPTIONS {
        let Corruption {
            name,
            description,
            unit,
            ..
        } = corruption;
        let levels = corruption.levels.map(|level| level.to_string()).join(", ");
        text.push_str(&format!("\n  {name:<20} {description}: {levels} {unit}"));
    }
    text
}
