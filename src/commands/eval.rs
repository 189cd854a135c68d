//! `eval`: captures with truth, measured.

use super::{Answer, CommandError, error::ResultError, input, progress::Progress};
use crate::{
    config::Config,
    eval::{EvalOptions, charts::write_charts, evaluate, write_report},
};
use clap::Args;
use std::path::{Path, PathBuf};

/// Arguments of `eval`.
#[derive(Debug, Args)]
pub struct Eval {
    /// Capture folders, or recordings with their truth beside them (NAME.truth beside NAME.mcap).
    #[arg(value_name = "CAPTURE", required = true)]
    captures: Vec<PathBuf>,
    /// Folder for report.json, report.csv and the charts; created where it is missing.
    #[arg(long, value_name = "OUT")]
    report: Option<PathBuf>,
}

impl Eval {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
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
        if let Some(folder) = &self.report {
            progress.doing("writing");
            std::fs::create_dir_all(folder).map_err(|source| unwritten(folder, &source))?;
            write_report(&report, folder).map_err(|error| unwritten(folder, &error))?;
            write_charts(&report, folder).map_err(|error| unwritten(folder, &error))?;
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

fn unwritten(folder: &Path, error: &dyn std::fmt::Display) -> ResultError {
    ResultError {
        path: folder.to_owned(),
        problem: error.to_string(),
        remedy: "name a folder that can be written and has space",
    }
}
