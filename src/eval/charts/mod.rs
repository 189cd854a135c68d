//! A report as pictures: error by light direction, speed against accuracy, rows.

mod canvas;
mod hemisphere;
mod row_table;
mod speed_accuracy;

use super::report::Report;
pub use canvas::ChartError;
use std::path::Path;

/// Writes every chart of a report into a folder, each as PNG and as SVG: `rows`,
/// `speed_accuracy`, and one `hemisphere_CAPTURE` per capture with lights.
///
/// # Errors
/// [`ChartError::Io`] when a file cannot be written; [`ChartError::Drawing`] when a picture cannot
/// be drawn.
pub fn write_charts(report: &Report, folder: &Path) -> Result<(), ChartError> {
    canvas::write(&row_table::RowTable::new(report), folder, "rows")?;
    canvas::write(
        &speed_accuracy::SpeedAccuracy::new(report),
        folder,
        "speed_accuracy",
    )?;
    for capture in report
        .captures
        .iter()
        .filter(|capture| !capture.rows.is_empty())
    {
        let stem = format!("hemisphere_{}", capture.name);
        canvas::write(&hemisphere::Hemisphere::new(capture), folder, &stem)?;
    }
    Ok(())
}
