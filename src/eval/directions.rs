//! Errors by where the light stands: means over cells of equal area on the hemisphere, and over
//! bands of angle off the camera's axis.

use super::light_error::Decibel;
use super::report::{CaptureReport, LightReport};
use super::summary::mean;
use serde::Serialize;

/// Cells per ring where lights are many: 45 in all.
const FINE: &[usize] = &[1, 6, 10, 14, 14];
/// Cells per ring where they are few: 16 in all.
const COARSE: &[usize] = &[1, 6, 9];
/// Lights that a fine cell should hold on average.
const LIGHTS_PER_CELL: usize = 4;
/// Width of a band, degrees.
pub(super) const BAND_DEGREES: f64 = 10.0;

/// A quantity of one light's answer.
pub(super) type Quantity = fn(&LightReport) -> Option<f64>;

/// PSNR of the picture in linear light, decibel; none for equal pictures.
pub(super) const PSNR: Quantity =
    |light| Some(light.error.linear_psnr_db.0).filter(|value| value.is_finite());
/// IoU of the cast shadow.
pub(super) const SHADOW_IOU: Quantity = |light| light.shadow?.iou;
/// Mean squared error of the cast shadow.
pub(super) const SHADOW_MSE: Quantity = |light| Some(light.shadow?.mse);

/// Every light that the row of this label answered, over all captures, with its capture's name.
pub(super) fn lights_of<'a>(
    captures: &'a [CaptureReport],
    label: &str,
) -> Vec<(&'a str, &'a LightReport)> {
    let mut found = Vec::new();
    for capture in captures {
        for row in capture.rows.iter().filter(|row| row.label == label) {
            let lights = row.relit.iter().flat_map(|relit| &relit.lights);
            found.extend(lights.map(|light| (capture.name.as_str(), light)));
        }
    }
    found
}

/// One cell of the hemisphere; all have the same solid angle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cell {
    /// From and to which angle off the camera's axis, degrees.
    pub off_axis_degrees: [f64; 2],
    /// From and to which azimuth, degrees, counter-clockwise from the right as the camera sees it.
    pub azimuth_degrees: [f64; 2],
}

impl Cell {
    /// Where it lies, in words.
    pub fn place(&self) -> &'static str {
        const PLACES: [&str; 8] = [
            "right",
            "upper right",
            "above",
            "upper left",
            "left",
            "lower left",
            "below",
            "lower right",
        ];
        let [from, to] = self.azimuth_degrees;
        if to - from >= 360.0 {
            return "beside the lens";
        }
        PLACES[(((from + to) / 2.0 / 45.0).round() as usize) % PLACES.len()]
    }
}

/// The hemisphere toward the camera in cells of equal area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dome(&'static [usize]);

impl Dome {
    /// Fine enough for so many lights, and no finer.
    pub(super) fn for_lights(lights: usize) -> Self {
        let fine: usize = FINE.iter().sum();
        Self(if lights >= fine * LIGHTS_PER_CELL {
            FINE
        } else {
            COARSE
        })
    }

    /// Outer edge of a ring as cosine: the rings above it hold their share of the area.
    fn edge(self, rings: usize) -> f64 {
        let all: usize = self.0.iter().sum();
        let inside: usize = self.0[..rings].iter().sum();
        1.0 - inside as f64 / all as f64
    }

    /// All cells, ring by ring from the axis outward.
    pub(super) fn cells(self) -> Vec<Cell> {
        let degrees = |ring: usize| self.edge(ring).acos().to_degrees();
        let mut cells = Vec::new();
        for (ring, &sectors) in self.0.iter().enumerate() {
            let width = 360.0 / sectors as f64;
            cells.extend((0..sectors).map(|sector| Cell {
                off_axis_degrees: [degrees(ring), degrees(ring + 1)],
                azimuth_degrees: [sector as f64 * width, (sector + 1) as f64 * width],
            }));
        }
        cells
    }

    /// The cell that a unit direction (x right, y up, z toward the camera) falls into; a light
    /// behind the scene falls into the outermost ring.
    pub(super) fn cell_of(self, direction: [f32; 3]) -> usize {
        let [x, y, z] = direction.map(f64::from);
        let last = self.0.len() - 1;
        let ring = (0..last)
            .find(|ring| z > self.edge(ring + 1))
            .unwrap_or(last);
        let turn = y.atan2(x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
        let sector = ((turn * self.0[ring] as f64) as usize).min(self.0[ring] - 1);
        self.0[..ring].iter().sum::<usize>() + sector
    }

    /// The mean of a quantity in every cell, and over how many lights; `None` in an empty cell.
    pub(super) fn means(
        self,
        lights: &[(&str, &LightReport)],
        quantity: Quantity,
    ) -> Vec<Option<(f64, usize)>> {
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); self.0.iter().sum()];
        for (_, light) in lights {
            values[self.cell_of(light.direction)].extend(quantity(light));
        }
        let means = values.into_iter().map(|values| {
            let number = values.len();
            mean(values.into_iter()).map(|mean| (mean, number))
        });
        means.collect()
    }
}

