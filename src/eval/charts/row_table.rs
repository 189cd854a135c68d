//! The rows as a table with bars: every figure of every row, the missing ones named.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use super::speed_accuracy::named;
use crate::eval::light_error::Decibel;
use crate::eval::report::{Report, RowFigures, RowReport};
use plotters::prelude::*;

const WIDTH: i32 = 1240;
const TOP: i32 = 128;
const LINE: i32 = 34;
const BAR_X: i32 = 400;
const BAR_LENGTH: i32 = 200;
/// Right edges of the number columns after the bar.
const COLUMNS: [(i32, &str, &str); 7] = [
    (740, "worst", "dB linear"),
    (825, "mean", "dB sRGB"),
    (905, "SSIM", "sRGB"),
    (1005, "si-MSE", "linear"),
    (1075, "shadow", "IoU"),
    (1140, "shadow", "MSE"),
    (1220, "relight", "ms"),
];

/// A block of rows for all captures together and one for each.
pub(super) struct RowTable<'a> {
    report: &'a Report,
}

impl<'a> RowTable<'a> {
    pub(super) fn new(report: &'a Report) -> Self {
        Self { report }
    }

    /// Blocks of the per-capture rows are shown when there is more than one capture.
    fn blocks(&self) -> &'a [crate::eval::report::CaptureReport] {
        if self.report.captures.len() > 1 {
            &self.report.captures
        } else {
            &[]
        }
    }

    /// Bars begin at 0 dB and end here.
    fn full_db(&self) -> f64 {
        self.report
            .captures
            .iter()
            .flat_map(|capture| &capture.rows)
            .map(|row| row.mean.linear_psnr_db.0)
            .filter(|value| value.is_finite())
            .fold(10.0, f64::max)
    }

    fn line<B: DrawingBackend>(&self, area: &Canvas<B>, y: i32, line: &Line) -> Drawn<B> {
        let style = |horizontal| text(8, INK, horizontal, VPos::Center);
        area.draw_text(
            &format!("{} {}", line.row, line.name),
            &style(HPos::Left),
            (40, y),
        )?;
        let share = (line.mean_db.0 / self.full_db()).clamp(0.0, 1.0);
        let end = BAR_X + (share * f64::from(BAR_LENGTH)) as i32;
        area.draw(&Rectangle::new(
            [(BAR_X, y - 9), (end, y + 9)],
            row_color(line.row).filled(),
        ))?;
        area.draw_text(&line.mean_db.to_string(), &style(HPos::Left), (end + 6, y))?;
        for ((right, _, _), figure) in COLUMNS.iter().zip(&line.figures) {
            area.draw_text(figure, &style(HPos::Right), (*right, y))?;
        }
        Ok(())
    }

    fn header<B: DrawingBackend>(area: &Canvas<B>) -> Drawn<B> {
        let style = |horizontal| text(7, FAINT, horizontal, VPos::Center);
        area.draw_text("row", &style(HPos::Left), (40, TOP - 32))?;
        area.draw_text(
            "mean PSNR, dB linear (bars from 0)",
            &style(HPos::Left),
            (BAR_X, TOP - 32),
        )?;
        for (right, name, unit) in COLUMNS {
            area.draw_text(name, &style(HPos::Right), (right, TOP - 40))?;
            area.draw_text(unit, &style(HPos::Right), (right, TOP - 23))?;
        }
        Ok(())
    }
}

/// One printed line.
struct Line {
    row: u8,
    name: String,
    mean_db: Decibel,
    figures: [String; 7],
}

impl Line {
    fn of_capture(row: &RowReport) -> Self {
        Self {
            row: row.row,
            name: row.name.clone(),
            mean_db: row.mean.linear_psnr_db,
            figures: [
                row.worst.linear_psnr_db.to_string(),
                row.mean.srgb_psnr_db.to_string(),
                figure(row.mean.srgb_ssim, 3),
                format!("{:.2e}", row.mean.scale_invariant_mse),
                figure(row.shadow.and_then(|shadow| shadow.iou), 3),
                figure(row.shadow.map(|shadow| shadow.mse), 4),
                figure(row.relight.map(|cost| cost.median_ms), 2),
            ],
        }
    }
}

impl Chart for RowTable<'_> {
    fn size(&self) -> (u32, u32) {
        let lines = 1
            + self.report.rows.len() as i32
            + self
                .blocks()
                .iter()
                .map(|capture| 1 + capture.rows.len() as i32)
                .sum::<i32>();
        (WIDTH as u32, (TOP + lines * LINE + 20) as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(area, "Relighting error by row", 13, (30, 14))?;
        let subtitle = "values in [0, 1], white Lambertian = 1; higher is better for PSNR, SSIM and IoU; – = no truth";
        area.draw_text(subtitle, &text(8, FAINT, HPos::Left, VPos::Top), (30, 48))?;
        Self::header(area)?;
        let mut y = TOP;
        let block = |area: &Canvas<B>, y: i32, name: &str| {
            area.draw(&PathElement::new(
                vec![(30, y - 14), (WIDTH - 20, y - 14)],
                HAIR,
            ))?;
            area.draw_text(name, &text(9, INK, HPos::Left, VPos::Center), (30, y + 4))
        };
        let names = self.report.capture_names();
        let all = match names.as_slice() {
            [one] => (*one).to_owned(),
            several => format!("mean over captures: {}", named(several)),
        };
        block(area, y, &all)?;
        y += LINE;
        for summary in &self.report.rows {
            match &summary.figures {
                RowFigures::Present {
                    mean,
                    worst_linear_psnr_db,
                    shadow_iou,
                    shadow_mse,
                    relight_ms,
                    ..
                } => {
                    let line = Line {
                        row: summary.row,
                        name: summary.name.clone(),
                        mean_db: mean.linear_psnr_db,
                        figures: [
                            worst_linear_psnr_db.to_string(),
                            mean.srgb_psnr_db.to_string(),
                            figure(mean.srgb_ssim, 3),
                            format!("{:.2e}", mean.scale_invariant_mse),
                            figure(*shadow_iou, 3),
                            figure(*shadow_mse, 4),
                            figure(*relight_ms, 2),
                        ],
                    };
                    self.line(area, y, &line)?;
                }
                RowFigures::Missing { reason } => {
                    let style = text(8, FAINT, HPos::Left, VPos::Center);
                    let name = format!("{} {}", summary.row, summary.name);
                    area.draw_text(&name, &style, (40, y))?;
                    area.draw_text(&format!("missing: {reason}"), &style, (BAR_X, y))?;
                }
            }
            y += LINE;
        }
        for capture in self.blocks() {
            block(area, y, &capture.name)?;
            y += LINE;
            for row in &capture.rows {
                self.line(area, y, &Line::of_capture(row))?;
                y += LINE;
            }
        }
        Ok(())
    }
}

/// A number with so many digits after the point, or a dash.
fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}
