//! `devices` and `check-device`.

use super::{Answer, CommandError, progress::Progress};
use crate::api::{DevicesReply, FaultKind};
use clap::Args;
use drivers::{
    Losses,
    contract::{Verdict, check},
};

/// Arguments of `check-device`.
#[derive(Debug, Args)]
pub struct CheckDevice {
    /// Address of the device, as `devices` lists them, or replay:FILE.mcap.
    #[arg(value_name = "ADDRESS")]
    device: String,
}

/// Lists what can be opened now.
pub(super) fn list() -> Result<Answer, CommandError> {
    let devices = drivers::open::list();
    let mut lines: Vec<String> = devices
        .iter()
        .map(|device| {
            // What stands behind the question mark are defaults, which need not be typed.
            let address = device.address.split('?').next().unwrap_or_default();
            format!("{address:<24} {}", device.model)
        })
        .collect();
    lines.push(format!("Addresses: {}", drivers::open::ADDRESSES));
    Ok(Answer::new(lines.join("\n"), &DevicesReply { devices }))
}

/// Frames that are looked at.
const FRAMES: usize = 60;

impl CheckDevice {
    pub(super) fn run(self) -> Result<Answer, CommandError> {
        let mut device = drivers::open::open(&self.device)?;
        let progress = Progress::of_unknown("checking");
        let report = check(device.as_mut(), FRAMES, &mut |claim| {
            progress.doing(&claim.name.replace('_', " "))
        });
        drop(progress);
        let mut lines = vec![format!("{}: {} frames", report.device, report.frames)];
        let losses = report.losses;
        if losses != Losses::default() {
            lines.push(format!(
                "  besides {} missed, {} broken and {} of unknown light; {} misdated",
                losses.missed, losses.broken, losses.unlit, losses.misdated
            ));
        }
        lines.extend(report.claims.iter().map(|claim| {
            let verdict = match claim.verdict {
                Verdict::Pass => "holds",
                Verdict::Fail => "BROKEN",
                Verdict::Unknown => "unknown",
            };
            format!(
                "  {verdict:<8} {}: {}",
                claim.name.replace('_', " "),
                claim.evidence
            )
        }));
        let broken = report
            .claims
            .iter()
            .filter(|claim| claim.verdict == Verdict::Fail)
            .count();
        lines.push(match broken {
            0 => "the device upholds the contract".to_owned(),
            1 => "1 clause of the contract is broken".to_owned(),
            count => format!("{count} clauses of the contract are broken"),
        });
        let mut answer = Answer::new(lines.join("\n"), &report);
        if !report.passed() {
            answer.exit_code = FaultKind::Contract.exit_code();
        }
        Ok(answer)
    }
}
