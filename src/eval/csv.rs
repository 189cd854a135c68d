//! `report.csv`: every light of every row of every capture.

use super::report::{CaptureReport, LightReport, Report, RowReport};
use super::summary::RowFigures;
use std::fmt::Write as _;

/// One line per capture, row and light, and one per missing row; empty fields are unknown.
pub(super) fn csv(report: &Report) -> String {
    let mut text = String::from(
        "capture,depth,row,name,light,x,y,z,off_axis_degrees,linear_mse,linear_psnr_db,srgb_mse,srgb_psnr_db,\
         srgb_ssim,scale_invariant_mse,pixels,unanswered,shadow_mse,shadow_iou,shadow_ber,shadow_pixels,remark\n",
    );
    let noisy = report.noisy.iter().flat_map(|noisy| &noisy.captures);
    let clean = report.captures.iter().map(|capture| ("clean", capture));
    for (depth, capture) in clean.chain(noisy.map(|capture| ("noisy", capture))) {
        for row in &capture.rows {
            for light in row.relit.iter().flat_map(|relit| &relit.lights) {
                text.push_str(&line(depth, capture, row, light));
                text.push('\n');
            }
        }
    }
    for row in &report.rows {
        let noisy = row.noisy.as_ref().map(|figures| ("noisy", figures));
        for (depth, figures) in [("clean", &row.figures)].into_iter().chain(noisy) {
            if let RowFigures::Missing { reason } = figures {
                let blanks = ",".repeat(18);
                let (name, remark) = (quoted(&row.name), quoted(&format!("missing: {reason}")));
                _ = writeln!(text, ",{depth},{},{name}{blanks}{remark}", row.label);
            }
        }
    }
    text
}

fn line(depth: &str, capture: &CaptureReport, row: &RowReport, light: &LightReport) -> String {
    let [x, y, z] = light.direction;
    let error = &light.error;
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let shadow = light.shadow;
    let fields = [
        quoted(&capture.name),
        depth.to_owned(),
        row.label.clone(),
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
    fields.join(",")
}

/// A CSV field (RFC 4180).
pub(super) fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}
