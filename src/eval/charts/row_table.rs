//! The rows as a table with bars: every figure of every row, the missing ones named.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use super::speed_accuracy::named;
use crate::eval::light_error::Decibel;
use crate::eval::report::{CaptureReport, RelitReport, Report};
use crate::eval::summary::{Figures, RowFigures};
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

/// Captures that get blocks of their own; of more, only the means are drawn.
const DETAILED_CAPTURES: usize = 12;

/// What stands under one heading.
struct Block<'a> {
    heading: String,
    rows: Vec<(String, Entry<'a>)>,
}

/// One row of a block.
enum Entry<'a> {
    Line(Line),
    Missing(&'a str),
}

/// A block of rows for all captures together, clean and noisy, and one for each.
pub(super) struct RowTable<'a> {
    report: &'a Report,
}

impl<'a> RowTable<'a> {
    pub(super) fn new(report: &'a Report) -> Self {
        Self { report }
    }

    /// Means first, then the captures where there are several, but not many.
    fn blocks(&self) -> Vec<Block<'a>> {
        let names = self.report.capture_names();
        let all = match names.as_slice() {
            [one] => (*one).to_owned(),
            several => format!("mean over captures: {}", named(several)),
        };
        let clean = self.report.rows.iter().map(|row| (row, Some(&row.figures)));
        let noisy = self.report.rows.iter().map(|row| (row, row.noisy.as_ref()));
        let means: [(String, Vec<_>); 2] = [
            (all.clone(), clean.collect()),
            (format!("{all}, noisy depth"), noisy.collect()),
        ];
        let mut blocks = Vec::new();
        for (heading, rows) in means {
            let rows: Vec<_> = rows
                .into_iter()
                .filter_map(|(row, figures)| {
                    let name = format!("{} {}", row.label, row.name);
                    Some((name, Entry::of_mean(&row.label, figures?)))
                })
                .collect();
            if !rows.is_empty() {
                blocks.push(Block { heading, rows });
            }
        }
        if !(2..=DETAILED_CAPTURES).contains(&names.len()) {
            return blocks;
        }
        let noisy = self.report.noisy.iter().flat_map(|noisy| &noisy.captures);
        let captures = self.report.captures.iter().map(|capture| (capture, ""));
        for (capture, depth) in captures.chain(noisy.map(|capture| (capture, ", noisy depth"))) {
            blocks.push(Block {
                heading: format!("{}{depth}", capture.name),
                rows: of_capture(capture),
            });
        }
        blocks
    }

    /// Bars begin at 0 dB and end here.
    fn full_db(&self) -> f64 {
        self.report
            .captures
            .iter()
            .flat_map(|capture| &capture.rows)
            .filter_map(|row| Some(row.relit.as_ref()?.mean.linear_psnr_db.0))
            .filter(|value| value.is_finite())
            .fold(10.0, f64::max)
    }

    fn line<B: DrawingBackend>(
        &self,
        area: &Canvas<B>,
        y: i32,
        (name, line): (&str, &Line),
    ) -> Drawn<B> {
        let style = |horizontal| text(8, INK, horizontal, VPos::Center);
        area.draw_text(name, &style(HPos::Left), (40, y))?;
        let share = (line.mean_db.0 / self.full_db()).clamp(0.0, 1.0);
        let end = BAR_X + (share * f64::from(BAR_LENGTH)) as i32;
        area.draw(&Rectangle::new(
            [(BAR_X, y - 9), (end, y + 9)],
            row_color(&line.label).filled(),
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

/// The rows of one capture that relit something.
fn of_capture(capture: &CaptureReport) -> Vec<(String, Entry<'_>)> {
    let rows = capture.rows.iter().filter_map(|row| {
        let line = Line::of_capture(&row.label, row.relit.as_ref()?);
        Some((format!("{} {}", row.label, row.name), Entry::Line(line)))
    });
    rows.collect()
}

/// One printed line.
struct Line {
    label: String,
    mean_db: Decibel,
    figures: [String; 7],
}

impl Line {
    fn of_capture(label: &str, relit: &RelitReport) -> Self {
        Self {
            label: label.to_owned(),
            mean_db: relit.mean.linear_psnr_db,
            figures: [
                relit.worst.linear_psnr_db.to_string(),
                relit.mean.srgb_psnr_db.to_string(),
                figure(relit.mean.srgb_ssim, 3),
                format!("{:.2e}", relit.mean.scale_invariant_mse),
                figure(relit.shadow.and_then(|shadow| shadow.iou), 3),
                figure(relit.shadow.map(|shadow| shadow.mse), 4),
                figure(relit.relight.map(|cost| cost.median_ms), 2),
            ],
        }
    }

    /// `None` for a row that relights nothing.
    fn of_mean(label: &str, figures: &Figures) -> Option<Self> {
        let mean = figures.mean?;
        Some(Self {
            label: label.to_owned(),
            mean_db: mean.linear_psnr_db,
            figures: [
                figures.worst_linear_psnr_db?.to_string(),
                mean.srgb_psnr_db.to_string(),
                figure(mean.srgb_ssim, 3),
                format!("{:.2e}", mean.scale_invariant_mse),
                figure(figures.shadow_iou, 3),
                figure(figures.shadow_mse, 4),
                figure(figures.relight_ms, 2),
            ],
        })
    }
}

impl<'a> Entry<'a> {
    fn of_mean(label: &str, figures: &'a RowFigures) -> Self {
        match figures {
            RowFigures::Missing { reason } => Self::Missing(reason),
            RowFigures::Present(figures) => match Line::of_mean(label, figures) {
                Some(line) => Self::Line(line),
                None => Self::Missing("relights nothing; surfaces in table.csv"),
            },
        }
    }
}

impl Chart for RowTable<'_> {
    fn size(&self) -> (u32, u32) {
        let lines: usize = self.blocks().iter().map(|block| 1 + block.rows.len()).sum();
        (WIDTH as u32, (TOP + lines as i32 * LINE + 20) as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(area, "Relighting error by row", 13, (30, 14))?;
        let subtitle = "values in [0, 1], white Lambertian = 1; higher is better for PSNR, SSIM and IoU; – = no truth";
        area.draw_text(subtitle, &text(8, FAINT, HPos::Left, VPos::Top), (30, 48))?;
        Self::header(area)?;
        let mut y = TOP;
        for block in self.blocks() {
            area.draw(&PathElement::new(
                vec![(30, y - 14), (WIDTH - 20, y - 14)],
                HAIR,
            ))?;
            let style = text(9, INK, HPos::Left, VPos::Center);
            area.draw_text(&block.heading, &style, (30, y + 4))?;
            y += LINE;
            for (name, entry) in &block.rows {
                match entry {
                    Entry::Line(line) => self.line(area, y, (name, line))?,
                    Entry::Missing(reason) => {
                        let style = text(8, FAINT, HPos::Left, VPos::Center);
                        area.draw_text(name, &style, (40, y))?;
                        let reason = format!("missing: {reason}");
                        area.draw_text(&reason, &style, (BAR_X, y))?;
                    }
                }
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
