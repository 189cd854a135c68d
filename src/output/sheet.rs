//! The contact sheet: everything known about a shot on one labelled page.

use super::{label, tone::Tone};
use drivers::Plane;
use rayon::prelude::*;

/// Panels side by side.
const COLUMNS: usize = 4;
/// Largest panel, pixels.
const PANEL: usize = 320;
/// Space between panels and around them, pixels.
const GAP: usize = 12;
/// Height of a panel's label and of the title, pixels.
const LABEL: f32 = 17.0;
const TITLE: f32 = 22.0;
const PAPER: [u8; 3] = [24, 24, 28];
const INK: [u8; 3] = [235, 235, 235];
/// What is unknown; no tone of ours.
const UNKNOWN: [u8; 3] = [70, 40, 70];
/// At most this many samples a side are averaged into one pixel of a panel.
const TAPS: usize = 4;

/// One labelled picture of the sheet, already small and in display sRGB.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// What it shows.
    pub label: String,
    /// At most 320 pixels on a side.
    pub picture: Plane<[u8; 3]>,
}

impl Panel {
    /// A picture of light.
    pub fn light(label: impl Into<String>, plane: &Plane<[f32; 3]>, tone: &Tone) -> Self {
        let small = shrink(plane.size(), |x, y| plane[(x, y)]);
        Self::of(label, small.map(|rgb| tone.srgb8(*rgb)))
    }

    /// Fractions in [0, 1] as gray.
    pub fn fraction(label: impl Into<String>, plane: &Plane<f32>) -> Self {
        let small = shrink(plane.size(), |x, y| [plane[(x, y)]; 3]);
        Self::of(
            label,
            small.map(|[value, ..]| byte(*value).map(|gray| [gray; 3])),
        )
    }

    /// Unit vectors in people's axes (x right, y up, z toward the camera) as (n + 1) / 2.
    pub fn normal(label: impl Into<String>, plane: &Plane<[f32; 3]>) -> Self {
        let small = shrink(plane.size(), |x, y| plane[(x, y)]);
        Self::of(
            label,
            small.map(|rgb| {
                let [x, y, z] = rgb.map(|value| byte(value * 0.5 + 0.5));
                Some([x?, y?, z?])
            }),
        )
    }

    /// Distances, near = yellow, far = violet; the label gets the range (2nd to 98th percentile).
    pub fn distance(label: &str, metres: &Plane<f32>) -> Self {
        match range(metres) {
            Some((near, far)) => {
                let label = format!("{label} {near:.2}–{far:.2} m");
                Self::distance_within(label, metres, (near, far))
            }
            None => {
                let small = shrink(metres.size(), |x, y| [metres[(x, y)]; 3]);
                Self::of(format!("{label}: unknown"), small.map(|_| None))
            }
        }
    }

    /// Distances in a range given in metres, so that several panels compare.
    pub fn distance_within(
        label: impl Into<String>,
        metres: &Plane<f32>,
        (near, far): (f32, f32),
    ) -> Self {
        let small = shrink(metres.size(), |x, y| [metres[(x, y)]; 3]);
        let span = (far - near).max(1e-6);
        let color = |metres: f32| viridis(1.0 - (metres - near) / span);
        Self::of(
            label,
            small.map(|[metres, ..]| metres.is_finite().then(|| color(*metres))),
        )
    }

    /// The same picture, its longer side brought to so many pixels: means where it shrinks, repeated
    /// pixels where it grows.
    pub fn fitted(self, side: usize) -> Self {
        let (width, height) = self.picture.size();
        let longer = width.max(height).max(1);
        let small = |length: usize| (length * side / longer).max(1);
        let (columns, rows) = (small(width), small(height));
        let span = |index: usize, parts: usize, length: usize| {
            let from = index * length / parts;
            from..((index + 1) * length / parts).max(from + 1)
        };
        let picture = Plane::from_fn(columns, rows, |x, y| {
            let (mut sum, mut number) = ([0_u32; 3], 0);
            for from_y in span(y, rows, height) {
                for from_x in span(x, columns, width) {
                    number += 1;
                    for (sum, value) in sum.iter_mut().zip(self.picture[(from_x, from_y)]) {
                        *sum += u32::from(value);
                    }
                }
            }
            sum.map(|sum| (sum / number) as u8)
        });
        Self { picture, ..self }
    }

    fn of(label: impl Into<String>, picture: Plane<Option<[u8; 3]>>) -> Self {
        Self {
            label: label.into(),
            picture: picture.map(|pixel| pixel.unwrap_or(UNKNOWN)),
        }
    }
}

/// The 2nd and the 98th percentile of the distances known, as they are shown; `None` where none is.
pub fn range(metres: &Plane<f32>) -> Option<(f32, f32)> {
    let small = shrink(metres.size(), |x, y| [metres[(x, y)]; 3]);
    let samples = small.samples().iter();
    let mut known: Vec<f32> = samples.map(|m| m[0]).filter(|m| m.is_finite()).collect();
    known.sort_unstable_by(f32::total_cmp);
    let last = known.len().checked_sub(1)?;
    let at = |fraction: f64| known[(last as f64 * fraction) as usize];
    Some((at(0.02), at(0.98)))
}

