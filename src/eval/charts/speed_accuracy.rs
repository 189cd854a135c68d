//! Speed against accuracy: milliseconds per relit picture against PSNR, one point per row.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use crate::eval::beside::OtherBackend;
use crate::eval::report::Report;
use crate::eval::summary::{RowFigures, RowSummary};
use plotters::prelude::*;

const WIDTH: i32 = 1240;
/// At least; more rows make it higher.
const HEIGHT: i32 = 640;
/// Below the plot: its axis.
const FOOT: i32 = 80;
/// A label's letters and lines, pixels.
const LETTER: (i32, i32) = (8, 16);
/// Radius of a dot without parameters, pixels.
const LEAST_RADIUS: f64 = 6.0;
/// Parameters that make a dot twice as large.
const TWICE: f64 = 6e6;
/// Height of a row's two lines in the legend.
const ENTRY: i32 = 46;
/// Lines of the legend below the rows.
const MARKS: [&str; 6] = [
    "dot: mean over lights and captures; full: clean",
    "depth, hollow: noisy depth; its area beyond the",
    "smallest: parameters of its networks (one of",
    "6 million has twice the smallest's)",
    "whisker: down to the worst direction of the light",
    "grey line: Pareto front of clean depth",
];
/// Upper left corner and right side of the plot; it is as high as the legend.
const PLOT: ((i32, i32), i32) = ((90, 110), 740);

/// All rows of one report.
pub(super) struct SpeedAccuracy<'a> {
    report: &'a Report,
    points: Vec<Point>,
}

#[derive(Clone)]
struct Point {
    label: String,
    noisy: bool,
    milliseconds: f64,
    mean_db: f64,
    worst_db: f64,
    /// Of all its networks.
    parameters: u64,
    /// What is written beside it.
    words: String,
}

impl Point {
    /// Its area grows with its parameters.
    fn radius(&self) -> i32 {
        let area = 1.0 + self.parameters as f64 / TWICE;
        (LEAST_RADIUS * area.sqrt()).round() as i32
    }
}

impl<'a> SpeedAccuracy<'a> {
    pub(super) fn new(report: &'a Report) -> Self {
        let clean = report.rows.iter();
        let clean = clean.filter_map(|row| point(row, Some(&row.figures), false));
        let noisy = report.rows.iter();
        let noisy = noisy.filter_map(|row| point(row, row.noisy.as_ref(), true));
        let others = report.other_backends.iter().filter_map(other_point);
        let points = clean.chain(noisy).chain(others).collect();
        Self { report, points }
    }

    /// Points of clean depth that no other beats in both speed and accuracy, fastest first.
    fn pareto_front(&self) -> Vec<Point> {
        let mut points = self.points.clone();
        points.retain(|point| !point.noisy);
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
        // A label stands right of its dot.
        let decades = (
            fastest.floor() as i32,
            ((slowest + 0.25).ceil() as i32).max(fastest.floor() as i32 + 1),
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
        let ((left, top), right) = PLOT;
        let bottom = self.size().1 as i32 - FOOT;
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
        area.draw(&Rectangle::new(
            [(left, top), (right, bottom)],
            INK.stroke_width(1),
        ))?;
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

        let places: Vec<Place> = (self.points.iter())
            .map(|point| {
                let centre = (x(point.milliseconds), y(point.mean_db));
                let radius = point.radius();
                let words = LETTER.0 * point.words.chars().count() as i32;
                Place {
                    centre,
                    radius,
                    words,
                }
            })
            .collect();
        let labels = labels(&places, [(left, top), (right, bottom)]);
        for point in &self.points {
            let color = row_color(&point.label);
            let (at, mean, worst) = (x(point.milliseconds), y(point.mean_db), y(point.worst_db));
            area.draw(&PathElement::new(
                vec![(at, mean), (at, worst)],
                color.stroke_width(2),
            ))?;
            area.draw(&PathElement::new(
                vec![(at - 7, worst), (at + 7, worst)],
                color.stroke_width(2),
            ))?;
            let radius = point.radius();
            if point.noisy {
                area.draw(&Circle::new((at, mean), radius, WHITE.filled()))?;
                area.draw(&Circle::new((at, mean), radius, color.stroke_width(3)))?;
            } else {
                area.draw(&Circle::new((at, mean), radius, color.filled()))?;
            }
        }
        for (point, place) in self.points.iter().zip(labels) {
            let style = text(9, INK, HPos::Left, VPos::Top);
            area.draw_text(&point.words, &style, place)?;
        }
        Ok(())
    }

    fn legend<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let x = PLOT.1 + 40;
        let mut y = PLOT.0.1;
        let left = |size, color| text(size, color, HPos::Left, VPos::Center);
        for summary in &self.report.rows {
            let drawn = self.points.iter().any(|point| point.label == summary.label);
            let (circle, ink) = if drawn {
                (row_color(&summary.label).filled(), INK)
            } else {
                (FAINT.stroke_width(1), FAINT)
            };
            area.draw(&Circle::new((x, y), 8, circle))?;
            let name = format!("{} {}", summary.label, summary.name);
            area.draw_text(&name, &left(8, ink), (x + 20, y))?;
            area.draw_text(&detail(summary), &left(7, ink), (x + 20, y + 18))?;
            y += ENTRY;
        }
        y += 6;
        for mark in MARKS {
            area.draw_text(mark, &left(7, FAINT), (x - 8, y))?;
            y += 20;
        }
        Ok(())
    }
}

