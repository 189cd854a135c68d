//! How cameras keep time: offset between them, jitter and delay of each, over the session.

use super::canvas::{
    self, Canvas, Chart, ChartError, Drawn, FAINT, HAIR, HPos, INK, VPos, heading, row_color, text,
};
use crate::timing::{Point, Timing};
use plotters::prelude::*;

const WIDTH: i32 = 1000;
const LEFT: i32 = 110;
const RIGHT: i32 = 970;
const TOP: i32 = 110;
const PANEL: i32 = 170;
/// From one panel to the next.
const PITCH: i32 = 240;

struct Track<'a> {
    name: &'static str,
    points: &'a [Point],
    color: RGBColor,
}

struct Panel<'a> {
    title: String,
    tracks: Vec<Track<'a>>,
}

struct Tracks<'a> {
    device: &'a str,
    seconds: f64,
    panels: Vec<Panel<'a>>,
}

/// Draws how the cameras of `device` kept time, as a PNG.
///
/// # Errors
/// [`ChartError::Drawing`] when the picture cannot be drawn.
pub fn timing(timing: &Timing, device: &str) -> Result<Vec<u8>, ChartError> {
    let (blue, orange) = (row_color("3"), row_color("4"));
    let cameras = [
        ("color", timing.color.as_ref(), blue),
        ("depth", timing.depth.as_ref(), orange),
    ];
    let mut panels = Vec::new();
    if !timing.offsets.is_empty() {
        panels.push(Panel {
            title: "offset: from the nearest color frame to each depth frame".to_owned(),
            tracks: vec![Track {
                name: "depth − color",
                points: &timing.offsets,
                color: INK,
            }],
        });
    }
    let of = |which: fn(&crate::timing::Cadence) -> &[Point]| -> Vec<Track<'_>> {
        let tracks = cameras.iter().filter_map(|(name, cadence, color)| {
            let points = which(cadence.as_ref()?);
            (!points.is_empty()).then_some(Track {
                name,
                points,
                color: *color,
            })
        });
        tracks.collect()
    };
    for (title, tracks) in [
        (
            "jitter: start of each exposure against an even cadence",
            of(|c| &c.residuals),
        ),
        (
            "delay: from the start of the exposure to arrival",
            of(|c| &c.delays),
        ),
    ] {
        if !tracks.is_empty() {
            let title = title.to_owned();
            panels.push(Panel { title, tracks });
        }
    }
    let chart = Tracks {
        device,
        seconds: timing.seconds.max(1e-3),
        panels,
    };
    let [_, (_, png)] = canvas::encode(&chart, "timing")?;
    Ok(png)
}

impl Tracks<'_> {
    fn panel<B: DrawingBackend>(&self, area: &Canvas<B>, top: i32, panel: &Panel<'_>) -> Drawn<B> {
        let bottom = top + PANEL;
        let style = text(8, INK, HPos::Left, VPos::Bottom);
        area.draw_text(&panel.title, &style, (LEFT, top - 8))?;
        let values = panel.tracks.iter().flat_map(|track| track.points);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
            (low.min(point.ms), high.max(point.ms))
        });
        let step = step((high - low).max(0.01) / 4.0);
        let (low, high) = (
            (low / step).floor() * step,
            ((high / step).floor() + 1.0) * step,
        );
        let y = |ms: f64| bottom - ((ms - low) / (high - low) * f64::from(PANEL)).round() as i32;
        let x =
            |seconds: f64| LEFT + (seconds / self.seconds * f64::from(RIGHT - LEFT)).round() as i32;
        let style = text(7, FAINT, HPos::Right, VPos::Center);
        for tick in 0..=((high - low) / step).round() as i32 {
            let ms = low + f64::from(tick) * step;
            let line = vec![(LEFT, y(ms)), (RIGHT, y(ms))];
            area.draw(&PathElement::new(line, HAIR))?;
            // Without the minus sign of a rounded zero.
            let words = format!("{:.*} ms", decimals(step), ms + 0.0);
            area.draw_text(&words, &style, (LEFT - 8, y(ms)))?;
        }
        let frame = [(LEFT, top), (RIGHT, bottom)];
        area.draw(&Rectangle::new(frame, FAINT.stroke_width(1)))?;
        for track in &panel.tracks {
            for point in track.points {
                let at = (x(point.seconds), y(point.ms));
                area.draw(&Circle::new(at, 2, track.color.filled()))?;
            }
        }
        for (place, track) in panel.tracks.iter().enumerate() {
            let right = RIGHT - 130 * place as i32;
            let style = text(8, track.color, HPos::Right, VPos::Bottom);
            area.draw_text(track.name, &style, (right, top - 8))?;
        }
        let style = text(7, FAINT, HPos::Left, VPos::Top);
        area.draw_text("0 s", &style, (LEFT, bottom + 6))?;
        let style = text(7, FAINT, HPos::Right, VPos::Top);
        area.draw_text(
            &format!("{:.1} s", self.seconds),
            &style,
            (RIGHT, bottom + 6),
        )
    }
}

impl Chart for Tracks<'_> {
    fn size(&self) -> (u32, u32) {
        (
            WIDTH as u32,
            (TOP + PITCH * self.panels.len().max(1) as i32) as u32,
        )
    }

    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B> {
        heading(area, "How the cameras keep time", 11, (30, 14))?;
        let style = text(7, FAINT, HPos::Left, VPos::Top);
        // As much of a long address as fits.
        let device: String = self.device.chars().take(130).collect();
        area.draw_text(&device, &style, (30, 44))?;
        for (place, panel) in self.panels.iter().enumerate() {
            self.panel(area, TOP + PITCH * place as i32, panel)?;
        }
        Ok(())
    }
}

/// The next of 1, 2 and 5 times a power of ten.
fn step(least: f64) -> f64 {
    let decade = 10f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * decade);
    steps
        .into_iter()
        .find(|step| *step >= least)
        .unwrap_or(decade)
}

fn decimals(step: f64) -> usize {
    (-step.log10().floor()).clamp(0.0, 4.0) as usize
}
