//! Speed against accuracy: milliseconds per relit picture against PSNR, one point per row.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use crate::eval::report::{Report, RowFigures, RowSummary};
use plotters::prelude::*;

const WIDTH: i32 = 1180;
const HEIGHT: i32 = 640;
const PLOT: [(i32, i32); 2] = [(90, 110), (700, 560)];

/// All rows of one report.
pub(super) struct SpeedAccuracy<'a> {
    report: &'a Report,
    points: Vec<Point>,
}

#[derive(Clone, Copy)]
struct Point {
    row: u8,
    milliseconds: f64,
    mean_db: f64,
    worst_db: f64,
}

impl<'a> SpeedAccuracy<'a> {
    pub(super) fn new(report: &'a Report) -> Self {
        let points = report.rows.iter().filter_map(point).collect();
        Self { report, points }
    }

    /// Points that no other beats in both speed and accuracy, fastest first.
    fn pareto_front(&self) -> Vec<Point> {
        let mut points = self.points.clone();
        points.sort_unstable_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
        let mut best = f64::NEG_INFINITY;
        points.retain(|point| {
            let better = point.mean_db > best;
            best = best.max(point.mean_db);
            better
        });
        points
    }

    /// Whole decades of milliseconds and whole steps of decibel around all points.
    fn ranges(&self) -> ((i32, i32), (f64, f64)) {
        let bounds = |value: fn(&Point) -> f64| {
            self.points
                .iter()
                .map(value)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                    (low.min(value), high.max(value))
                })
        };
        let (fastest, slowest) = bounds(|point| point.milliseconds.log10());
        let (lowest, _) = bounds(|point| point.worst_db);
        let (_, highest) = bounds(|point| point.mean_db);
        if self.points.is_empty() {
            return ((-1, 2), (0.0, 40.0));
        }
        let decades = (
            fastest.floor() as i32,
            (slowest.ceil() as i32).max(fastest.floor() as i32 + 1),
        );
        (
            (decades.0, decades.1),
            (
                (lowest / 5.0).floor() * 5.0,
                (highest / 5.0).ceil() * 5.0 + 1.0,
            ),
        )
    }

    fn plot<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let [(left, top), (right, bottom)] = PLOT;
        let ((first, last), (low, high)) = self.ranges();
        let x = |milliseconds: f64| {
            let share = (milliseconds.log10() - f64::from(first)) / f64::from(last - first);
            left + (share * f64::from(right - left)).round() as i32
        };
        let y = |decibel: f64| {
            bottom - ((decibel - low) / (high - low) * f64::from(bottom - top)).round() as i32
        };
        for decade in first..=last {
            let at = x(10_f64.powi(decade));
            area.draw(&PathElement::new(vec![(at, top), (at, bottom)], HAIR))?;
            let label = format!("{}", 10_f64.powi(decade));
            area.draw_text(
                &label,
                &text(8, INK, HPos::Center, VPos::Top),
                (at, bottom + 8),
            )?;
        }
        let step = if high - low > 30.0 { 10 } else { 5 };
        for decibel in (low as i32..=high as i32).filter(|decibel| decibel % step == 0) {
            let at = y(f64::from(decibel));
            area.draw(&PathElement::new(vec![(left, at), (right, at)], HAIR))?;
            let style = text(8, INK, HPos::Right, VPos::Center);
            area.draw_text(&decibel.to_string(), &style, (left - 8, at))?;
        }
        area.draw(&Rectangle::new(PLOT, INK.stroke_width(1)))?;
        let middle = (left + right) / 2;
        let style = text(9, INK, HPos::Center, VPos::Top);
        area.draw_text(
            "milliseconds per relit picture (median, log scale)",
            &style,
            (middle, bottom + 34),
        )?;
        area.draw_text(
            "PSNR (dB, linear light)",
            &text(9, INK, HPos::Left, VPos::Bottom),
            (left - 60, top - 10),
        )?;

        let mut front = Vec::new();
        for point in self.pareto_front() {
            let level = front.last().map(|&(_, level)| level);
            front.extend(level.map(|level| (x(point.milliseconds), level)));
            front.push((x(point.milliseconds), y(point.mean_db)));
        }
        front.extend(front.last().map(|&(_, level)| (right, level)));
        area.draw(&PathElement::new(front, FAINT.stroke_width(2)))?;

        for point in &self.points {
            let color = row_color(point.row);
            let (at, mean, worst) = (x(point.milliseconds), y(point.mean_db), y(point.worst_db));
            area.draw(&PathElement::new(
                vec![(at, mean), (at, worst)],
                color.stroke_width(2),
            ))?;
            area.draw(&PathElement::new(
                vec![(at - 7, worst), (at + 7, worst)],
                color.stroke_width(2),
            ))?;
            area.draw(&Circle::new((at, mean), 9, color.filled()))?;
            // A number beside another dot would be read as that dot's: then it goes to the left.
            let crowded = self.points.iter().any(|other| {
                let gap = x(other.milliseconds) - at;
                other.row != point.row
                    && (0..40).contains(&gap)
                    && (y(other.mean_db) - mean).abs() < 30
            });
            let (side, offset) = if crowded {
                (HPos::Right, -12)
            } else {
                (HPos::Left, 12)
            };
            let label = text(9, INK, side, VPos::Bottom);
            area.draw_text(&point.row.to_string(), &label, (at + offset, mean - 4))?;
        }
        Ok(())
    }

    fn legend<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let x = PLOT[1].0 + 40;
        let mut y = PLOT[0].1;
        let left = |size, color| text(size, color, HPos::Left, VPos::Center);
        for summary in &self.report.rows {
            let (name, detail, ink) = match &summary.figures {
                RowFigures::Present {
                    mean,
                    worst_linear_psnr_db,
                    relight_ms,
                    ..
                } => {
                    area.draw(&Circle::new((x, y), 8, row_color(summary.row).filled()))?;
                    let time =
                        relight_ms.map_or("no time".to_owned(), |time| format!("{time:.2} ms"));
                    let detail = format!(
                        "{time}, mean {} dB, worst {worst_linear_psnr_db} dB",
                        mean.linear_psnr_db
                    );
                    (&summary.name, detail, INK)
                }
                RowFigures::Missing { reason } => {
                    area.draw(&Circle::new((x, y), 8, FAINT.stroke_width(1)))?;
                    (&summary.name, format!("missing: {reason}"), FAINT)
                }
            };
            area.draw_text(
                &format!("{} {name}", summary.row),
                &left(8, ink),
                (x + 20, y),
            )?;
            area.draw_text(&detail, &left(7, ink), (x + 20, y + 19))?;
            y += 48;
        }
        let marks = [
            "dot: mean over lights and captures",
            "whisker: down to the worst light of all",
            "grey line: Pareto front (nothing faster is better)",
        ];
        y += 6;
        for mark in marks {
            area.draw_text(mark, &left(7, FAINT), (x - 8, y))?;
            y += 20;
        }
        Ok(())
    }
}

