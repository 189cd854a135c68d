//! `sync-report`: how well the cameras of a rig keep time, as numbers and as a picture.

use super::{Answer, CommandError, progress::Progress};
use crate::{
    config::Config,
    eval,
    output::StagedFile,
    shot::Limits,
    timing::{Cadence, Sighting, Spread, Timing},
};
use clap::Args;
use drivers::{DriverError, clock};
use std::path::PathBuf;

/// Arguments of `sync-report`.
#[derive(Debug, Args)]
pub struct SyncReport {
    /// Address of the device, or a recording.
    #[arg(value_name = "DEVICE")]
    device: String,
    /// Frames of both cameras to look at; a recording may end earlier.
    #[arg(long, value_name = "N", default_value_t = 600, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    frames: u32,
    /// The picture: offset, jitter and delay over time.
    #[arg(long, value_name = "FILE.png", default_value = "sync.png")]
    out: PathBuf,
}

impl SyncReport {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let mut device = drivers::open(&self.device)?;
        let info = device.info();
        let progress = Progress::of(self.frames as usize, "watching");
        let mut seen = Vec::new();
        let mut stream = device.start(&config.capture.settings())?;
        let mut warnings = Vec::new();
        while seen.len() < self.frames as usize {
            match stream.next_frame(config.capture.patience()) {
                Ok(frame) => {
                    let arrival = (!info.finite).then(clock::monotonic);
                    seen.push(Sighting::of(&frame, arrival));
                    progress.step();
                }
                Err(DriverError::Ended { .. }) => break,
                Err(error) if seen.is_empty() => return Err(error.into()),
                Err(error) => {
                    warnings.push(format!("{error}; the report ends before that"));
                    break;
                }
            }
        }
        drop(stream);
        drop(progress);
        let timing = Timing::of(&seen);
        let picture =
            eval::charts::timing(&timing, &info.address).map_err(eval::ReportError::from)?;
        StagedFile::write(&self.out, &picture)?;
        warnings.extend(doubts(&timing));
        let json = serde_json::json!({
            "device": info, "frames": seen.len(), "timing": timing, "picture": self.out,
        });
        let mut lines = vec![format!(
            "{}: {} frames in {:.1} s",
            info.address,
            seen.len(),
            timing.seconds
        )];
        for (name, cadence) in [("color", &timing.color), ("depth", &timing.depth)] {
            lines.push(match cadence {
                Some(cadence) => format!("  {name:<8} {}", in_words(cadence)),
                None => format!("  {name:<8} fewer than two frames"),
            });
        }
        if let Some(offset) = timing.depth_offset {
            let drift = timing
                .drift_ppm
                .map_or("cadences differ".to_owned(), |drift| {
                    format!("drift {drift:+.1} ppm")
                });
            lines.push(format!("  depth − color: {}; {drift}", spread(offset)));
        }
        if let Some(bracket) = timing.bracket {
            lines.push(format!("  flash to ambient: {}", spread(bracket)));
        }
        lines.push(format!("  picture: {}", self.out.display()));
        Ok(Answer::new(lines.join("\n"), &json).with_warnings(warnings))
    }
}

fn in_words(cadence: &Cadence) -> String {
    let delay = cadence
        .delay
        .map_or(String::new(), |delay| format!("; delay {}", spread(delay)));
    format!(
        "{} frames, {} missing, {} out of order, every {:.4} ms; jitter p95 {:.3} ms, worst {:.3} ms{delay}",
        cadence.frames,
        cadence.missing,
        cadence.disordered,
        cadence.period_ms,
        cadence.jitter.p95_ms,
        cadence.jitter.worst_ms
    )
}

fn spread(
    Spread {
        median_ms,
        p95_ms,
        worst_ms,
    }: Spread,
) -> String {
    format!("{median_ms:.3} ms (95 % within ±{p95_ms:.3}, all within ±{worst_ms:.3})")
}

/// What would cost shots.
fn doubts(timing: &Timing) -> Vec<String> {
    let limits = Limits::default();
    let mut doubts = Vec::new();
    let beyond = |spread: Spread, limit: f32| {
        spread.median_ms.abs() + spread.p95_ms > 1e3 * f64::from(limit)
    };
    match timing.depth_offset {
        None => doubts.push("no pair of color and depth frames was seen".to_owned()),
        Some(offset) if beyond(offset, limits.depth_seconds) => doubts.push(format!(
            "depth is up to {:.0} ms from color, but a shot takes {:.0} ms at most; start both \
             cameras by one trigger or raise their rates",
            offset.median_ms.abs() + offset.p95_ms,
            1e3 * limits.depth_seconds
        )),
        Some(_) => {}
    }
    match timing.bracket {
        None => doubts.push(
            "no flash frame with an ambient frame was seen; check the flash with \
             `capturectl check-device`"
                .to_owned(),
        ),
        Some(bracket) if beyond(bracket, limits.bracket_seconds) => doubts.push(format!(
            "ambient frames are up to {:.0} ms from the flash, but a shot takes {:.0} ms at most",
            bracket.median_ms + bracket.p95_ms,
            1e3 * limits.bracket_seconds
        )),
        Some(_) => {}
    }
    doubts
}
