//! Error by light direction: polar maps of one row over the lights of all captures, PSNR, shadow
//! IoU and shadow MSE side by side, clean depth above noisy.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HPos, INK, VPos, heading, text};
use super::color_scales::{ColorScales, Lights, Map, depths};
use crate::eval::directions::{Cell, Dome};
use crate::eval::report::{LightReport, Report};
use crate::eval::summary::RowSummary;
use plotters::prelude::*;

const PANEL: i32 = 440;
const PITCH: i32 = 410;
const RIM: i32 = 140;
const LEFT: i32 = 20;
const TOP: i32 = 84;
pub(super) const WORST: RGBColor = RGBColor(0xd5, 0x5e, 0x00);

/// One row's maps.
pub(super) struct Hemisphere<'a> {
    row: &'a RowSummary,
    captures: usize,
    depths: Vec<(&'static str, Lights<'a>)>,
    scales: &'a ColorScales,
}

impl<'a> Hemisphere<'a> {
    /// `None` for a row that answered no light.
    pub(super) fn new(
        report: &'a Report,
        row: &'a RowSummary,
        scales: &'a ColorScales,
    ) -> Option<Self> {
        let depths = depths(report, row);
        (!depths.is_empty()).then_some(Self {
            row,
            captures: report.captures.len(),
            depths,
            scales,
        })
    }

    fn panel<B: DrawingBackend>(
        &self,
        area: &Canvas<B>,
        middle: (i32, i32),
        lights: &Lights<'_>,
        map: &Map,
    ) -> Drawn<B> {
        let at = |dx: i32, dy: i32| (middle.0 + dx, middle.1 + dy);
        let style = text(8, INK, HPos::Center, VPos::Top);
        let dome = Dome::for_lights(lights.len());
        let found = dome.means(lights, map.value);
        let mut worst: Option<(Cell, f64)> = None;
        for (cell, mean) in dome.cells().into_iter().zip(found) {
            let outline = outline(&cell, middle, RIM);
            let border = |color: RGBColor| PathElement::new(closed(&outline), color);
            let Some((mean, _)) = mean else {
                area.draw(&border(FAINT))?;
                continue;
            };
            let color = map.color(mean);
            area.draw(&Polygon::new(outline.clone(), color.filled()))?;
            area.draw(&border(FAINT))?;
            let ink = if dark(color) { WHITE } else { BLACK };
            let label = text(6, RGBColor(ink.0, ink.1, ink.2), HPos::Center, VPos::Center);
            area.draw_text(&map.number(mean), &label, inside(&cell, middle))?;
            let beats = |(_, lowest): (Cell, f64)| (mean > lowest) == map.low_is_good;
            if worst.is_none_or(beats) {
                worst = Some((cell, mean));
            }
        }
        let Some((cell, value)) = worst else {
            return area.draw_text("no light with an answer", &style, at(0, RIM + 12));
        };
        let edge = PathElement::new(closed(&outline(&cell, middle, RIM)), WORST.stroke_width(3));
        area.draw(&edge)?;
        let values = lights.iter().filter_map(|(_, light)| (map.value)(light));
        let values: Vec<f64> = values.collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let figures = format!("mean of {} lights {}", values.len(), map.shown(mean));
        area.draw_text(&figures, &style, at(0, RIM + 12))?;
        let [inner, outer] = cell.off_axis_degrees;
        let place = format!(
            "worst {}, {}, {inner:.0}–{outer:.0}° off axis",
            map.shown(value),
            cell.place()
        );
        area.draw_text(&place, &style, at(0, RIM + 32))
    }

    fn color_bar<B: DrawingBackend>(area: &Canvas<B>, (x, y): (i32, i32), map: &Map) -> Drawn<B> {
        let steps = 2 * RIM;
        let value = |share: f64| map.low + share * (map.high - map.low);
        for step in 0..steps {
            let share = 1.0 - f64::from(step) / f64::from(steps - 1);
            let stripe = [(x, y + step), (x + 14, y + step + 1)];
            area.draw(&Rectangle::new(stripe, map.color(value(share)).filled()))?;
        }
        for tick in 0..=4 {
            let share = f64::from(tick) / 4.0;
            let tick_y = y + steps - (share * f64::from(steps)) as i32;
            let line = vec![(x + 14, tick_y), (x + 19, tick_y)];
            area.draw(&PathElement::new(line, INK))?;
            let style = text(7, INK, HPos::Left, VPos::Center);
            area.draw_text(&map.number(value(share)), &style, (x + 22, tick_y))?;
        }
        Ok(())
    }
}

