//! A report as files and as text: JSON, CSV, and tables for the terminal.

use super::charts::ChartError;
use super::light_error::Decibel;
use super::published::Published;
use super::report::{CaptureReport, RelitReport, Report, ShadowTruth};
use super::summary::{Figures, RowFigures, RowSummary};
use super::{csv, mse_table, stability};
use serde::Serialize;

/// All of `table.json`: the rows of the report, beside the paper's.
#[derive(Serialize)]
struct Table<'a> {
    rows: &'a [RowSummary],
    published: &'a [Published],
}

/// `report.json` and `report.csv` (one line per capture, row and light), `table.json` and
/// `table.csv` (one line per row), and `stability.json` and `stability.csv` (one line per
/// corruption, row and severity) where captures were made worse: name and contents.
///
/// # Errors
/// [`ChartError::Drawing`] for a report that is no JSON, which would be a bug.
pub(super) fn texts(report: &Report) -> Result<Vec<(String, Vec<u8>)>, ChartError> {
    let table = Table {
        rows: &report.rows,
        published: &report.published,
    };
    let mut texts = vec![
        ("report.json".to_owned(), json("report.json", report)?),
        ("report.csv".to_owned(), csv::csv(report).into_bytes()),
        ("table.json".to_owned(), json("table.json", &table)?),
        ("table.csv".to_owned(), mse_table::csv(report).into_bytes()),
    ];
    if let Some(stability) = &report.stability {
        let csv = stability::csv(stability).into_bytes();
        texts.push((
            "stability.json".to_owned(),
            json("stability.json", stability)?,
        ));
        texts.push(("stability.csv".to_owned(), csv));
    }
    Ok(texts)
}

fn json(name: &str, content: &impl Serialize) -> Result<Vec<u8>, ChartError> {
    serde_json::to_vec_pretty(content).map_err(|error| ChartError::Drawing {
        chart: name.to_owned(),
        problem: error.to_string(),
    })
}

/// Captures whose details are printed; of more, only the table is.
const DETAILED_CAPTURES: usize = 12;

const NAME: usize = 44;

impl std::fmt::Display for Report {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let noisy = self.noisy.iter().flat_map(|noisy| &noisy.captures);
        let captures = self.captures.len();
        if captures <= DETAILED_CAPTURES {
            for capture in &self.captures {
                write_capture(out, capture, "")?;
            }
            for capture in noisy {
                write_capture(out, capture, ", noisy depth")?;
            }
        }
        write_summary(out, captures, "", &self.rows, |row| Some(&row.figures))?;
        if let Some(noisy) = &self.noisy {
            let depth = format!(
                ", noisy depth (noise {} of the span, blur {} pixel at 256×256, seed {})",
                noisy.noise.noise, noisy.noise.blur_pixels, noisy.seed
            );
            write_summary(out, captures, &depth, &self.rows, |row| row.noisy.as_ref())?;
        }
        writeln!(out)?;
        mse_table::write(out, self)?;
        if let Some(stability) = &self.stability {
            write!(out, "\n{stability}")?;
        }
        let Self { machine, .. } = self;
        let build = if machine.release_build {
            "release"
        } else {
            "development"
        };
        writeln!(
            out,
            "  {}, {} threads, {build} build",
            machine.target, machine.threads
        )
    }
}

/// Means over captures of every row, with the depth that `figures` picks.
fn write_summary(
    out: &mut std::fmt::Formatter<'_>,
    captures: usize,
    depth: &str,
    rows: &[RowSummary],
    figures: impl Fn(&RowSummary) -> Option<&RowFigures>,
) -> std::fmt::Result {
    writeln!(
        out,
        "All captures ({captures}){depth}, means of the means over lights"
    )?;
    writeln!(out, "{}", header())?;
    for row in rows {
        let name = format!("{} {}", row.label, row.name);
        match figures(row) {
            None => {}
            Some(RowFigures::Missing { reason }) => {
                writeln!(out, "  {name:NAME$} missing: {reason}")?;
            }
            Some(RowFigures::Present(found)) => match Line::of_row(found) {
                Some(line) => writeln!(out, "  {name:NAME$} {line}")?,
                None => writeln!(out, "  {name:NAME$} relights nothing")?,
            },
        }
    }
    Ok(())
}

/// The figures of one line, in the order of [`header`].
struct Line {
    linear: Decibel,
    worst: Decibel,
    srgb: Decibel,
    ssim: Option<f64>,
    si_mse: f64,
    iou: Option<f64>,
    shadow_mse: Option<f64>,
    milliseconds: Option<f64>,
    answered: f64,
}

fn header() -> String {
    format!(
        "  {:NAME$} {:>9} {:>8} {:>8} {:>6} {:>9} {:>7} {:>8} {:>9} {:>6}",
        "row", "PSNR lin", "worst", "PSNR sRGB", "SSIM", "si-MSE", "sh.IoU", "sh.MSE", "ms", "seen"
    )
}

