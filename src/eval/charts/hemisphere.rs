//! Error by light direction: one polar map of the hemisphere per row, PSNR above shadow IoU.

use super::canvas::{Canvas, Chart, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, text, viridis};
use crate::eval::report::{CaptureReport, LightReport, RowReport};
use plotters::prelude::*;

const PANEL: i32 = 390;
const PITCH: i32 = 370;
const RIM: i32 = 120;
const LEFT: i32 = 20;
const TOP: i32 = 70;
const BAR: i32 = 150;

/// One capture's maps.
pub(super) struct Hemisphere<'a> {
    capture: &'a CaptureReport,
    maps: Vec<Map>,
    /// Angle of the outermost ring, degrees.
    reach_degrees: f64,
}

/// A quantity with its color scale.
struct Map {
    title: &'static str,
    unit: &'static str,
    digits: usize,
    low: f64,
    high: f64,
    value: fn(&LightReport) -> Option<f64>,
}

impl<'a> Hemisphere<'a> {
    pub(super) fn new(capture: &'a CaptureReport) -> Self {
        let lights = || capture.rows.iter().flat_map(|row| &row.lights);
        let furthest = lights()
            .map(LightReport::off_axis_degrees)
            .fold(0.0, f64::max);
        let mut maps = Vec::new();
        let psnr = |light: &LightReport| {
            Some(light.error.linear_psnr_db.0).filter(|value| value.is_finite())
        };
        if let Some((low, high)) = range(lights().filter_map(psnr)) {
            let (low, high) = (low.floor(), high.ceil().max(low.floor() + 1.0));
            maps.push(Map {
                title: "PSNR, linear light",
                unit: "dB",
                digits: 1,
                low,
                high,
                value: psnr,
            });
        }
        let iou = |light: &LightReport| light.shadow?.iou;
        if lights().any(|light| iou(light).is_some()) {
            maps.push(Map {
                title: "cast-shadow IoU",
                unit: "",
                digits: 2,
                low: 0.0,
                high: 1.0,
                value: iou,
            });
        }
        let reach_degrees = ((furthest / 15.0).ceil() * 15.0).clamp(30.0, 90.0);
        Self {
            capture,
            maps,
            reach_degrees,
        }
    }

    /// Pixels from the panel's middle, x right and y up as the lamp stands to the viewer.
    fn place(&self, light: &LightReport) -> (i32, i32) {
        let [x, y, _] = light.direction.map(f64::from);
        let radius = f64::from(RIM) * light.off_axis_degrees() / self.reach_degrees;
        let across = x.hypot(y).max(1e-9);
        (
            (radius * x / across).round() as i32,
            (-radius * y / across).round() as i32,
        )
    }

    fn panel<B: DrawingBackend>(
        &self,
        area: &Canvas<B>,
        (middle_x, middle_y): (i32, i32),
        row: &RowReport,
        map: &Map,
    ) -> Drawn<B> {
        let at = |dx: i32, dy: i32| (middle_x + dx, middle_y + dy);
        let name = format!("{} {}", row.row, row.name);
        area.draw_text(
            &name,
            &text(9, INK, HPos::Center, VPos::Bottom),
            at(0, -RIM - 24),
        )?;
        for ring in 1..=3 {
            let radius = RIM * ring / 3;
            area.draw(&Circle::new(at(0, 0), radius, HAIR.stroke_width(1)))?;
        }
        for (dx, dy) in [(RIM, 0), (0, RIM)] {
            area.draw(&PathElement::new(vec![at(-dx, -dy), at(dx, dy)], HAIR))?;
        }
        let mut worst: Option<(&LightReport, f64)> = None;
        for light in &row.lights {
            let (dx, dy) = self.place(light);
            match (map.value)(light) {
                Some(value) => {
                    let share = (value - map.low) / (map.high - map.low);
                    area.draw(&Circle::new(at(dx, dy), 9, viridis(share).filled()))?;
                    area.draw(&Circle::new(at(dx, dy), 9, INK.stroke_width(1)))?;
                    if worst.is_none_or(|(_, lowest)| value < lowest) {
                        worst = Some((light, value));
                    }
                }
                None => area.draw(&Circle::new(at(dx, dy), 4, FAINT.stroke_width(1)))?,
            }
        }
        // Ring labels last, below the horizontal axis, so that no dot hides them.
        for ring in 1..=3 {
            let degrees = self.reach_degrees * f64::from(ring) / 3.0;
            let label = format!("{degrees:.0}°");
            let style = text(7, FAINT, HPos::Left, VPos::Top);
            area.draw_text(&label, &style, at(RIM * ring / 3 + 3, 3))?;
        }
        let values: Vec<f64> = row.lights.iter().filter_map(map.value).collect();
        let style = text(8, INK, HPos::Center, VPos::Top);
        let Some((light, lowest)) = worst else {
            return area.draw_text("no light with an answer", &style, at(0, RIM + 12));
        };
        let (dx, dy) = self.place(light);
        area.draw(&Circle::new(
            at(dx, dy),
            14,
            RGBColor(0xd5, 0x5e, 0x00).stroke_width(3),
        ))?;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let shown = |value: f64| {
            format!("{value:.*} {}", map.digits, map.unit)
                .trim_end()
                .to_owned()
        };
        let figures = format!("mean {}, worst {}", shown(mean), shown(lowest));
        area.draw_text(&figures, &style, at(0, RIM + 12))?;
        let [x, y, z] = light.direction;
        let place = format!("worst light {} at ({x:.2}, {y:.2}, {z:.2})", light.light);
        area.draw_text(
            &place,
            &text(8, INK, HPos::Center, VPos::Top),
            at(0, RIM + 32),
        )
    }

