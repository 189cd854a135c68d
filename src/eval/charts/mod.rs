//! A report as pictures: error by light direction, speed against accuracy, rows.

mod canvas;
mod hemisphere;
mod row_table;
mod speed_accuracy;

use super::report::Report;
pub use canvas::ChartError;

/// Draws every chart of a report, each as PNG and as SVG: `rows`, `speed_accuracy`, and one
/// `hemisphere_CAPTURE` per capture with lights. File names and contents; no name comes twice.
///
/// # Errors
/// [`ChartError::Drawing`] when a picture cannot be drawn.
pub fn draw(report: &Report) -> Result<Vec<(String, Vec<u8>)>, ChartError> {
    let mut files = Vec::new();
    files.extend(canvas::encode(&row_table::RowTable::new(report), "rows")?);
    files.extend(canvas::encode(
        &speed_accuracy::SpeedAccuracy::new(report),
        "speed_accuracy",
    )?);
    let mut stems: Vec<String> = Vec::new();
    for capture in report
        .captures
        .iter()
        .filter(|capture| !capture.rows.is_empty())
    {
        let mut stem = format!("hemisphere_{}", capture.name);
        // Captures of one name from several folders.
        while stems.contains(&stem) {
            stem.push('_');
        }
        files.extend(canvas::encode(
            &hemisphere::Hemisphere::new(capture),
            &stem,
        )?);
        stems.push(stem);
    }
    Ok(files)
}
