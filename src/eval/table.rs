//! A report as files and as text: `report.json`, `report.csv`, and a table for the terminal.

use super::charts::ChartError;
use super::light_error::Decibel;
use super::report::{CaptureReport, Report, RowFigures, RowReport, ShadowTruth};
use std::fmt::Write as _;

/// `report.json` and `report.csv` (one line per capture, row and light): name and contents.
///
/// # Errors
/// [`ChartError::Drawing`] for a report that is no JSON, which would be a bug.
pub(super) fn texts(report: &Report) -> Result<Vec<(String, Vec<u8>)>, ChartError> {
    let json = serde_json::to_vec_pretty(report).map_err(|error| ChartError::Drawing {
        chart: "report.json".to_owned(),
        problem: error.to_string(),
    })?;
    Ok(vec![
        ("report.json".to_owned(), json),
        ("report.csv".to_owned(), csv(report).into_bytes()),
    ])
}

/// One line per capture, row and light, and one per missing row; empty fields are unknown.
fn csv(report: &Report) -> String {
    let mut text = String::from(
        "capture,row,name,light,x,y,z,off_axis_degrees,linear_mse,linear_psnr_db,srgb_mse,srgb_psnr_db,\
         srgb_ssim,scale_invariant_mse,pixels,unanswered,shadow_mse,shadow_iou,shadow_ber,shadow_pixels,remark\n",
    );
    for capture in &report.captures {
        for row in &capture.rows {
            for light in &row.lights {
                let [x, y, z] = light.direction;
                let error = &light.error;
                let number =
                    |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
                let shadow = light.shadow;
                let fields = [
                    quoted(&capture.name),
                    row.row.to_string(),
                    quoted(&row.name),
                    light.light.to_string(),
                    x.to_string(),
                    y.to_string(),
                    z.to_string(),
                    format!("{:.3}", light.off_axis_degrees()),
                    error.linear_mse.to_string(),
                    error.linear_psnr_db.0.to_string(),
                    error.srgb_mse.to_string(),
                    error.srgb_psnr_db.0.to_string(),
                    number(error.srgb_ssim),
                    error.scale_invariant_mse.to_string(),
                    error.pixels.to_string(),
                    error.unanswered.to_string(),
                    number(shadow.map(|shadow| shadow.mse)),
                    number(shadow.and_then(|shadow| shadow.iou)),
                    number(shadow.and_then(|shadow| shadow.balanced_error_rate)),
                    shadow.map_or_else(String::new, |shadow| shadow.shadow_pixels.to_string()),
                    String::new(),
                ];
                text.push_str(&fields.join(","));
                text.push('\n');
            }
        }
    }
    for row in &report.rows {
        if let RowFigures::Missing { reason } = &row.figures {
            let blanks = ",".repeat(18);
            let (name, remark) = (quoted(&row.name), quoted(&format!("missing: {reason}")));
            _ = writeln!(text, ",{},{name}{blanks}{remark}", row.row);
        }
    }
    text
}

/// A CSV field (RFC 4180).
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

const NAME: usize = 40;

impl std::fmt::Display for Report {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for capture in &self.captures {
            write_capture(out, capture)?;
        }
        let captures = self.captures.len();
        writeln!(
            out,
            "All captures ({captures}), means of the means over lights"
        )?;
        writeln!(out, "{}", header())?;
        for row in &self.rows {
            let name = format!("{} {}", row.row, row.name);
            match &row.figures {
                RowFigures::Missing { reason } => {
                    writeln!(out, "  {name:NAME$} missing: {reason}")?
                }
                RowFigures::Present {
                    mean,
                    worst_linear_psnr_db,
                    shadow_iou,
                    shadow_mse,
                    relight_ms,
                    ..
                } => {
                    let line = Figures {
                        linear: mean.linear_psnr_db,
                        worst: *worst_linear_psnr_db,
                        srgb: mean.srgb_psnr_db,
                        ssim: mean.srgb_ssim,
                        si_mse: mean.scale_invariant_mse,
                        iou: *shadow_iou,
                        shadow_mse: *shadow_mse,
                        milliseconds: *relight_ms,
                        answered: mean.answered_fraction,
                    };
                    writeln!(out, "  {name:NAME$} {line}")?;
                }
            }
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

/// The figures of one line, in the order of [`header`].
struct Figures {
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

impl std::fmt::Display for Figures {
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

fn write_capture(out: &mut std::fmt::Formatter<'_>, capture: &CaptureReport) -> std::fmt::Result {
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
        "{name}: {width}×{height}, {counted_pixels} pixels count, {scale}, shadow truth {shadow}"
    )?;
    if !capture.rows.is_empty() {
        writeln!(out, "{}", header())?;
    }
    for row in &capture.rows {
        let name = format!("{} {}", row.row, row.name);
        writeln!(out, "  {name:NAME$} {}", Figures::of(row))?;
    }
    for row in &capture.rows {
        let [x, y, z] = row.worst.direction;
        write!(
            out,
            "  {}: worst light {} at {x:.2},{y:.2},{z:.2}; scale {:.4}",
            row.row, row.worst.light, row.scale
        )?;
        if let Some(shadow) = row.shadow {
            let error = shadow.balanced_error_rate;
            write!(out, "; shadow pixels {}", shadow.shadow_pixels)?;
            if let Some(error) = error {
                write!(out, ", balanced error {error:.3}")?;
            }
        }
        writeln!(out)?;
        if !row.regions.is_empty() {
            let regions: Vec<String> = row
                .regions
                .iter()
                .map(|error| format!("{} {} dB", error.region.name(), error.linear_psnr_db))
                .collect();
            writeln!(out, "     by region (linear): {}", regions.join(", "))?;
        }
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

impl Figures {
    fn of(row: &RowReport) -> Self {
        Self {
            linear: row.mean.linear_psnr_db,
            worst: row.worst.linear_psnr_db,
            srgb: row.mean.srgb_psnr_db,
            ssim: row.mean.srgb_ssim,
            si_mse: row.mean.scale_invariant_mse,
            iou: row.shadow.and_then(|shadow| shadow.iou),
            shadow_mse: row.shadow.map(|shadow| shadow.mse),
            milliseconds: row.relight.map(|cost| cost.median_ms),
            answered: row.mean.answered_fraction,
        }
    }
}
