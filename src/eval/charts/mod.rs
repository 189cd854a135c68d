//! A report as pictures: speed against accuracy, stability, parsimony, error by light direction and by
//! region, rows.

mod angle_curves;
mod canvas;
mod color_scales;
mod hemisphere;
mod light_sets;
mod parsimony_map;
mod polar_maps;
mod region_bars;
mod row_table;
mod speed_accuracy;
mod stability_curves;
mod timing;

use super::report::Report;
use super::savings::Savings;
pub use canvas::ChartError;
pub use timing::timing;

/// Stems of the charts that a report may have, but for one `hemisphere_ROW` per row that relit
/// something.
pub(super) const CHARTS: [&str; 8] = [
    "rows",
    "speed_accuracy",
    "angle_curves",
    "regions",
    "parsimony",
    "stability",
    "light_sets",
    "polar_maps",
];

/// Draws every chart of a report, each as PNG and as SVG: `CHARTS` (`stability` where captures
/// were made worse, `light_sets` where those were compared), and one `hemisphere_ROW` per row that relit something. File names and contents.
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
    files.extend(canvas::encode(
        &region_bars::RegionBars::new(report),
        "regions",
    )?);
    files.extend(canvas::encode(
        &parsimony_map::ParsimonyMap::new(Savings::of(report)),
        "parsimony",
    )?);
    if let Some(stability) = &report.stability {
        files.extend(canvas::encode(
            &stability_curves::StabilityCurves::new(stability),
            "stability",
        )?);
    }
    if !report.light_sets.is_empty() {
        let sets = light_sets::LightSets(&report.light_sets);
        files.extend(canvas::encode(&sets, "light_sets")?);
    }
    let scales = color_scales::ColorScales::new(report);
    files.extend(canvas::encode(
        &polar_maps::PolarMaps::new(report, &scales),
        "polar_maps",
    )?);
    for row in &report.rows {
        if let Some(maps) = hemisphere::Hemisphere::new(report, row, &scales) {
            files.extend(canvas::encode(&maps, &format!("hemisphere_{}", row.label))?);
        }
    }
    Ok(files)
}