impl std::fmt::Display for Line {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let number = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        write!(
            out,
            "{:>9} {:>8} {:>9} {:>6} {:>9.2e} {:>7} {:>8} {:>9} {:>5.1}%",
            self.linear,
            self.worst,
            self.srgb,
            number(self.ssim, 3),
            self.si_mse,
            number(self.iou, 3),
            number(self.shadow_mse, 4),
            number(self.milliseconds, 3),
            100.0 * self.answered
        )
    }
}

fn write_capture(
    out: &mut std::fmt::Formatter<'_>,
    capture: &CaptureReport,
    depth: &str,
) -> std::fmt::Result {
    let CaptureReport {
        name,
        width,
        height,
        counted_pixels,
        ..
    } = capture;
    let scale = if capture.scale_known {
        "absolute scale"
    } else {
        "after the best global scale"
    };
    let shadow = match capture.shadow_truth {
        ShadowTruth::Given => "given",
        ShadowTruth::Derived => "derived from the photographs",
        ShadowTruth::Absent => "absent",
    };
    writeln!(
        out,
        "{name}{depth}: {width}×{height}, {counted_pixels} pixels count, {scale}, shadow truth {shadow}"
    )?;
    let relit = || {
        let rows = capture.rows.iter();
        rows.filter_map(|row| Some((row, row.relit.as_ref()?)))
    };
    if relit().next().is_some() {
        writeln!(out, "{}", header())?;
    }
    for (row, relit) in relit() {
        let name = format!("{} {}", row.label, row.name);
        writeln!(out, "  {name:NAME$} {}", Line::of(relit))?;
    }
    for (row, relit) in relit() {
        let [x, y, z] = relit.worst.direction;
        write!(
            out,
            "  {}: worst light {} at {x:.2},{y:.2},{z:.2}; scale {:.4}",
            row.label, relit.worst.light, relit.scale
        )?;
        if let Some(shadow) = relit.shadow {
            let error = shadow.balanced_error_rate;
            write!(out, "; shadow pixels {}", shadow.shadow_pixels)?;
            if let Some(error) = error {
                write!(out, ", balanced error {error:.3}")?;
            }
        }
        writeln!(out)?;
        if !relit.regions.is_empty() {
            let regions: Vec<String> = relit
                .regions
                .iter()
                .map(|error| format!("{} {} dB", error.region.name(), error.linear_psnr_db))
                .collect();
            writeln!(out, "     by region (linear): {}", regions.join(", "))?;
        }
    }
    for silent in &capture.silent {
        writeln!(out, "  {}: no answer: {}", silent.label, silent.reason)?;
    }
    write_scene(out, capture)?;
    let stages: Vec<String> = capture
        .stages
        .iter()
        .map(|stage| {
            format!(
                "{} {:.1} (p95 {:.1})",
                stage.stage, stage.cost.median_ms, stage.cost.p95_ms
            )
        })
        .collect();
    if !stages.is_empty() {
        writeln!(out, "  ms per stage: {}", stages.join(", "))?;
    }
    for remark in &capture.remarks {
        writeln!(out, "  note: {remark}")?;
    }
    writeln!(out)
}

fn write_scene(out: &mut std::fmt::Formatter<'_>, capture: &CaptureReport) -> std::fmt::Result {
    if let Some(error) = capture.scene.normal {
        writeln!(
            out,
            "  normal: mean {:.2}°, median {:.2}°, MSE {:.2e} on [-1,1], {:.2e} on [0,1]",
            error.mean_degrees, error.median_degrees, error.signed_mse, error.unsigned_mse
        )?;
    }
    if let Some(error) = capture.scene.albedo {
        writeln!(
            out,
            "  albedo: PSNR {} dB linear, {} dB sRGB, MSE {:.2e} linear, {:.2e} sRGB, scale {:.4}",
            error.linear_psnr_db,
            error.srgb_psnr_db,
            error.linear_mse,
            error.srgb_mse,
            capture.scene.albedo_scale
        )?;
    }
    if let Some(error) = capture.scene.roughness {
        writeln!(out, "  roughness: MSE {:.2e}", error.mse)?;
    }
    Ok(())
}

impl Line {
    fn of(relit: &RelitReport) -> Self {
        Self {
            linear: relit.mean.linear_psnr_db,
            worst: relit.worst.linear_psnr_db,
            srgb: relit.mean.srgb_psnr_db,
            ssim: relit.mean.srgb_ssim,
            si_mse: relit.mean.scale_invariant_mse,
            iou: relit.shadow.and_then(|shadow| shadow.iou),
            shadow_mse: relit.shadow.map(|shadow| shadow.mse),
            milliseconds: relit.relight.map(|cost| cost.median_ms),
            answered: relit.mean.answered_fraction,
        }
    }

    /// `None` for a row that relights nothing.
    fn of_row(figures: &Figures) -> Option<Self> {
        let mean = figures.mean?;
        Some(Self {
            linear: mean.linear_psnr_db,
            worst: figures.worst_linear_psnr_db?,
            srgb: mean.srgb_psnr_db,
            ssim: mean.srgb_ssim,
            si_mse: mean.scale_invariant_mse,
            iou: figures.shadow_iou,
            shadow_mse: figures.shadow_mse,
            milliseconds: figures.relight_ms,
            answered: mean.answered_fraction,
        })
    }
}