impl Chart for SpeedAccuracy<'_> {
    fn size(&self) -> (u32, u32) {
        (WIDTH as u32, HEIGHT as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(area, "Speed against accuracy of relighting", 13, (30, 14))?;
        let machine = &self.report.machine;
        let names = self.report.capture_names();
        let build = if machine.release_build {
            "release build"
        } else {
            "development build"
        };
        let detail = format!(
            "{}; {}, {} threads, {build}",
            named(&names),
            machine.target,
            machine.threads
        );
        area.draw_text(&detail, &text(8, FAINT, HPos::Left, VPos::Top), (30, 48))?;
        self.plot(area)?;
        self.legend(area)
    }
}

/// Up to four names, or how many there are.
pub(super) fn named(names: &[&str]) -> String {
    if names.len() <= 4 {
        names.join(", ")
    } else {
        format!("{} captures", names.len())
    }
}

fn point(summary: &RowSummary) -> Option<Point> {
    let RowFigures::Present {
        mean,
        worst_linear_psnr_db,
        relight_ms,
        ..
    } = &summary.figures
    else {
        return None;
    };
    let point = Point {
        row: summary.row,
        milliseconds: (*relight_ms)?,
        mean_db: mean.linear_psnr_db.0,
        worst_db: worst_linear_psnr_db.0,
    };
    let drawable =
        point.milliseconds > 0.0 && point.mean_db.is_finite() && point.worst_db.is_finite();
    drawable.then_some(point)
}
