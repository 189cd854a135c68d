//! What the polar maps of a report show, and the color scales that all its rows share.

use super::canvas::viridis;
use crate::eval::directions::{Dome, PSNR, Quantity, SHADOW_IOU, SHADOW_MSE, lights_of};
use crate::eval::report::{LightReport, Report};
use crate::eval::summary::RowSummary;
use plotters::prelude::RGBColor;

/// A quantity with its color scale.
#[derive(Clone, Copy)]
pub(super) struct Map {
    pub(super) title: &'static str,
    pub(super) unit: &'static str,
    digits: usize,
    /// What a value is multiplied by to be shown.
    shown_times: f64,
    pub(super) low: f64,
    pub(super) high: f64,
    /// True when low values are good, so that bright is good in every map.
    pub(super) low_is_good: bool,
    pub(super) value: Quantity,
}

impl Map {
    pub(super) fn color(&self, value: f64) -> RGBColor {
        let share = (value - self.low) / (self.high - self.low);
        viridis(if self.low_is_good { 1.0 - share } else { share })
    }

    pub(super) fn number(&self, value: f64) -> String {
        format!("{:.*}", self.digits, value * self.shown_times)
    }

    pub(super) fn shown(&self, value: f64) -> String {
        format!("{} {}", self.number(value), self.unit)
            .trim_end()
            .to_owned()
    }
}

/// The maps and color scales that all rows of a report share, so that their charts compare.
pub(super) struct ColorScales(pub(super) Vec<Map>);

impl ColorScales {
    pub(super) fn new(report: &Report) -> Self {
        let means = |quantity: Quantity| -> Option<(f64, f64)> {
            let mut values = Vec::new();
            for row in &report.rows {
                for (_, lights) in depths(report, row) {
                    let cells = Dome::for_lights(lights.len()).means(&lights, quantity);
                    values.extend(cells.into_iter().flatten().map(|(mean, _)| mean));
                }
            }
            let low = values.iter().copied().min_by(f64::total_cmp)?;
            Some((low, values.into_iter().max_by(f64::total_cmp)?))
        };
        let mut maps = Vec::new();
        if let Some((low, high)) = means(PSNR) {
            maps.push(Map {
                title: "relit PSNR, linear light",
                unit: "dB",
                digits: 1,
                shown_times: 1.0,
                low: low.floor(),
                high: high.ceil().max(low.floor() + 1.0),
                low_is_good: false,
                value: PSNR,
            });
        }
        if means(SHADOW_IOU).is_some() {
            maps.push(Map {
                title: "cast-shadow IoU",
                unit: "",
                digits: 2,
                shown_times: 1.0,
                low: 0.0,
                high: 1.0,
                low_is_good: false,
                value: SHADOW_IOU,
            });
        }
        if let Some((_, high)) = means(SHADOW_MSE) {
            maps.push(Map {
                title: "cast-shadow MSE",
                unit: "×1e-2",
                digits: 1,
                shown_times: 100.0,
                low: 0.0,
                high: (20.0 * high).ceil().max(1.0) / 20.0,
                low_is_good: true,
                value: SHADOW_MSE,
            });
        }
        Self(maps)
    }
}

/// Lights with the names of their captures.
pub(super) type Lights<'a> = Vec<(&'a str, &'a LightReport)>;

/// The lights of a row with clean and, where there are any, with noisy depth.
pub(super) fn depths<'a>(report: &'a Report, row: &RowSummary) -> Vec<(&'static str, Lights<'a>)> {
    let noisy = report.noisy.as_ref().map(|noisy| noisy.captures.as_slice());
    let both = [
        ("clean depth", report.captures.as_slice()),
        ("noisy depth", noisy.unwrap_or_default()),
    ];
    let lights = both.map(|(depth, captures)| (depth, lights_of(captures, &row.label)));
    let answered = lights.into_iter().filter(|(_, lights)| !lights.is_empty());
    answered.collect()
}