impl Chart for Hemisphere<'_> {
    fn size(&self) -> (u32, u32) {
        let columns = self.scales.0.len().max(1) as i32;
        let lines = self.depths.len() as i32;
        (
            (LEFT + columns * PANEL + 20) as u32,
            (TOP + lines * PITCH + 30) as u32,
        )
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let title = format!(
            "{} {}: error by light direction",
            self.row.label, self.row.name
        );
        heading(area, &title, 13, (LEFT, 14))?;
        let faint = |vertical| text(7, FAINT, HPos::Left, vertical);
        for (line, (depth, lights)) in self.depths.iter().enumerate() {
            let top = TOP + line as i32 * PITCH;
            let worst = WorstLight::of(lights);
            let note = worst.map_or_else(String::new, |worst| worst.to_string());
            let count = format!("{depth}, {} captures{note}", self.captures);
            area.draw_text(
                &count,
                &text(8, INK, HPos::Left, VPos::Bottom),
                (LEFT, top - 8),
            )?;
            for (column, map) in self.scales.0.iter().enumerate() {
                let left = LEFT + column as i32 * PANEL;
                let middle = (left + RIM + 20, top + 34 + RIM);
                let name = match map.unit {
                    "" => map.title.to_owned(),
                    unit => format!("{} ({unit})", map.title),
                };
                let style = text(8, INK, HPos::Center, VPos::Top);
                area.draw_text(&name, &style, (middle.0, top + 6))?;
                self.panel(area, middle, lights, map)?;
                let bar = (left + 2 * RIM + 52, middle.1 - RIM);
                Self::color_bar(area, bar, map)?;
            }
        }
        let (_, height) = self.size();
        let lights = self.depths.iter().map(|(_, lights)| lights.len()).max();
        let mut rings: Vec<i32> = Dome::for_lights(lights.unwrap_or(0))
            .cells()
            .iter()
            .map(|cell| cell.off_axis_degrees[1].round() as i32)
            .collect();
        rings.dedup();
        let rings: Vec<String> = rings.iter().map(|degrees| format!("{degrees}°")).collect();
        let legend = [
            format!(
                "cells of equal area on the hemisphere, as the camera sees the lamps (right is right, up is up); \
                 rings end {} off the camera's axis",
                rings.join(", ")
            ),
            format!(
                "number and color: mean over the lamps in the cell; bright is good; one color scale for all rows; \
                 orange: worst cell; empty: no lamp{}",
                // The paper's networks answer the two separately.
                if self.row.row == 4 {
                    "; relit by SynthesisNet, shadow by ShadowNet"
                } else {
                    ""
                }
            ),
        ];
        for (line, words) in legend.iter().rev().enumerate() {
            let y = height as i32 - 10 - 18 * line as i32;
            area.draw_text(words, &faint(VPos::Bottom), (LEFT, y))?;
        }
        Ok(())
    }
}

/// The one light of lowest PSNR.
struct WorstLight<'a>(&'a str, &'a LightReport);

impl<'a> WorstLight<'a> {
    fn of(lights: &Lights<'a>) -> Option<Self> {
        let (capture, light) = lights.iter().min_by(|(_, a), (_, b)| {
            let psnr = |light: &LightReport| light.error.linear_psnr_db.0;
            psnr(a).total_cmp(&psnr(b))
        })?;
        Some(Self(capture, light))
    }
}

impl std::fmt::Display for WorstLight<'_> {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self(capture, light) = self;
        let [x, y, z] = light.direction;
        write!(
            out,
            "; worst lamp of all {} dB: {capture}, light {} at ({x:.2}, {y:.2}, {z:.2})",
            light.error.linear_psnr_db, light.light
        )
    }
}

/// Pixels of a point so many degrees off the axis, at an azimuth in degrees; `rim` pixels = 90°.
fn polar((x, y): (i32, i32), rim: i32, off_axis: f64, azimuth: f64) -> (i32, i32) {
    let radius = f64::from(rim) * off_axis / 90.0;
    let (sine, cosine) = azimuth.to_radians().sin_cos();
    (
        x + (radius * cosine).round() as i32,
        y - (radius * sine).round() as i32,
    )
}

/// The corners of a cell, arcs in steps of a few degrees.
pub(super) fn outline(cell: &Cell, middle: (i32, i32), rim: i32) -> Vec<(i32, i32)> {
    let [inner, outer] = cell.off_axis_degrees;
    let [from, to] = cell.azimuth_degrees;
    let steps = (((to - from) / 4.0).ceil() as usize).max(1);
    let arc = |off_axis: f64, step: usize| {
        let share = step as f64 / steps as f64;
        polar(middle, rim, off_axis, from + share * (to - from))
    };
    let mut points: Vec<(i32, i32)> = (0..=steps).map(|step| arc(outer, step)).collect();
    // A whole disc has no inner side.
    if inner > 0.0 {
        points.extend((0..=steps).rev().map(|step| arc(inner, step)));
    }
    points
}

pub(super) fn closed(outline: &[(i32, i32)]) -> Vec<(i32, i32)> {
    let mut points = outline.to_vec();
    points.extend(outline.first());
    points
}

/// Where a cell's number stands.
fn inside(cell: &Cell, middle: (i32, i32)) -> (i32, i32) {
    let [inner, outer] = cell.off_axis_degrees;
    let [from, to] = cell.azimuth_degrees;
    if inner == 0.0 {
        return middle;
    }
    polar(middle, RIM, (inner + outer) / 2.0, (from + to) / 2.0)
}

/// Whether white letters are better read on it than black ones (Rec. 709 luma).
fn dark(color: RGBColor) -> bool {
    let [red, green, blue] = [color.0, color.1, color.2].map(f64::from);
    0.2126 * red + 0.7152 * green + 0.0722 * blue < 128.0
}