/// The part of the hemisphere that a row does worst in.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WorstDirection {
    /// Where.
    pub cell: Cell,
    /// Mean PSNR in linear light of the lights in it.
    pub linear_psnr_db: Decibel,
    /// How many those are.
    pub lights: usize,
}

impl WorstDirection {
    /// The cell of lowest mean PSNR; `None` without a light.
    pub(super) fn of(lights: &[(&str, &LightReport)]) -> Option<Self> {
        let dome = Dome::for_lights(lights.len());
        let means = dome.means(lights, PSNR);
        let (cell, (psnr, number)) = dome
            .cells()
            .into_iter()
            .zip(means)
            .filter_map(|(cell, mean)| Some((cell, mean?)))
            .min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0))?;
        Some(Self {
            cell,
            linear_psnr_db: Decibel(psnr),
            lights: number,
        })
    }
}

impl std::fmt::Display for WorstDirection {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [inner, outer] = self.cell.off_axis_degrees;
        write!(
            out,
            "{} dB {}, {inner:.0}–{outer:.0}° off axis ({} lights)",
            self.linear_psnr_db,
            self.cell.place(),
            self.lights
        )
    }
}

/// The mean of a quantity in every band of [`BAND_DEGREES`] off the camera's axis: the band's
/// middle in degrees, the mean, how many lights; empty bands are left out.
pub(super) fn by_angle(
    lights: &[(&str, &LightReport)],
    quantity: Quantity,
) -> Vec<(f64, f64, usize)> {
    let bands = (180.0 / BAND_DEGREES) as usize;
    let mut found = Vec::new();
    for band in 0..bands {
        let values = lights
            .iter()
            .filter(|(_, light)| (light.off_axis_degrees() / BAND_DEGREES) as usize == band)
            .filter_map(|(_, light)| quantity(light));
        let values: Vec<f64> = values.collect();
        let number = values.len();
        if let Some(mean) = mean(values.into_iter()) {
            found.push(((band as f64 + 0.5) * BAND_DEGREES, mean, number));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::light_error::LightError;
    use proptest::prelude::*;

    fn light(direction: [f32; 3], psnr: f64) -> LightReport {
        let mse = 10f64.powf(-psnr / 10.0);
        LightReport {
            light: 0,
            direction,
            error: LightError {
                linear_mse: mse,
                linear_psnr_db: Decibel(psnr),
                srgb_mse: mse,
                srgb_psnr_db: Decibel(psnr),
                srgb_ssim: None,
                scale_invariant_mse: mse,
                pixels: 1,
                unanswered: 0,
            },
            shadow: None,
        }
    }

    #[test]
    fn the_worst_cell_is_the_one_of_lowest_mean_and_not_that_of_the_worst_light() {
        let lights = [
            light([0.0, 0.0, 1.0], 30.0),
            // To the right, near the horizon: 12 and 28 dB, mean 20.
            light([0.98, 0.05, 0.19], 12.0),
            light([0.98, 0.06, 0.19], 28.0),
            // Straight up, near the horizon.
            light([0.0, 0.98, 0.19], 19.0),
        ];
        let lights: Vec<(&str, &LightReport)> = lights.iter().map(|light| ("a", light)).collect();
        let worst = WorstDirection::of(&lights).unwrap();
        assert_eq!((worst.linear_psnr_db.0, worst.lights), (19.0, 1));
        assert_eq!(worst.cell.place(), "above");
        // Seven of 16 cells lie inside the outer ring: arccos(9/16).
        assert!((worst.cell.off_axis_degrees[0] - 55.77).abs() < 0.01);
        let bands = by_angle(&lights, PSNR);
        let (middle, mean, number) = bands[1];
        assert_eq!((middle, number), (75.0, 3));
        assert!((mean - 59.0 / 3.0).abs() < 1e-9);
        assert_eq!(bands[0], (5.0, 30.0, 1));
    }

    #[test]
    fn every_cell_has_the_same_solid_angle() {
        for dome in [Dome(FINE), Dome(COARSE)] {
            let cells = dome.cells();
            let share = std::f64::consts::TAU / cells.len() as f64;
            for cell in cells {
                let [inner, outer] = cell.off_axis_degrees.map(f64::to_radians);
                let [from, to] = cell.azimuth_degrees.map(f64::to_radians);
                let solid = (inner.cos() - outer.cos()) * (to - from);
                assert!((solid - share).abs() < 1e-12, "{cell:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn a_direction_lies_inside_the_cell_it_falls_into(z in 0.001_f64..0.999, turn in 0.0_f64..std::f64::consts::TAU) {
            let across = (1.0 - z * z).sqrt();
            let direction = [across * turn.cos(), across * turn.sin(), z].map(|v| v as f32);
            for dome in [Dome(FINE), Dome(COARSE)] {
                let cell = dome.cells()[dome.cell_of(direction)];
                let [inner, outer] = cell.off_axis_degrees;
                let [from, to] = cell.azimuth_degrees;
                let (off, azimuth) = (z.acos().to_degrees(), turn.to_degrees());
                // Single precision, near an edge.
                prop_assert!(off > inner - 0.01 && off < outer + 0.01, "{off} {cell:?}");
                prop_assert!(azimuth > from - 0.01 && azimuth < to + 0.01, "{azimuth} {cell:?}");
            }
        }
    }
}
