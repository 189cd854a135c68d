//! A report as a folder of files, whole or not at all.

use super::charts::{self, ChartError};
use super::report::Report;
use super::{page, table};
use crate::output::{CommitError, Disk, Existing, Staging};
use std::path::Path;
use thiserror::Error;

/// Why a report was not written; nothing of it is left behind.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "each is what its type says")]
pub enum ReportError {
    #[error(transparent)]
    Chart(#[from] ChartError),
    #[error(transparent)]
    Commit(#[from] CommitError),
}

/// How much of a report is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Extent {
    /// All of it.
    #[default]
    Everything,
    /// The page, its charts and its tables: what is worth keeping for ever.
    Summary,
}

impl Extent {
    fn holds(self, name: &str) -> bool {
        let detail = name.starts_with("hemisphere_") || name.starts_with("report.");
        self == Self::Everything || !detail
    }
}

/// A folder for a report that is still being measured; dropped, it leaves nothing behind.
pub struct ReportFolder(Staging<'static>);

impl ReportFolder {
    /// Opens `folder`, before hours are spent on what could not be written.
    ///
    /// An earlier report in it is replaced by [`Self::write`]; anything else is left alone.
    ///
    /// # Errors
    /// [`CommitError`] when it holds other files or cannot be written.
    pub fn begin(folder: &Path) -> Result<Self, CommitError> {
        Staging::begin(&Disk, folder, Existing::Replace, is_ours).map(Self)
    }

    /// Writes `report` and every table as JSON and CSV, the charts, and the page that shows them, as far
    /// as `extent` goes, and gives the folder its name.
    ///
    /// # Errors
    /// [`ReportError`].
    pub fn write(mut self, report: &Report, extent: Extent) -> Result<(), ReportError> {
        let mut charts = charts::draw(report)?;
        charts.retain(|(name, _)| extent.holds(name));
        let mut texts = table::texts(report)?;
        texts.retain(|(name, _)| extent.holds(name));
        let page = page::files(report, &charts, extent);
        for (name, bytes) in texts.iter().chain(&page).chain(&charts) {
            self.0.put(name, bytes)?;
        }
        Ok(self.0.commit()?)
    }
}

/// Whether a report may have a file of this name.
fn is_ours(name: &str) -> bool {
    match name.rsplit_once('.') {
        Some(("index", "html")) => true,
        Some((stem, "json" | "csv")) => {
            ["report", "table", "stability"].contains(&stem) || page::TABLES.contains(&stem)
        }
        Some((stem, "png" | "svg")) => {
            stem.starts_with("hemisphere_") || charts::CHARTS.contains(&stem)
        }
        _ => false,
    }
}
