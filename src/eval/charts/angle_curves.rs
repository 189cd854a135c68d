//! PSNR and shadow error against the lamp's angle off the camera's axis, one curve per row.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use super::speed_accuracy::named;
use crate::eval::directions::{BAND_DEGREES, PSNR, Quantity, SHADOW_MSE, by_angle, lights_of};
use crate::eval::report::{CaptureReport, Report};
use plotters::prelude::*;

const WIDTH: i32 = 1580;
const TOP: i32 = 110;
const PLOT: (i32, i32) = (480, 420);
/// Left edges of the two plots.
const LEFTS: [i32; 2] = [80, 650];
const LEGEND: i32 = 1190;
/// Lines of the legend below the rows.
const MARKS: [&str; 3] = [
    "solid: clean depth; dashed: noisy depth",
    "point: mean over the lamps of ten degrees,",
    "over all captures",
];

/// One curve: row, whether its depth is noisy, (degrees, value) from the axis outward.
struct Curve {
    label: String,
    noisy: bool,
    points: Vec<(f64, f64)>,
}

/// A plot with its curves.
struct Plot {
    title: &'static str,
    curves: Vec<Curve>,
    low: f64,
    high: f64,
    step: f64,
    digits: usize,
}

/// All rows of one report.
pub(super) struct AngleCurves<'a> {
    report: &'a Report,
    plots: [Plot; 2],
}

impl<'a> AngleCurves<'a> {
    pub(super) fn new(report: &'a Report) -> Self {
        let psnr = curves(report, PSNR, 1.0);
        let shadow = curves(report, SHADOW_MSE, 100.0);
        let values = |curves: &[Curve]| -> Vec<f64> {
            let points = curves.iter().flat_map(|curve| &curve.points);
            points.map(|point| point.1).collect()
        };
        let lowest = values(&psnr).into_iter().min_by(f64::total_cmp);
        let highest = values(&psnr).into_iter().max_by(f64::total_cmp);
        let worst = values(&shadow).into_iter().max_by(f64::total_cmp);
        let step = nice_step(worst.unwrap_or(10.0));
        Self {
            report,
            plots: [
                Plot {
                    title: "PSNR of the relit picture (dB, linear light)",
                    low: (lowest.unwrap_or(0.0) / 5.0).floor() * 5.0,
                    high: (highest.unwrap_or(40.0) / 5.0).ceil() * 5.0 + 1.0,
                    curves: psnr,
                    step: 5.0,
                    digits: 0,
                },
                Plot {
                    title: "cast-shadow MSE (×1e-2)",
                    low: 0.0,
                    high: (worst.unwrap_or(10.0) / step).ceil().max(1.0) * step,
                    curves: shadow,
                    step,
                    digits: if step < 1.0 { 1 } else { 0 },
                },
            ],
        }
    }

    fn plot<B: DrawingBackend>(&self, area: &Canvas<B>, left: i32, plot: &Plot) -> Drawn<B> {
        let (width, height) = PLOT;
        let bottom = TOP + height;
        let x = |degrees: f64| left + (degrees / 90.0 * f64::from(width)).round() as i32;
        let y = |value: f64| {
            let share = (value - plot.low) / (plot.high - plot.low);
            bottom - (share * f64::from(height)).round() as i32
        };
        for degrees in (0..=90).step_by(BAND_DEGREES as usize) {
            let at = x(f64::from(degrees));
            area.draw(&PathElement::new(vec![(at, TOP), (at, bottom)], HAIR))?;
            let style = text(8, INK, HPos::Center, VPos::Top);
            area.draw_text(&degrees.to_string(), &style, (at, bottom + 8))?;
        }
        let steps = ((plot.high - plot.low) / plot.step) as i32;
        for step in 0..=steps {
            let value = plot.low + f64::from(step) * plot.step;
            let line = vec![(left, y(value)), (left + width, y(value))];
            area.draw(&PathElement::new(line, HAIR))?;
            let style = text(8, INK, HPos::Right, VPos::Center);
            area.draw_text(
                &format!("{value:.*}", plot.digits),
                &style,
                (left - 8, y(value)),
            )?;
        }
        let frame = [(left, TOP), (left + width, bottom)];
        area.draw(&Rectangle::new(frame, INK.stroke_width(1)))?;
        let style = text(9, INK, HPos::Left, VPos::Bottom);
        area.draw_text(plot.title, &style, (left - 40, TOP - 10))?;
        let style = text(9, INK, HPos::Center, VPos::Top);
        let middle = (left + width / 2, bottom + 34);
        area.draw_text(
            "lamp's angle off the camera's axis (degrees)",
            &style,
            middle,
        )?;

        let mut ends = Vec::new();
        for curve in &plot.curves {
            let color = row_color(&curve.label);
            let points: Vec<(i32, i32)> = curve
                .points
                .iter()
                .map(|(degrees, value)| (x(*degrees), y(*value)))
                .collect();
            if curve.noisy {
                dashed(area, &points, color)?;
            } else {
                area.draw(&PathElement::new(points.clone(), color.stroke_width(2)))?;
            }
            for point in &points {
                let dot = if curve.noisy {
                    color.stroke_width(1)
                } else {
                    color.filled()
                };
                area.draw(&Circle::new(*point, 3, dot))?;
            }
            if let Some(end) = points.last().filter(|_| !curve.noisy) {
                ends.push((end.1, curve.label.as_str()));
            }
        }
        // Labels beside the last points, moved up where curves end close to each other.
        ends.sort_unstable();
        let mut free = bottom - 8;
        for (end, label) in ends.into_iter().rev() {
            let at = end.min(free);
            let style = text(8, row_color(label), HPos::Left, VPos::Center);
            area.draw_text(label, &style, (left + width + 6, at))?;
            free = at - 16;
        }
        Ok(())
    }

