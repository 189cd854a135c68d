//! Sets of lights for environments: milliseconds against the change of the picture.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use crate::eval::light_sets::{COUNTS, LightSetRun, SetFigures};
use plotters::prelude::*;

const SIZE: (u32, u32) = (1060, 640);
const PLOT: [(i32, i32); 2] = [(90, 110), (680, 560)];
/// Changes below this, in steps of 255, are drawn there.
const LEAST_STEPS: f64 = 0.05;

/// Values that may stand beside an axis.
const TICKS: [f64; 14] = [
    0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0,
];

/// All runs; at least one.
pub(super) struct LightSets<'a>(pub &'a [LightSetRun]);

/// A median and the run between which nine of ten lie.
struct Spread([f64; 3]);

impl Spread {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
        Self([at(0.05), at(0.5), at(0.95)])
    }
}

/// One set of lights over all runs.
struct Point {
    name: String,
    milliseconds: Spread,
    steps: Spread,
    color: RGBColor,
}

/// A logarithmic axis: the decades it shows and the pixels it takes.
struct Axis {
    decades: (f64, f64),
    pixels: (i32, i32),
}

impl Axis {
    /// Thirds of a decade around all values, and room for the names.
    fn around(values: impl Iterator<Item = f64>, pixels: (i32, i32)) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        let third = |value: f64, round: fn(f64) -> f64| round(value.log10() * 3.0) / 3.0;
        let decades = (third(low, f64::floor) - 0.1, third(high, f64::ceil) + 0.2);
        Self { decades, pixels }
    }

    fn at(&self, value: f64) -> i32 {
        let ((low, high), (from, to)) = (self.decades, self.pixels);
        from + ((value.log10() - low) / (high - low) * f64::from(to - from)).round() as i32
    }

    fn shows(&self, value: f64) -> bool {
        (self.decades.0..self.decades.1).contains(&value.log10())
    }
}

impl LightSets<'_> {
    fn points(&self) -> Vec<Point> {
        let point = |set: Option<usize>| {
            let of = |figure: fn(&SetFigures) -> f64| {
                let figures =
                    |run: &LightSetRun| figure(set.map_or(&run.chosen, |set| &run.fixed[set]));
                Spread::of(self.0.iter().map(figures))
            };
            Point {
                name: set.map_or("chosen".to_owned(), |set| COUNTS[set].to_string()),
                milliseconds: of(|set| set.milliseconds),
                steps: of(|set| set.change_steps.max(LEAST_STEPS)),
                color: row_color(if set.is_some() { "3" } else { "4" }),
            }
        };
        (0..COUNTS.len())
            .map(Some)
            .chain([None])
            .map(point)
            .collect()
    }

    fn plot<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let [(left, top), (right, bottom)] = PLOT;
        let line = |from, to, style: ShapeStyle| PathElement::new(vec![from, to], style);
        let points = self.points();
        let x = Axis::around(
            points.iter().flat_map(|point| point.milliseconds.0),
            (left, right),
        );
        let y = Axis::around(points.iter().flat_map(|point| point.steps.0), (bottom, top));
        for tick in TICKS {
            if x.shows(tick) {
                let at = x.at(tick);
                area.draw(&line((at, top), (at, bottom), HAIR.stroke_width(1)))?;
                let style = text(8, INK, HPos::Center, VPos::Top);
                area.draw_text(&tick.to_string(), &style, (at, bottom + 8))?;
            }
            if y.shows(tick) {
                let at = y.at(tick);
                area.draw(&line((left, at), (right, at), HAIR.stroke_width(1)))?;
                let style = text(8, INK, HPos::Right, VPos::Center);
                area.draw_text(&tick.to_string(), &style, (left - 8, at))?;
            }
        }
        area.draw(&Rectangle::new(PLOT, INK.stroke_width(1)))?;
        area.draw_text(
            "milliseconds: shadows, choice and picture (log scale)",
            &text(9, INK, HPos::Center, VPos::Top),
            ((left + right) / 2, bottom + 34),
        )?;
        area.draw_text(
            "change of the picture, steps of 255 in sRGB (log scale)",
            &text(9, INK, HPos::Left, VPos::Bottom),
            (left - 60, top - 10),
        )?;
        let Spread([_, noise, _]) = Spread::of(self.0.iter().map(LightSetRun::noise_steps));
        if y.shows(noise) {
            let at = y.at(noise);
            area.draw(&line((left, at), (right, at), FAINT.stroke_width(2)))?;
        }
        for point in &points {
            let Spread([fast, ms, slow]) = point.milliseconds;
            let Spread([low, change, high]) = point.steps;
            let (at, level) = (x.at(ms), y.at(change));
            let pen = point.color.stroke_width(2);
            area.draw(&line((x.at(fast), level), (x.at(slow), level), pen))?;
            area.draw(&line((at, y.at(low)), (at, y.at(high)), pen))?;
            area.draw(&Circle::new((at, level), 8, point.color.filled()))?;
            let style = text(9, INK, HPos::Left, VPos::Bottom);
            area.draw_text(&point.name, &style, (at + 10, level - 4))?;
        }
        Ok(())
    }

    fn legend<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let Spread([fewest, lights, most]) =
            Spread::of(self.0.iter().map(|run| run.chosen.lights as f64));
        let (x, top) = (PLOT[1].0 + 30, PLOT[0].1);
        area.draw(&Circle::new((x, top + 10), 8, row_color("4").filled()))?;
        area.draw(&Circle::new((x, top + 66), 8, row_color("3").filled()))?;
        let dash = vec![(x - 8, top + 122), (x + 8, top + 122)];
        area.draw(&PathElement::new(dash, FAINT.stroke_width(2)))?;
        for (words, down) in [
            ("chosen for the scene:".to_owned(), 10),
            (format!("{lights} lights ({fewest} to {most})"), 30),
            ("a fixed count, by the map alone".to_owned(), 66),
            ("256: one light per cell".to_owned(), 86),
            ("noise of the picture (median)".to_owned(), 122),
            (format!("changes below {LEAST_STEPS} are drawn there"), 158),
        ] {
            let style = text(8, INK, HPos::Left, VPos::Center);
            area.draw_text(&words, &style, (x + 20, top + down))?;
        }
        Ok(())
    }
}

impl Chart for LightSets<'_> {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(
            area,
            "Lights for an environment: time against change",
            13,
            (30, 14),
        )?;
        let about = format!(
            "{} scenes under a map; dot: median, cross: 5 to 95 % of them",
            self.0.len()
        );
        area.draw_text(&about, &text(8, FAINT, HPos::Left, VPos::Top), (30, 48))?;
        self.plot(area)?;
        self.legend(area)
    }
}
