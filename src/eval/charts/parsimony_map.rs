//! Parsimony: terms used per capture against accuracy lost and time saved.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, text, viridis};
use crate::eval::savings::{MOST_TERMS, Saving, Savings, TERMS};
use plotters::prelude::*;

const WIDTH: i32 = 1010;
const HEIGHT: i32 = 640;
const PLOT: [(i32, i32); 2] = [(80, 104), (580, 560)];
/// Left edge of what stands beside the plot, and of the bars there.
const SIDE: i32 = 640;
const BARS: i32 = 740;
const LONGEST: i32 = 230;
/// What is aimed at: at least so much time saved, percent, at no more than so many dB lost.
const GOAL: (f64, f64) = (50.0, 0.1);
/// Captures whose names stand beside their dots.
const NAMED: usize = 6;

/// Auto against everything.
pub(super) struct ParsimonyMap {
    savings: Savings,
}

impl ParsimonyMap {
    pub(super) fn new(savings: Savings) -> Self {
        Self { savings }
    }

    /// Bounds of the plot: percent of the time saved, dB lost.
    fn ranges(&self) -> ((f64, f64), (f64, f64)) {
        let shown = &self.savings.captures;
        let least =
            |value: fn(&Saving) -> f64, start: f64| shown.iter().map(value).fold(start, f64::min);
        let most =
            |value: fn(&Saving) -> f64, start: f64| shown.iter().map(value).fold(start, f64::max);
        let saved = (least(|one| one.saved_percent, 0.0) / 20.0).floor() * 20.0;
        // A capture that took many times as long must not squeeze the others.
        let saved = saved.max(-100.0);
        let lost = |value: f64, up: bool| {
            let steps = value / 0.2;
            0.2 * if up { steps.ceil() } else { steps.floor() }
        };
        (
            (saved, 100.0),
            (
                lost(least(|one| one.lost_db, -0.1), false),
                lost(most(|one| one.lost_db, 0.3), true),
            ),
        )
    }