    fn legend<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let mut y = TOP;
        let left = |color| text(8, color, HPos::Left, VPos::Center);
        for row in &self.report.rows {
            let answered = self.plots[0]
                .curves
                .iter()
                .any(|curve| curve.label == row.label);
            let name = format!("{} {}", row.label, row.name);
            if answered {
                let line = vec![(LEGEND, y), (LEGEND + 22, y)];
                let color = row_color(&row.label);
                area.draw(&PathElement::new(line, color.stroke_width(3)))?;
                area.draw_text(&name, &left(INK), (LEGEND + 30, y))?;
            } else {
                area.draw_text(&name, &left(FAINT), (LEGEND + 30, y))?;
                let style = text(7, FAINT, HPos::Left, VPos::Center);
                area.draw_text("no relit pictures", &style, (LEGEND + 30, y + 17))?;
                y += 16;
            }
            y += 26;
        }
        y += 8;
        for mark in MARKS {
            let style = text(7, FAINT, HPos::Left, VPos::Center);
            area.draw_text(mark, &style, (LEGEND, y))?;
            y += 18;
        }
        Ok(())
    }
}

impl Chart for AngleCurves<'_> {
    fn size(&self) -> (u32, u32) {
        let legend = 42 * self.report.rows.len() as i32 + 18 * MARKS.len() as i32 + 20;
        (WIDTH as u32, (TOP + legend.max(PLOT.1 + 80)) as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let title = "Error against the lamp's angle (PSNR: higher is better; MSE: lower is better)";
        heading(area, title, 13, (30, 14))?;
        let captures = named(&self.report.capture_names());
        area.draw_text(&captures, &text(8, FAINT, HPos::Left, VPos::Top), (30, 46))?;
        for (left, plot) in LEFTS.into_iter().zip(&self.plots) {
            self.plot(area, left, plot)?;
        }
        self.legend(area)
    }
}

/// The curves of all rows, clean before noisy; a row without answers has none.
fn curves(report: &Report, quantity: Quantity, times: f64) -> Vec<Curve> {
    let noisy = report.noisy.as_ref().map(|noisy| noisy.captures.as_slice());
    let depths: [(bool, &[CaptureReport]); 2] =
        [(false, &report.captures), (true, noisy.unwrap_or_default())];
    let mut found = Vec::new();
    for (noisy, captures) in depths {
        for row in &report.rows {
            let bands = by_angle(&lights_of(captures, &row.label), quantity);
            if !bands.is_empty() {
                found.push(Curve {
                    label: row.label.clone(),
                    noisy,
                    points: bands
                        .into_iter()
                        .filter(|(degrees, ..)| *degrees < 90.0)
                        .map(|(degrees, mean, _)| (degrees, times * mean))
                        .collect(),
                });
            }
        }
    }
    found
}

/// A step of 1, 2 or 5 times a power of ten that divides so much into at most eight.
fn nice_step(range: f64) -> f64 {
    let decade = 10f64.powf((range.max(1e-3) / 8.0).log10().floor());
    let fits = |factor: &&f64| range / (**factor * decade) <= 8.0;
    decade * [1.0, 2.0, 5.0].iter().find(fits).copied().unwrap_or(10.0)
}

/// A line of dashes, nine pixels on and six off.
fn dashed<B: DrawingBackend>(area: &Canvas<B>, points: &[(i32, i32)], color: RGBColor) -> Drawn<B> {
    const PERIOD: f64 = 15.0;
    const DASH: f64 = 9.0;
    let mut walked = 0.0;
    for pair in points.windows(2) {
        let [from, to] = [pair[0], pair[1]].map(|(x, y)| (f64::from(x), f64::from(y)));
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let at = |distance: f64| {
            let share = (distance / length.max(1e-9)).clamp(0.0, 1.0);
            (
                (from.0 + share * (to.0 - from.0)).round() as i32,
                (from.1 + share * (to.1 - from.1)).round() as i32,
            )
        };
        let mut start = -(walked % PERIOD);
        while start < length {
            let (begin, end) = (start.max(0.0), (start + DASH).min(length));
            if end > begin {
                let dash = vec![at(begin), at(end)];
                area.draw(&PathElement::new(dash, color.stroke_width(2)))?;
            }
            start += PERIOD;
        }
        walked += length;
    }
    Ok(())
}
