//! Stability: error against severity, one panel per corruption, one curve per row.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use crate::corruption::MOST_SEVERE;
use crate::eval::stability::{RowCurve, StabilityReport, WayReport};
use plotters::prelude::*;

const COLUMNS: usize = 3;
const WIDTH: i32 = 1010;
/// From one panel to the next.
const PITCH: (i32, i32) = (324, 236);
const PLOT: (i32, i32) = (252, 140);
const LEFT: i32 = 58;
/// Height of the title, its explanation and the marks, without the rows of the legend.
const HEAD: i32 = 104;
/// Height of a row of the legend, which has two columns.
const ENTRY: i32 = 22;
/// Letters of a panel's second line.
const LETTERS: usize = 42;

/// All corruptions of one report.
pub(super) struct StabilityCurves<'a> {
    report: &'a StabilityReport,
    captures: usize,
    /// Whole decades of the error axis.
    decades: (i32, i32),
}

impl<'a> StabilityCurves<'a> {
    pub(super) fn new(report: &'a StabilityReport) -> Self {
        let points = report.ways.iter().flat_map(|way| &way.rows);
        let errors = points.flat_map(|row| &row.points);
        let errors: Vec<f64> = errors.map(|point| height(point.linear_mse)).collect();
        let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
        let most = errors.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let decades = if least <= most {
            (
                least.floor() as i32,
                (most.ceil() as i32).max(least.floor() as i32 + 1),
            )
        } else {
            (-3, -1)
        };
        Self {
            report,
            captures: report.captures.len(),
            decades,
        }
    }

    fn legend_lines(&self) -> i32 {
        (self.report.growth.len() as i32 + 1) / 2
    }

    /// Where panels begin.
    fn top(&self) -> i32 {
        HEAD + self.legend_lines() * ENTRY + 30
    }

    fn legend<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        for (index, row) in self.report.growth.iter().enumerate() {
            let index = index as i32;
            let (x, y) = (
                30 + index / self.legend_lines() * 490,
                HEAD + index % self.legend_lines() * ENTRY,
            );
            let color = row_color(&row.label);
            let line = vec![(x, y), (x + 26, y)];
            area.draw(&PathElement::new(line, color.stroke_width(3)))?;
            area.draw(&Circle::new((x + 13, y), 4, color.filled()))?;
            let style = text(8, INK, HPos::Left, VPos::Center);
            area.draw_text(&format!("{} {}", row.label, row.name), &style, (x + 34, y))?;
        }
        Ok(())
    }

    fn panel<B: DrawingBackend>(
        &self,
        area: &Canvas<B>,
        (left, top): (i32, i32),
        way: &WayReport,
    ) -> Drawn<B> {
        let (width, tall) = PLOT;
        let bottom = top + tall;
        let x = |severity: u8| {
            left + (f64::from(severity) / f64::from(MOST_SEVERE) * f64::from(width)).round() as i32
        };
        let (low, high) = self.decades;
        let y = |mse: f64| {
            let share = (height(mse) - f64::from(low)) / f64::from(high - low);
            bottom - (share * f64::from(tall)).round() as i32
        };
        let style = text(8, INK, HPos::Left, VPos::Bottom);
        area.draw_text(way.name, &style, (left, top - 21))?;
        let small = |horizontal, vertical| text(6, FAINT, horizontal, vertical);
        let levels = shortened(&levels(way));
        area.draw_text(&levels, &small(HPos::Left, VPos::Bottom), (left, top - 6))?;
        for decade in low..=high {
            let at = y(10f64.powi(decade));
            area.draw(&PathElement::new(
                vec![(left, at), (left + width, at)],
                HAIR,
            ))?;
            let label = format!("{}", 10f64.powi(decade));
            area.draw_text(&label, &small(HPos::Right, VPos::Center), (left - 6, at))?;
        }
        for severity in 0..=MOST_SEVERE {
            let at = x(severity);
            area.draw(&PathElement::new(vec![(at, top), (at, bottom)], HAIR))?;
            let style = small(HPos::Center, VPos::Top);
            area.draw_text(&severity.to_string(), &style, (at, bottom + 5))?;
        }
        let frame = [(left, top), (left + width, bottom)];
        area.draw(&Rectangle::new(frame, FAINT.stroke_width(1)))?;
        // Doing nothing on top: it is what the others are held against.
        for curve in way.rows.iter().rev() {
            let color = row_color(&curve.label);
            let points = curve.points.iter();
            let points: Vec<(i32, i32)> = points
                .map(|point| (x(point.severity), y(point.linear_mse)))
                .collect();
            for point in &points {
                area.draw(&Circle::new(*point, 3, color.filled()))?;
            }
            area.draw(&PathElement::new(points, color.stroke_width(2)))?;
        }
        for curve in &way.rows {
            if let Some((severity, mse)) = first_worse(curve) {
                cross(area, (x(severity), y(mse)), row_color(&curve.label))?;
            }
        }
        if way.refused > 0 {
            let states = self.captures * self.report.severities.len();
            let note = format!("{} of {states} cannot be developed", way.refused);
            let style = small(HPos::Left, VPos::Top);
            area.draw_text(&note, &style, (left + 5, top + 5))?;
        }
        Ok(())
    }
}

