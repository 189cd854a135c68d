//! A report as pictures: error by light direction, speed against accuracy, rows.

mod angle_curves;
mod canvas;
mod color_scales;
mod hemisphere;
mod row_table;
mod speed_accuracy;

use super::report::Report;
pub use canvas::ChartError;

/// Draws every chart of a report, each as PNG and as SVG: `rows`, `speed_accuracy`,
/// `angle_curves`, and one `hemisphere_ROW` per row that relit something. File names and contents.
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
    files.extend(canvas::encode(
        &angle_curves::AngleCurves::new(report),
        "angle_curves",
    )?);
    let scales = color_scales::ColorScales::new(report);
    for row in &report.rows {
        if let Some(maps) = hemisphere::Hemisphere::new(report, row, &scales) {
            files.extend(canvas::encode(&maps, &format!("hemisphere_{}", row.label))?);
        }
    }
    Ok(files)
}
