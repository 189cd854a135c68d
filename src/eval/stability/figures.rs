//! Cells → curves: error growth by way and row, and where a row becomes worse than doing nothing.

use super::{CaptureCells, Cell, Detector, Spoiling};
use crate::eval::roster::{Roster, Row};
use crate::eval::summary::mean;
use serde::Serialize;

/// The label of the row that does nothing.
const NOTHING: &str = "1";
/// The severity that methods are compared at.
pub const COMPARED: u8 = 3;

/// Everything the stability run measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StabilityReport {
    /// Of the dice; each capture's own follow from it and the capture's name.
    pub seed: u64,
    /// The severities, ascending.
    pub severities: Vec<u8>,
    /// One entry per way.
    pub ways: Vec<WayReport>,
    /// Every row that answered a capture as it came.
    pub growth: Vec<RowGrowth>,
    /// What the shots say about themselves, way by way.
    pub detectors: Vec<Detector>,
    /// What all of it was made of.
    pub captures: Vec<CaptureCells>,
}

/// One way to make captures worse, and what it does to each row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WayReport {
    /// Its name.
    pub name: &'static str,
    /// What happens, in plain words.
    pub description: &'static str,
    /// How much happens at severities 1 to 5.
    pub levels: [f32; 5],
    /// What the levels count.
    pub unit: &'static str,
    /// One curve per row that answered.
    pub rows: Vec<RowCurve>,
    /// Cells that could not be measured: how many, and why the first.
    pub refused: usize,
    /// Why the first of them could not.
    pub first_refusal: Option<String>,
}

/// One row's error against the severity of one way.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowCurve {
    /// As in [`Row::label`].
    pub label: String,
    /// Severity 0 (as it came), then those asked for; one without a capture in common is left out.
    pub points: Vec<CurvePoint>,
    /// The first severity at which its error is above that of doing nothing with the same
    /// captures; `None` where there is none, and for the row that does nothing.
    pub worse_than_nothing_from: Option<u8>,
}

/// One point of a curve, over the captures that the row answered clean and at this severity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CurvePoint {
    /// 0 = as it came.
    pub severity: u8,
    /// Captures.
    pub captures: usize,
    /// Mean over captures of the mean squared error in linear light.
    pub linear_mse: f64,
    /// `linear_mse` over that of the same captures as they came.
    pub growth: f64,
    /// Mean over captures of each capture's own growth.
    pub mean_of_growths: f64,
    /// Mean squared error of doing nothing with the same captures, made worse alike.
    pub nothing_linear_mse: Option<f64>,
    /// Captures whose error is above that of doing nothing.
    pub worse_captures: usize,
}