impl Chart for SpeedAccuracy<'_> {
    fn size(&self) -> (u32, u32) {
        let legend = ENTRY * self.report.rows.len() as i32 + 20 * MARKS.len() as i32 + 20;
        (WIDTH as u32, HEIGHT.max(PLOT.0.1 + legend) as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let title = "Speed against accuracy of relighting (up and left is better)";
        heading(area, title, 13, (30, 14))?;
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

/// A dot and the width of what is written beside it, pixels.
struct Place {
    centre: (i32, i32),
    radius: i32,
    words: i32,
}

/// Upper left corners of the labels: each as near to its dot as it stands clear of every dot, of the labels before it
/// and of the plot's frame.
fn labels(places: &[Place], [(left, top), (right, bottom)]: [(i32, i32); 2]) -> Vec<(i32, i32)> {
    let mut taken: Vec<[i32; 4]> = places
        .iter()
        .map(
            |Place {
                 centre: (x, y),
                 radius,
                 ..
             }| [x - radius, y - radius, x + radius, y + radius],
        )
        .collect();
    let mut found = Vec::with_capacity(places.len());
    for Place {
        centre: (x, y),
        radius,
        words,
    } in places
    {
        let beside = [x + radius + 3, x - radius - 3 - words, x - words / 2];
        let rows = (1..60)
            .flat_map(|step| [1 - step, step])
            .map(|step| y - LETTER.1 / 2 + 6 * step);
        let mut corners = rows.flat_map(|row| beside.map(|column| (column, row)));
        let clear = |&(x, y): &(i32, i32)| {
            let [ends_x, ends_y] = [x + words, y + LETTER.1];
            let inside = x > left && ends_x < right && y > top && ends_y < bottom;
            let apart =
                |[a, b, c, d]: &[i32; 4]| x >= *c || ends_x <= *a || y >= *d || ends_y <= *b;
            inside && taken.iter().all(apart)
        };
        let corner = corners.find(clear).unwrap_or((beside[0], *y));
        taken.push([corner.0, corner.1, corner.0 + words, corner.1 + LETTER.1]);
        found.push(corner);
    }
    found
}

/// Up to four names, or how many there are.
pub(super) fn named(names: &[&str]) -> String {
    if names.len() <= 4 {
        names.join(", ")
    } else {
        format!("{} captures", names.len())
    }
}

/// A row's figures in words.
fn detail(summary: &RowSummary) -> String {
    let figures = match &summary.figures {
        RowFigures::Missing { reason } => return format!("missing: {reason}"),
        RowFigures::Present(figures) => figures,
    };
    let (Some(mean), Some(worst)) = (figures.mean, figures.worst_linear_psnr_db) else {
        return "relights nothing".to_owned();
    };
    let time = figures
        .relight_ms
        .map_or("time unknown".to_owned(), |time| format!("{time:.2} ms"));
    let mean = mean.linear_psnr_db;
    let networks = match (&summary.backend, summary.parameters) {
        (Some(_), Some(parameters)) => format!(", {:.1} M param.", parameters as f64 / 1e6),
        _ => String::new(),
    };
    format!("{time}, {mean} dB, worst light {worst} dB{networks}")
}

fn point(summary: &RowSummary, figures: Option<&RowFigures>, noisy: bool) -> Option<Point> {
    let figures = figures?.present()?;
    let point = Point {
        label: summary.label.clone(),
        noisy,
        milliseconds: figures.relight_ms?,
        mean_db: figures.mean?.linear_psnr_db.0,
        worst_db: figures.worst_direction?.linear_psnr_db.0,
        parameters: summary.parameters.unwrap_or(0),
        words: summary.label.clone(),
    };
    drawable(point)
}

/// A row as another backend ran it.
fn other_point(other: &OtherBackend) -> Option<Point> {
    let name = other.backend.split(&[',', ':', '(']).next();
    drawable(Point {
        label: other.label.clone(),
        noisy: false,
        milliseconds: other.relight_ms,
        mean_db: other.mean_db.0,
        worst_db: other.worst_db.0,
        parameters: other.parameters,
        words: format!("{} {}", other.label, name.unwrap_or_default().trim()),
    })
}

fn drawable(point: Point) -> Option<Point> {
    let Point {
        milliseconds,
        mean_db,
        worst_db,
        ..
    } = point;
    (milliseconds > 0.0 && mean_db.is_finite() && worst_db.is_finite()).then_some(point)
}