    fn plot<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let [(left, top), (right, bottom)] = PLOT;
        let ((least, most), (low, high)) = self.ranges();
        let x = |percent: f64| {
            let share = (percent.clamp(least, most) - least) / (most - least);
            left + (share * f64::from(right - left)).round() as i32
        };
        let y = |lost: f64| {
            let share = (lost - low) / (high - low);
            top + (share * f64::from(bottom - top)).round() as i32
        };
        let goal = [(x(GOAL.0), top), (right, y(GOAL.1))];
        area.draw(&Rectangle::new(goal, RGBColor(0xe3, 0xf2, 0xe8).filled()))?;
        let style = text(7, RGBColor(0x1b, 0x6b, 0x45), HPos::Right, VPos::Bottom);
        let aim = format!("aim: ≥ {} % saved, ≤ {} dB lost", GOAL.0, GOAL.1);
        area.draw_text(&aim, &style, (right, top - 10))?;
        let style = |horizontal, vertical| text(7, INK, horizontal, vertical);
        for step in 0..=((most - least) / 20.0).round() as i32 {
            let percent = least + 20.0 * f64::from(step);
            let at = x(percent);
            area.draw(&PathElement::new(vec![(at, top), (at, bottom)], HAIR))?;
            let label = format!("{percent:.0}");
            area.draw_text(&label, &style(HPos::Center, VPos::Top), (at, bottom + 8))?;
        }
        let spacing = if high - low > 2.0 { 0.5 } else { 0.2 };
        let first = (low / spacing).ceil() as i32;
        for step in first..=(high / spacing).floor() as i32 {
            let lost = spacing * f64::from(step);
            let at = y(lost);
            area.draw(&PathElement::new(vec![(left, at), (right, at)], HAIR))?;
            let label = format!("{lost:.1}");
            area.draw_text(&label, &style(HPos::Right, VPos::Center), (left - 8, at))?;
        }
        area.draw(&Rectangle::new(PLOT, INK.stroke_width(1)))?;
        let words = "time saved against every term, % (right is better)";
        let middle = ((left + right) / 2, bottom + 32);
        area.draw_text(words, &style(HPos::Center, VPos::Top), middle)?;
        let words = "dB lost against every term (up is better)";
        area.draw_text(
            words,
            &style(HPos::Left, VPos::Bottom),
            (left - 50, top - 10),
        )?;
        for saving in &self.savings.captures {
            let at = (x(saving.saved_percent), y(saving.lost_db));
            area.draw(&Circle::new(at, 7, color(saving.terms()).filled()))?;
            area.draw(&Circle::new(at, 7, INK.stroke_width(1)))?;
            if self.savings.captures.len() <= NAMED {
                let style = text(7, INK, HPos::Left, VPos::Bottom);
                area.draw_text(&saving.capture, &style, (at.0 + 9, at.1 - 3))?;
            }
        }
        if let Some((saved, lost)) = self.savings.mean {
            let (at_x, at_y) = (x(saved), y(lost));
            for (color, width) in [(WHITE, 7), (INK, 3)] {
                for line in [
                    vec![(at_x - 14, at_y), (at_x + 14, at_y)],
                    vec![(at_x, at_y - 14), (at_x, at_y + 14)],
                ] {
                    area.draw(&PathElement::new(line, color.stroke_width(width)))?;
                }
            }
        }
        Ok(())
    }

    /// Which level of each term was chosen, over all captures.
    fn levels<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let style = |color| text(7, color, HPos::Left, VPos::Center);
        let mut y = PLOT[0].1;
        let all = self.savings.captures.len();
        area.draw_text(
            "terms used, share of the captures",
            &text(8, INK, HPos::Left, VPos::Center),
            (SIDE, y),
        )?;
        y += 30;
        for (term, (name, levels)) in TERMS.iter().enumerate() {
            area.draw_text(name, &style(INK), (SIDE, y))?;
            for (level, words) in levels.iter().enumerate() {
                let of_level = |saving: &&Saving| usize::from(saving.levels[term]) == level;
                let number = self.savings.captures.iter().filter(of_level).count();
                let share = number as f64 / all.max(1) as f64;
                let end = BARS + (share * f64::from(LONGEST)).round() as i32;
                let bar = [(BARS, y - 7), (end, y + 7)];
                area.draw(&Rectangle::new(bar, color(4 * level).filled()))?;
                let frame = [(BARS, y - 7), (BARS + LONGEST, y + 7)];
                area.draw(&Rectangle::new(frame, HAIR.stroke_width(1)))?;
                let note = format!("{words}: {:.0} %", 100.0 * share);
                area.draw_text(&note, &style(INK), (BARS, y + 15))?;
                y += 32;
            }
            y += 8;
        }
        y += 4;
        area.draw_text("color of a dot: terms used", &style(INK), (SIDE, y))?;
        for terms in 0..=MOST_TERMS {
            let middle = (SIDE + 8 + 26 * terms as i32, y + 22);
            area.draw(&Circle::new(middle, 7, color(terms).filled()))?;
            let label = text(6, INK, HPos::Center, VPos::Top);
            area.draw_text(&terms.to_string(), &label, (middle.0, middle.1 + 10))?;
        }
        Ok(())
    }
}

impl Chart for ParsimonyMap {
    fn size(&self) -> (u32, u32) {
        let empty = self.savings.captures.is_empty();
        (WIDTH as u32, if empty { 90 } else { HEIGHT as u32 })
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let title = "Parsimony: what leaving terms out saves and costs, capture by capture";
        heading(area, title, 11, (30, 14))?;
        let faint = |at, words: &str| {
            let style = text(7, FAINT, HPos::Left, VPos::Top);
            area.draw_text(words, &style, at)
        };
        if self.savings.captures.is_empty() {
            return faint((30, 48), &self.savings.missing);
        }
        for (line, words) in self.savings.words.split("; ").enumerate() {
            faint((30, 42 + 16 * line as i32), words)?;
        }
        self.plot(area)?;
        self.levels(area)
    }
}

/// Few terms are violet, all are yellow.
fn color(terms: usize) -> RGBColor {
    viridis(terms as f64 / MOST_TERMS as f64)
}
