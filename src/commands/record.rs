//! `record`: what a device delivers, into a file that can be replayed anywhere.

use super::{Answer, CommandError, error::ResultError, progress::Progress};
use crate::{
    config::Config,
    output::{CommitError, StagedFile},
    session,
};
use clap::Args;
use drivers::{
    Device, DriverError, Frame, Illumination,
    recording::{Writer, summarize},
};
use std::path::{Path, PathBuf};

/// Arguments of `record`.
#[derive(Debug, Args)]
pub struct Record {
    /// Address of the device.
    #[arg(value_name = "DEVICE")]
    device: String,
    /// The recording to write; must not exist yet. It is FILE.mcap.partial until it is whole.
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    /// Brackets (ambient, flash, ambient) to record; a finite device may end earlier.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    brackets: u32,
}

impl Record {
    /// Records under another name, and sums up what was recorded by reading it back.
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let mut device = session::open(&self.device, config.rig_of(&self.device))?;
        let staged = StagedFile::begin_salvageable(&self.out)?;
        let mut bracket = Bracket::default();
        let warnings = match self.record(device.as_mut(), config, staged.partial(), &mut bracket) {
            Ok(warnings) => warnings,
            // Holds nothing: better no file than one that says nothing.
            Err(error) if bracket.finished == 0 => return Err(error),
            Err(error) => {
                // What was seen cannot be seen again: the brackets that are whole are kept.
                return Err(ResultError {
                    path: staged.salvage(),
                    problem: format!("{error}; it holds {} whole brackets", bracket.finished),
                    remedy: "see `capturectl info`, then rename it or remove it",
                }
                .into());
            }
        };
        staged.commit()?;
        let summary = summarize(&self.out)?;
        let text = format!(
            "{}: {} brackets, {} color and {} depth frames, {:.2} s, {} bytes",
            self.out.display(),
            bracket.finished,
            summary.ambient_frames + summary.flash_frames,
            summary.depth_frames,
            summary.duration_seconds,
            summary.bytes
        );
        let json = serde_json::json!({
            "out": self.out, "brackets": bracket.finished, "recording": summary,
        });
        Ok(Answer::new(text, &json).with_warnings(warnings))
    }

    /// Writes what the device delivers to `file`; the answer is what to know about it.
    fn record(
        &self,
        device: &mut dyn Device,
        config: &Config,
        file: &Path,
        bracket: &mut Bracket,
    ) -> Result<Vec<String>, CommandError> {
        let settings = config.capture.settings();
        let unwritten = |error: DriverError| unwritten(&self.out, error);
        let mut writer =
            Writer::create(file, &device.info(), &device.rig(), &settings).map_err(unwritten)?;
        let progress = Progress::of(self.brackets as usize, "recording");
        let mut stream = device.start(&settings)?;
        let mut warnings = Vec::new();
        while bracket.finished < self.brackets {
            let frame = match stream.next_frame(config.capture.patience()) {
                Ok(frame) => frame,
                Err(DriverError::Ended { .. }) => {
                    warnings.push(format!(
                        "{} ended after {} of {} brackets",
                        self.device, bracket.finished, self.brackets
                    ));
                    break;
                }
                Err(error) if bracket.finished == 0 => return Err(error.into()),
                Err(error) => {
                    warnings.push(format!("{error}; the recording ends before that"));
                    break;
                }
            };
            writer.push(&frame).map_err(unwritten)?;
            if bracket.closes_with(&frame) {
                writer.finish_bracket().map_err(unwritten)?;
                // Counted when it is on the disk, and not before.
                bracket.finished += 1;
                progress.step();
            }
        }
        drop(stream);
        writer.close().map_err(unwritten)?;
        Ok(warnings)
    }
}

/// Where in ambient–flash–ambient the color frames are.
#[derive(Default)]
struct Bracket {
    flash_seen: bool,
    /// Brackets that are whole and on the disk.
    finished: u32,
}

impl Bracket {
    /// True when `frame` is the ambient frame after a flash: the bracket is then whole.
    fn closes_with(&mut self, frame: &Frame) -> bool {
        let Frame::Color(frame) = frame else {
            return false;
        };
        match frame.light {
            Illumination::Flash => {
                self.flash_seen = true;
                false
            }
            Illumination::Ambient => std::mem::take(&mut self.flash_seen),
        }
    }
}

/// A recording that cannot be written is a failure of the output, not of the device.
fn unwritten(out: &Path, error: DriverError) -> CommandError {
    match error {
        DriverError::Io { source, .. } => CommitError::unwritten(out, source).into(),
        other => ResultError {
            path: out.to_owned(),
            problem: other.to_string(),
            remedy: "check the device with `capturectl check-device`",
        }
        .into(),
    }
}
