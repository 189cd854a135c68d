//! Error by light direction, all rows on one sheet: polar maps of PSNR and shadow IoU.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HPos, INK, VPos, heading, text};
use super::color_scales::{ColorScales, Lights, Map, depths};
use super::hemisphere::{WORST, closed, outline};
use crate::eval::directions::{Cell, Dome};
use crate::eval::report::Report;
use plotters::prelude::*;

const RIM: i32 = 84;
const TOP: i32 = 128;
/// From one row to the next, and from one map to the next.
const LINE: i32 = 232;
const COLUMN: i32 = 250;
/// Rows of the table side by side.
const ABREAST: usize = 2;
const LEFT: i32 = 30;
/// Maps drawn here: PSNR and shadow IoU.
const MAPS: usize = 2;

/// Clean depth of every row that relit something.
pub(super) struct PolarMaps<'a> {
    rows: Vec<(String, Lights<'a>)>,
    captures: usize,
    maps: &'a [Map],
}

impl<'a> PolarMaps<'a> {
    pub(super) fn new(report: &'a Report, scales: &'a ColorScales) -> Self {
        let rows = report.rows.iter().filter_map(|row| {
            let (_, lights) = depths(report, row)
                .into_iter()
                .find(|(depth, _)| *depth == "clean depth")?;
            Some((format!("{} {}", row.label, row.name), lights))
        });
        Self {
            rows: rows.collect(),
            captures: report.captures.len(),
            maps: &scales.0[..scales.0.len().min(MAPS)],
        }
    }

    fn map<B: DrawingBackend>(
        area: &Canvas<B>,
        middle: (i32, i32),
        lights: &Lights<'_>,
        map: &Map,
    ) -> Drawn<B> {
        let dome = Dome::for_lights(lights.len());
        let means = dome.means(lights, map.value);
        let mut worst: Option<(Cell, f64)> = None;
        for (cell, mean) in dome.cells().into_iter().zip(means) {
            let corners = outline(&cell, middle, RIM);
            if let Some((mean, _)) = mean {
                area.draw(&Polygon::new(corners.clone(), map.color(mean).filled()))?;
                if worst.is_none_or(|(_, lowest)| (mean > lowest) == map.low_is_good) {
                    worst = Some((cell, mean));
                }
            }
            area.draw(&PathElement::new(closed(&corners), FAINT))?;
        }
        let style = text(6, INK, HPos::Center, VPos::Top);
        let Some((cell, value)) = worst else {
            let below = (middle.0, middle.1 + RIM + 8);
            return area.draw_text("no light with an answer", &style, below);
        };
        let edge = PathElement::new(closed(&outline(&cell, middle, RIM)), WORST.stroke_width(3));
        area.draw(&edge)?;
        let [inner, outer] = cell.off_axis_degrees;
        let words = format!(
            "worst {}: {}, {inner:.0}–{outer:.0}°",
            map.shown(value),
            cell.place()
        );
        area.draw_text(&words, &style, (middle.0, middle.1 + RIM + 8))
    }

    fn scale<B: DrawingBackend>(area: &Canvas<B>, left: i32, map: &Map) -> Drawn<B> {
        let style = text(8, INK, HPos::Left, VPos::Bottom);
        area.draw_text(map.title, &style, (left, TOP - 40))?;
        let length = 200;
        for step in 0..length {
            let share = f64::from(step) / f64::from(length - 1);
            let value = map.low + share * (map.high - map.low);
            let stripe = [(left + step, TOP - 36), (left + step + 1, TOP - 26)];
            area.draw(&Rectangle::new(stripe, map.color(value).filled()))?;
        }
        let style = |horizontal| text(6, INK, horizontal, VPos::Top);
        area.draw_text(&map.number(map.low), &style(HPos::Left), (left, TOP - 22))?;
        let high = map.shown(map.high);
        area.draw_text(&high, &style(HPos::Right), (left + length, TOP - 22))
    }
}

impl Chart for PolarMaps<'_> {
    fn size(&self) -> (u32, u32) {
        let lines = self.rows.len().div_ceil(ABREAST).max(1) as i32;
        let width = LEFT + (ABREAST * MAPS) as i32 * COLUMN;
        (width as u32, (TOP + lines * LINE + 20) as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(
            area,
            "Error by light direction (bright is good)",
            11,
            (LEFT, 12),
        )?;
        let words = [
            format!(
                "as the camera sees the lamps: middle = beside the lens, rim = from the side; {} captures, clean depth;",
                self.captures
            ),
            "left PSNR, right shadow IoU; color: mean over the lamps of a cell; orange edge: worst cell; empty: no lamp"
                .to_owned(),
        ];
        for (line, words) in words.iter().enumerate() {
            let style = text(7, FAINT, HPos::Left, VPos::Top);
            area.draw_text(words, &style, (LEFT, 38 + 16 * line as i32))?;
        }
        for (column, map) in self.maps.iter().enumerate() {
            Self::scale(area, LEFT + column as i32 * COLUMN, map)?;
        }
        for (place, (name, lights)) in self.rows.iter().enumerate() {
            let top = TOP + (place / ABREAST) as i32 * LINE;
            let left = LEFT + (place % ABREAST * MAPS) as i32 * COLUMN;
            let style = text(8, INK, HPos::Left, VPos::Top);
            area.draw_text(name, &style, (left, top))?;
            for (column, map) in self.maps.iter().enumerate() {
                let middle = (left + column as i32 * COLUMN + 110, top + 26 + RIM);
                Self::map(area, middle, lights, map)?;
            }
        }
        if self.rows.is_empty() {
            let style = text(8, FAINT, HPos::Left, VPos::Top);
            area.draw_text("no row relit anything", &style, (LEFT, TOP))?;
        }
        Ok(())
    }
}