    fn color_bar<B: DrawingBackend>(
        &self,
        area: &Canvas<B>,
        (x, y): (i32, i32),
        map: &Map,
    ) -> Drawn<B> {
        let steps = 2 * RIM;
        for step in 0..steps {
            let share = 1.0 - f64::from(step) / f64::from(steps - 1);
            let stripe = [(x, y + step), (x + 18, y + step + 1)];
            area.draw(&Rectangle::new(stripe, viridis(share).filled()))?;
        }
        for tick in 0..=4 {
            let share = f64::from(tick) / 4.0;
            let value = map.low + share * (map.high - map.low);
            let tick_y = y + steps - (share * f64::from(steps)) as i32;
            let label = format!("{value:.*} {}", map.digits, map.unit);
            area.draw(&PathElement::new(
                vec![(x + 18, tick_y), (x + 23, tick_y)],
                INK,
            ))?;
            let style = text(7, INK, HPos::Left, VPos::Center);
            area.draw_text(label.trim_end(), &style, (x + 27, tick_y))?;
        }
        Ok(())
    }
}

impl Chart for Hemisphere<'_> {
    fn size(&self) -> (u32, u32) {
        let columns = self.capture.rows.len().max(1) as i32;
        let lines = self.maps.len().max(1) as i32;
        (
            (LEFT + columns * PANEL + BAR) as u32,
            (TOP + lines * PITCH + 40) as u32,
        )
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        let title = format!("{}: error by light direction", self.capture.name);
        heading(area, &title, 13, (LEFT, 14))?;
        for (line, map) in self.maps.iter().enumerate() {
            let top = TOP + line as i32 * PITCH;
            let label = if map.unit.is_empty() {
                map.title.to_owned()
            } else {
                format!("{} ({})", map.title, map.unit)
            };
            heading(area, &label, 10, (LEFT, top - 8))?;
            let middle_y = top + 70 + RIM;
            for (column, row) in self.capture.rows.iter().enumerate() {
                let middle_x = LEFT + column as i32 * PANEL + PANEL / 2;
                self.panel(area, (middle_x, middle_y), row, map)?;
            }
            let bar_x = LEFT + self.capture.rows.len() as i32 * PANEL + 30;
            self.color_bar(area, (bar_x, middle_y - RIM), map)?;
        }
        let (_, height) = self.size();
        let legend = "dot: one lamp, as the camera sees it (right is right, up is up); rings: degrees off the \
                      camera's axis; orange ring: worst lamp; small hollow dot: no value";
        let style = text(7, FAINT, HPos::Left, VPos::Bottom);
        area.draw_text(legend, &style, (LEFT, height as i32 - 12))
    }
}

/// Lowest and highest value; `None` without one.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((low.min(value), high.max(value))),
    })
}