/// How panels are laid out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Panels side by side, from 1.
    pub columns: usize,
    /// Height of a panel's label, pixels.
    pub label: f32,
}

/// Lays panels out in rows of four under a title.
pub fn lay_out(title: &str, panels: &[Panel]) -> Plane<[u8; 3]> {
    let layout = Layout {
        columns: COLUMNS,
        label: LABEL,
    };
    lay_out_as(title, panels, layout)
}

/// Lays panels out in rows under a title.
pub fn lay_out_as(title: &str, panels: &[Panel], layout: Layout) -> Plane<[u8; 3]> {
    let columns = panels.len().clamp(1, layout.columns.max(1));
    let cell = panels
        .iter()
        .map(|panel| panel.picture.width())
        .max()
        .unwrap_or(0)
        .max(120);
    let row_heights: Vec<usize> = panels
        .chunks(columns)
        .map(|row| {
            row.iter()
                .map(|panel| panel.picture.height())
                .max()
                .unwrap_or(0)
        })
        .collect();
    let head = GAP * 2 + TITLE as usize;
    let foot = layout.label as usize + GAP + GAP / 2;
    let width = GAP + columns * (cell + GAP);
    let height = head + row_heights.iter().map(|row| row + foot).sum::<usize>();
    let mut page = Plane::filled(width, height, PAPER);
    label::draw(
        &mut page,
        (GAP, GAP),
        TITLE,
        INK,
        &label::fit(TITLE, width - 2 * GAP, title),
    );
    let mut top = head;
    for (row, height) in panels.chunks(columns).zip(row_heights) {
        for (column, panel) in row.iter().enumerate() {
            let left = GAP + column * (cell + GAP);
            for y in 0..panel.picture.height() {
                let line = panel.picture.row(y);
                page.row_mut(top + y)[left..left + line.len()].copy_from_slice(line);
            }
            let words = label::fit(layout.label, cell, &panel.label);
            let place = (left, top + height + 3);
            label::draw(&mut page, place, layout.label, INK, &words);
        }
        top += height + foot;
    }
    page
}

/// Mean of the known samples under each pixel of a picture that fits the panel; NaN where none is.
fn shrink(
    (width, height): (usize, usize),
    sample: impl Fn(usize, usize) -> [f32; 3] + Sync,
) -> Plane<[f32; 3]> {
    let scale = (width.max(height) as f64 / PANEL as f64).max(1.0);
    let small = |side: usize| ((side as f64 / scale).round() as usize).clamp(1, side.max(1));
    let (small_width, small_height) = (small(width), small(height));
    if width == 0 || height == 0 {
        return Plane::filled(1, 1, [f32::NAN; 3]);
    }
    let mut out = Plane::filled(small_width, small_height, [f32::NAN; 3]);
    out.samples_mut()
        .par_chunks_mut(small_width)
        .enumerate()
        .for_each(|(row, pixels)| {
            let (top, bottom) = (
                row * height / small_height,
                (row + 1) * height / small_height,
            );
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let (left, right) = (
                    column * width / small_width,
                    (column + 1) * width / small_width,
                );
                let (mut sum, mut known) = ([0.0_f32; 3], 0_u32);
                for y in (top..bottom.max(top + 1)).step_by((bottom - top).div_ceil(TAPS).max(1)) {
                    for x in
                        (left..right.max(left + 1)).step_by((right - left).div_ceil(TAPS).max(1))
                    {
                        let value = sample(x, y);
                        if value.iter().all(|v| v.is_finite()) {
                            known += 1;
                            sum.iter_mut().zip(value).for_each(|(sum, v)| *sum += v);
                        }
                    }
                }
                if known > 0 {
                    *pixel = sum.map(|sum| sum / known as f32);
                }
            }
        });
    out
}

fn byte(value: f32) -> Option<u8> {
    value.is_finite().then(|| (value * 255.0).round() as u8)
}

/// Nine points of matplotlib's viridis (CC0), 0 = violet, 1 = yellow.
pub fn viridis(fraction: f32) -> [u8; 3] {
    const MAP: [[u8; 3]; 9] = [
        [68, 1, 84],
        [71, 44, 122],
        [59, 81, 139],
        [44, 113, 142],
        [33, 144, 141],
        [39, 173, 129],
        [92, 200, 99],
        [170, 220, 50],
        [253, 231, 37],
    ];
    let at = fraction.clamp(0.0, 1.0) * (MAP.len() - 1) as f32;
    let below = (at as usize).min(MAP.len() - 2);
    let part = at - below as f32;
    std::array::from_fn(|channel| {
        let (low, high) = (
            f32::from(MAP[below][channel]),
            f32::from(MAP[below + 1][channel]),
        );
        (low + (high - low) * part).round() as u8
    })
}
