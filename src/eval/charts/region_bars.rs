//! Error by region: one block per kind of place, one bar per row.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text};
use crate::eval::region_means::{RegionMeans, region_means};
use crate::eval::regions::Region;
use crate::eval::report::Report;
use plotters::prelude::*;

const WIDTH: i32 = 900;
const TOP: i32 = 96;
/// Left end of the bars, which begin at 0 dB.
const BARS: i32 = 300;
const LONGEST: i32 = 520;
const LINE: i32 = 22;
/// Height of a block's heading and the gap below it.
const HEAD: i32 = 44;

/// All regions of one report.
pub(super) struct RegionBars {
    rows: Vec<RegionMeans>,
    /// dB at the end of the longest bar.
    most: f64,
}

impl RegionBars {
    pub(super) fn new(report: &Report) -> Self {
        let rows = region_means(report);
        let shown = rows
            .iter()
            .flat_map(|row| row.clean.iter().chain(&row.noisy));
        let most = shown.flatten().copied().fold(10.0, f64::max);
        Self {
            most: (most / 5.0).ceil() * 5.0,
            rows,
        }
    }

    fn x(&self, decibel: f64) -> i32 {
        BARS + (decibel.max(0.0) / self.most * f64::from(LONGEST)).round() as i32
    }

    fn block<B: DrawingBackend>(&self, area: &Canvas<B>, top: i32, place: usize) -> Drawn<B> {
        let region = Region::ALL[place];
        let style = text(9, INK, HPos::Left, VPos::Center);
        area.draw_text(region.name(), &style, (30, top + 10))?;
        let style = text(7, FAINT, HPos::Left, VPos::Center);
        area.draw_text(region.meaning(), &style, (BARS, top + 10))?;
        let first = top + 32;
        let bottom = first + LINE * self.rows.len() as i32;
        for step in 0..=(self.most / 5.0) as i32 {
            let at = self.x(5.0 * f64::from(step));
            let line = vec![(at, first - 8), (at, bottom - 12)];
            area.draw(&PathElement::new(line, HAIR))?;
            let style = text(6, FAINT, HPos::Center, VPos::Top);
            area.draw_text(&(5 * step).to_string(), &style, (at, bottom - 10))?;
        }
        for (line, row) in self.rows.iter().enumerate() {
            let y = first + LINE * line as i32;
            let color = row_color(&row.label);
            let style = text(7, INK, HPos::Right, VPos::Center);
            let name: String = row.name.chars().take(33).collect();
            area.draw_text(&format!("{} {name}", row.label), &style, (BARS - 8, y))?;
            let (clean, noisy) = (row.clean[place], row.noisy[place]);
            if let Some(decibel) = clean {
                let bar = [(BARS, y - 7), (self.x(decibel), y + 7)];
                area.draw(&Rectangle::new(bar, color.filled()))?;
            }
            if let Some(decibel) = noisy {
                let middle = (self.x(decibel), y);
                area.draw(&Circle::new(middle, 5, WHITE.filled()))?;
                area.draw(&Circle::new(middle, 5, color.stroke_width(2)))?;
            }
            let values = match (clean, noisy) {
                (None, None) => "nowhere".to_owned(),
                (Some(clean), None) => format!("{clean:.1}"),
                (None, Some(noisy)) => format!("– / {noisy:.1}"),
                (Some(clean), Some(noisy)) => format!("{clean:.1} / {noisy:.1}"),
            };
            let end = clean.into_iter().chain(noisy).fold(0.0, f64::max);
            let style = text(7, INK, HPos::Left, VPos::Center);
            area.draw_text(&values, &style, (self.x(end) + 10, y))?;
        }
        Ok(())
    }

    fn block_height(&self) -> i32 {
        HEAD + LINE * self.rows.len() as i32 + 16
    }
}

impl Chart for RegionBars {
    fn size(&self) -> (u32, u32) {
        let blocks = Region::ALL.len() as i32;
        (
            WIDTH as u32,
            (TOP + blocks * self.block_height() + 10) as u32,
        )
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(
            area,
            "Error by region of the picture (longer is better)",
            11,
            (30, 14),
        )?;
        let lines = [
            "PSNR of relit light inside the region, dB, linear light; error pooled over lights, mean over captures",
            "bar: clean depth; ring and second number: noisy depth, where it was measured",
        ];
        for (line, words) in lines.iter().enumerate() {
            let style = text(7, FAINT, HPos::Left, VPos::Top);
            area.draw_text(words, &style, (30, 42 + 18 * line as i32))?;
        }
        for place in 0..Region::ALL.len() {
            self.block(area, TOP + place as i32 * self.block_height(), place)?;
        }
        Ok(())
    }
}
