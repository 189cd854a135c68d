//! `record`: what a device delivers, into a file that can be replayed anywhere.

use super::{Answer, CommandError, error::ResultError, progress::Progress};
use crate::config::Config;
use clap::Args;
use drivers::{
    DriverError, Frame, Illumination,
    recording::{Writer, summarize},
};
use std::path::{Path, PathBuf};

/// Arguments of `record`.
#[derive(Debug, Args)]
pub struct Record {
    /// Address of the device.
    #[arg(value_name = "DEVICE")]
    device: String,
    /// The recording to write; must not exist yet.
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    /// Brackets (ambient, flash, ambient) to record; a finite device may end earlier.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    brackets: u32,
}

impl Record {
    /// Records, and sums up what was recorded by reading it back.
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let mut device = drivers::open::open(&self.device)?;
        let settings = config.capture.settings();
        let mut writer = Writer::create(&self.out, &device.info(), &device.rig(), &settings)
            .map_err(|error| unwritten(&self.out, &error))?;
        let progress = Progress::of(self.brackets as usize, "recording");
        let mut stream = device.start(&settings)?;
        let mut bracket = Bracket::default();
        let mut warnings = Vec::new();
        while bracket.finished < self.brackets {
            let frame = match stream.next_frame(config.capture.patience()) {
                Ok(frame) => frame,
                Err(DriverError::Ended { .. }) => break,
                Err(error) if bracket.finished == 0 => {
                    drop((stream, writer));
                    // Holds nothing: better no file than one that says nothing.
                    drop(std::fs::remove_file(&self.out));
                    return Err(error.into());
                }
                Err(error) => {
                    warnings.push(format!("{error}; the recording ends before that"));
                    break;
                }
            };
            writer
                .push(&frame)
                .map_err(|error| unwritten(&self.out, &error))?;
            if bracket.ends_with(&frame) {
                writer
                    .finish_bracket()
                    .map_err(|error| unwritten(&self.out, &error))?;
                progress.step();
            }
        }
        drop(stream);
        writer
            .close()
            .map_err(|error| unwritten(&self.out, &error))?;
        drop(progress);
        if bracket.finished < self.brackets && warnings.is_empty() {
            warnings.push(format!(
                "{} ended after {} of {} brackets",
                self.device, bracket.finished, self.brackets
            ));
        }
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
}

/// Where in ambient–flash–ambient the color frames are.
#[derive(Default)]
struct Bracket {
    flash_seen: bool,
    finished: u32,
}

impl Bracket {
    /// True when `frame` is the ambient frame after a flash: the bracket is then whole.
    fn ends_with(&mut self, frame: &Frame) -> bool {
        let Frame::Color(frame) = frame else {
            return false;
        };
        match frame.light {
            Illumination::Flash => {
                self.flash_seen = true;
                false
            }
            Illumination::Ambient => {
                let ends = std::mem::take(&mut self.flash_seen);
                self.finished += u32::from(ends);
                ends
            }
        }
    }
}

/// A recording that cannot be written is a failure of the output, not of the device.
fn unwritten(out: &Path, error: &DriverError) -> CommandError {
    match error {
        DriverError::Io { source, .. } => ResultError {
            path: out.to_owned(),
            problem: format!("cannot be written: {source}"),
            remedy: "name a new file in a folder that can be written and has space",
        }
        .into(),
        other => ResultError {
            path: out.to_owned(),
            problem: other.to_string(),
            remedy: "check the device with `capturectl check-device`",
        }
        .into(),
    }
}