impl Chart for StabilityCurves<'_> {
    fn size(&self) -> (u32, u32) {
        let lines = self.report.ways.len().div_ceil(COLUMNS) as i32;
        (WIDTH as u32, (self.top() + lines * PITCH.1) as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let title =
            "Stability: error of the relit picture as the capture gets worse (lower is better)";
        heading(area, title, 11, (30, 14))?;
        let mut lines = [
            "up: mean squared error, linear light, white = 1, log scale; right: severity, 0 = as it came; one panel per corruption".to_owned(),
            format!("mean over {} captures; under each name: how much happens at severity 1 to 5", self.captures),
        ];
        if self.captures == 1 {
            lines[1] = lines[1].replace("mean over 1 captures", "one capture");
        }
        for (line, words) in lines.iter().enumerate() {
            let style = text(7, FAINT, HPos::Left, VPos::Top);
            area.draw_text(words, &style, (30, 42 + 18 * line as i32))?;
        }
        self.legend(area)?;
        let y = HEAD + self.legend_lines() * ENTRY;
        cross(area, (43, y), INK)?;
        let style = text(7, INK, HPos::Left, VPos::Center);
        let mark = "from here on worse than doing nothing with the same captures";
        area.draw_text(mark, &style, (64, y))?;
        for (index, way) in self.report.ways.iter().enumerate() {
            let (column, line) = ((index % COLUMNS) as i32, (index / COLUMNS) as i32);
            let corner = (LEFT + column * PITCH.0, self.top() + 44 + line * PITCH.1);
            self.panel(area, corner, way)?;
        }
        Ok(())
    }
}

/// Logarithm of an error; one under 100 dB is drawn at 100 dB.
fn height(mse: f64) -> f64 {
    mse.max(1e-10).log10()
}

/// Severity and error where the row is first worse than doing nothing.
fn first_worse(curve: &RowCurve) -> Option<(u8, f64)> {
    let severity = curve.worse_than_nothing_from?;
    let mut points = curve.points.iter();
    let point = points.find(|point| point.severity == severity)?;
    Some((severity, point.linear_mse))
}

/// A ringed cross.
fn cross<B: DrawingBackend>(area: &Canvas<B>, (x, y): (i32, i32), color: RGBColor) -> Drawn<B> {
    area.draw(&Circle::new((x, y), 8, WHITE.filled()))?;
    area.draw(&Circle::new((x, y), 8, color.stroke_width(2)))?;
    for stroke in [
        [(x - 4, y - 4), (x + 4, y + 4)],
        [(x - 4, y + 4), (x + 4, y - 4)],
    ] {
        area.draw(&PathElement::new(stroke.to_vec(), color.stroke_width(2)))?;
    }
    Ok(())
}

/// How much happens at the first and the last severity.
fn levels(way: &WayReport) -> String {
    let [first, .., last] = way.levels;
    format!("{first} to {last} {}", way.unit)
}

fn shortened(words: &str) -> String {
    if words.chars().count() <= LETTERS {
        return words.to_owned();
    }
    let kept: String = words.chars().take(LETTERS - 1).collect();
    format!("{}…", kept.trim_end())
}