/// One row's stability over all ways.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowGrowth {
    /// As in [`Row::label`].
    pub label: String,
    /// Its name.
    pub name: String,
    /// Mean over the ways of the growth at [`COMPARED`]; `None` where that severity was not asked
    /// for.
    pub mean_growth: Option<f64>,
    /// The way it suffers most from at that severity, and its growth.
    pub worst: Option<(&'static str, f64)>,
    /// The ways, of those measured, by which it becomes worse than doing nothing, with the first
    /// severity at which it is.
    pub worse_than_nothing: Vec<(&'static str, u8)>,
}

impl StabilityReport {
    /// Averages the cells of all captures.
    pub(in crate::eval) fn of(
        spoiling: &Spoiling,
        roster: &Roster,
        captures: Vec<CaptureCells>,
    ) -> Self {
        let answered = |row: &&Row| {
            let clean = captures.iter().map(|capture| &capture.clean);
            clean.filter_map(|cell| cell.mse(&row.label)).count() > 0
        };
        let rows: Vec<&Row> = roster.rows().iter().filter(answered).collect();
        let ways = spoiling.ways.iter().map(|way| {
            let cells = captures.iter().flat_map(|capture| &capture.spoiled);
            let mut refusals = cells
                .filter(|cell| cell.way == way.name)
                .filter_map(|cell| cell.refused.as_ref());
            let first_refusal = refusals.next().cloned();
            let curves = rows
                .iter()
                .map(|row| RowCurve::of(&row.label, way.name, &spoiling.severities, &captures));
            WayReport {
                name: way.name,
                description: way.description,
                levels: way.levels,
                unit: way.unit,
                rows: curves.collect(),
                refused: refusals.count() + usize::from(first_refusal.is_some()),
                first_refusal,
            }
        });
        let ways: Vec<WayReport> = ways.collect();
        let growth = rows.iter().map(|row| RowGrowth::of(row, &ways));
        Self {
            seed: spoiling.seed,
            severities: spoiling.severities.clone(),
            growth: growth.collect(),
            ways,
            detectors: Detector::all(spoiling, &captures),
            captures,
        }
    }
}

impl RowCurve {
    fn of(label: &str, way: &str, severities: &[u8], captures: &[CaptureCells]) -> Self {
        let points = [0].iter().chain(severities).filter_map(|severity| {
            let pairs = captures.iter().filter_map(|capture| {
                let cell = match severity {
                    0 => &capture.clean,
                    _ => capture
                        .spoiled
                        .iter()
                        .find(|cell| cell.way == way && cell.severity == *severity)?,
                };
                Some((capture.clean.mse(label)?, cell.mse(label)?, cell))
            });
            CurvePoint::of(*severity, &pairs.collect::<Vec<_>>())
        });
        let points: Vec<CurvePoint> = points.collect();
        let worse = points.iter().find(|point| {
            let nothing = point.nothing_linear_mse;
            label != NOTHING && nothing.is_some_and(|nothing| point.linear_mse > nothing)
        });
        Self {
            label: label.to_owned(),
            worse_than_nothing_from: worse.map(|point| point.severity),
            points,
        }
    }

    /// The growth at a severity.
    pub fn growth_at(&self, severity: u8) -> Option<f64> {
        let point = self
            .points
            .iter()
            .find(|point| point.severity == severity)?;
        Some(point.growth)
    }
}

impl CurvePoint {
    /// Of clean error, error, and the cell it is from; `None` without one.
    fn of(severity: u8, pairs: &[(f64, f64, &Cell)]) -> Option<Self> {
        let clean = mean(pairs.iter().map(|(clean, ..)| *clean))?;
        let linear_mse = mean(pairs.iter().map(|(_, mse, _)| *mse))?;
        // Where doing nothing is answered for each of them, which it is wherever anything is.
        let nothing: Option<Vec<f64>> = pairs.iter().map(|(.., cell)| cell.mse(NOTHING)).collect();
        let worse = pairs
            .iter()
            .filter(|(_, mse, cell)| cell.mse(NOTHING).is_some_and(|nothing| *mse > nothing));
        Some(Self {
            severity,
            captures: pairs.len(),
            linear_mse,
            growth: ratio(linear_mse, clean),
            mean_of_growths: mean(pairs.iter().map(|(clean, mse, _)| ratio(*mse, *clean)))?,
            nothing_linear_mse: nothing.and_then(|nothing| mean(nothing.into_iter())),
            worse_captures: worse.count(),
        })
    }
}

/// How many times the clean error; a perfect clean answer is taken for one of 100 dB.
fn ratio(mse: f64, clean: f64) -> f64 {
    mse.max(1e-10) / clean.max(1e-10)
}

impl RowGrowth {
    fn of(row: &Row, ways: &[WayReport]) -> Self {
        let curves = || {
            ways.iter().filter_map(|way| {
                let curve = way.rows.iter().find(|curve| curve.label == row.label)?;
                Some((way.name, curve))
            })
        };
        let grown = || curves().filter_map(|(way, curve)| Some((way, curve.growth_at(COMPARED)?)));
        let worse = curves().filter_map(|(way, curve)| Some((way, curve.worse_than_nothing_from?)));
        Self {
            label: row.label.clone(),
            name: row.name.clone(),
            mean_growth: mean(grown().map(|(_, growth)| growth)),
            worst: grown().max_by(|a, b| a.1.total_cmp(&b.1)),
            worse_than_nothing: worse.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corruption::Corruption;
    use crate::eval::light_error::Decibel;
    use crate::eval::stability::CellRow;
    use crate::relight::RelightOptions;

    fn cell(way: &str, severity: u8, mses: &[(&str, f64)]) -> Cell {
        let rows = mses.iter().map(|(label, mse)| CellRow {
            label: (*label).to_owned(),
            linear_mse: *mse,
            linear_psnr_db: Decibel::from_mse(*mse),
            lights: 4,
            answered_fraction: 1.0,
        });
        Cell {
            way: way.to_owned(),
            severity,
            rows: rows.collect(),
            silent: Vec::new(),
            findings: Vec::new(),
            refused: mses.is_empty().then(|| "no depth".to_owned()),
        }
    }

    fn capture(name: &str, clean: Cell, spoiled: Vec<Cell>) -> CaptureCells {
        CaptureCells {
            capture: name.to_owned(),
            lights: vec![0],
            clean,
            spoiled,
        }
    }

    #[test]
    fn growth_is_of_the_same_captures_and_worse_than_nothing_is_where_the_mean_is() {
        let spoiling = Spoiling {
            ways: vec![Corruption::named("jpeg").unwrap()],
            severities: vec![3, 5],
            seed: 0,
            captures: 9,
            lights: 4,
        };
        // The second capture cannot be developed at severity 5.
        let captures = vec![
            capture(
                "a",
                cell("", 0, &[("1", 0.08), ("3", 0.01)]),
                vec![
                    cell("jpeg", 3, &[("1", 0.08), ("3", 0.02)]),
                    cell("jpeg", 5, &[("1", 0.08), ("3", 0.09)]),
                ],
            ),
            capture(
                "b",
                cell("", 0, &[("1", 0.02), ("3", 0.01)]),
                vec![
                    cell("jpeg", 3, &[("1", 0.02), ("3", 0.04)]),
                    cell("jpeg", 5, &[]),
                ],
            ),
        ];
        let roster = Roster::standing(RelightOptions::default());
        let report = StabilityReport::of(&spoiling, &roster, captures);
        let labels: Vec<&str> = report.growth.iter().map(|row| row.label.as_str()).collect();
        assert_eq!(labels, ["1", "3"]);
        let curve = &report.ways[0].rows[1];
        let figures: Vec<(u8, usize, f64, usize)> = curve
            .points
            .iter()
            .map(|point| {
                (
                    point.severity,
                    point.captures,
                    point.growth,
                    point.worse_captures,
                )
            })
            .collect();
        // Severity 3: 0.06 over 0.02, under the 0.10 of doing nothing though capture b is not;
        // severity 5: capture a alone.
        assert_eq!(figures[0], (0, 2, 1.0, 0));
        assert_eq!((figures[1].1, figures[1].3), (2, 1));
        assert!((figures[1].2 - 3.0).abs() < 1e-9);
        assert_eq!((figures[2].1, figures[2].3), (1, 1));
        assert!((figures[2].2 - 9.0).abs() < 1e-9);
        assert!((curve.points[1].mean_of_growths - 3.0).abs() < 1e-9);
        assert_eq!(curve.worse_than_nothing_from, Some(5));
        assert_eq!(report.ways[0].rows[0].worse_than_nothing_from, None);
        assert_eq!(
            (report.ways[0].refused, report.growth[1].worst),
            (1, Some(("jpeg", figures[1].2)))
        );
        assert_eq!(report.growth[1].worse_than_nothing, [("jpeg", 5)]);
    }
}
