//! `eval`: captures with truth, measured.

use super::{Answer, CommandError, input, progress::Progress};
use crate::{
    config::Config,
    eval::{EvalOptions, ReportFolder, evaluate},
};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `eval`.
#[derive(Debug, Args)]
pub struct Eval {
    /// Capture folders, or recordings with their truth beside them (NAME.truth beside NAME.mcap).
    #[arg(value_name = "CAPTURE", required = true)]
    captures: Vec<PathBuf>,
    /// Folder for report.json, report.csv and the charts; an earlier report in it is replaced.
    #[arg(long, value_name = "OUT")]
    report: Option<PathBuf>,
}

impl Eval {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let folder = self
            .report
            .as_deref()
            .map(ReportFolder::begin)
            .transpose()?;
        let progress = Progress::of(self.captures.len(), "reading");
        let captures = self
            .captures
            .iter()
            .map(|path| input::read(path, config).map(|input| input.capture))
            .collect::<Result<Vec<_>, _>>()?;
        let report = evaluate(&captures, &EvalOptions::default(), |now| {
            progress.doing(now.capture);
            progress.reach(now.captures_done);
        })?;
        if let Some(folder) = folder {
            progress.doing("writing");
            folder.write(&report)?;
        }
        drop(progress);
        let mut text = report.to_string().trim_end().to_owned();
        if let Some(folder) = &self.report {
            text.push_str(&format!(
                "\nreport.json, report.csv and charts in {}",
                folder.display()
            ));
        }
        Ok(Answer::new(text, &report))
    }
}
