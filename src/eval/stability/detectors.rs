//! How well what a shot says about itself tells harmed captures from clean ones.

use super::{CaptureCells, Cell, Spoiling};
use crate::eval::auroc::auroc;
use serde::Serialize;

/// The row that harm is measured by: the closed form.
const HARMED_ROW: &str = "3";
/// Harmed: its mean squared error above so many times that of the capture as it came.
pub const HARMED_GROWTH: f64 = 1.1;
/// A finding of this score says that the shot is harmed.
const ALARM: f32 = 1.0;

/// One failure mode's finding, held against the corruption of its name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Detector {
    /// Name of the finding and of the corruption.
    pub mode: &'static str,
    /// Captures made worse by it, at any severity, that were harmed.
    pub harmed: usize,
    /// Captures made worse by it that were not: they count on neither side.
    pub unharmed: usize,
    /// Captures as they came.
    pub clean: usize,
    /// Area under the ROC curve of the score between harmed and clean ones; `None` where nothing was
    /// harmed.
    pub auroc: Option<f64>,
    /// Fraction of the harmed ones that the finding calls harmful.
    pub found: Option<f64>,
    /// Fraction of the clean ones that it calls harmful.
    pub false_alarms: Option<f64>,
}

impl Detector {
    /// One for every way asked for.
    pub(super) fn all(spoiling: &Spoiling, captures: &[CaptureCells]) -> Vec<Self> {
        let ways = spoiling.ways.iter();
        ways.map(|way| Self::of(way.name, captures)).collect()
    }

    fn of(mode: &'static str, captures: &[CaptureCells]) -> Self {
        let (mut harmed, mut clean, mut unharmed) = (Vec::new(), Vec::new(), 0);
        for capture in captures {
            clean.extend(capture.clean.score(mode));
            let Some(before) = capture.clean.mse(HARMED_ROW) else {
                continue;
            };
            for cell in capture.spoiled.iter().filter(|cell| cell.way == mode) {
                match (cell.mse(HARMED_ROW), cell.score(mode)) {
                    (Some(mse), Some(score)) if mse > HARMED_GROWTH * before => harmed.push(score),
                    (Some(_), Some(_)) => unharmed += 1,
                    _ => {}
                }
            }
        }
        let alarms = |scores: &[f32]| {
            let loud = scores.iter().filter(|score| **score >= ALARM).count();
            (!scores.is_empty()).then(|| loud as f64 / scores.len() as f64)
        };
        Self {
            mode,
            auroc: auroc(&harmed, &clean),
            found: alarms(&harmed),
            false_alarms: alarms(&clean),
            harmed: harmed.len(),
            unharmed,
            clean: clean.len(),
        }
    }
}

impl Cell {
    /// The score of the finding of this name.
    fn score(&self, mode: &str) -> Option<f32> {
        let mut findings = self.findings.iter();
        let finding = findings.find(|finding| finding.mode == mode)?;
        Some(finding.score)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corruption::Corruption;
    use crate::eval::light_error::Decibel;
    use crate::eval::stability::{CellFinding, CellRow};

    fn cell(way: &str, severity: u8, mse: f64, score: f32) -> Cell {
        Cell {
            way: way.to_owned(),
            severity,
            rows: vec![CellRow {
                label: HARMED_ROW.to_owned(),
                linear_mse: mse,
                linear_psnr_db: Decibel::from_mse(mse),
                lights: 1,
                answered_fraction: 1.0,
            }],
            silent: Vec::new(),
            refused: None,
            findings: vec![CellFinding {
                mode: "jpeg".to_owned(),
                score,
            }],
        }
    }

    #[test]
    fn only_what_was_harmed_must_be_told_from_clean() {
        let spoiling = Spoiling {
            ways: vec![Corruption::named("jpeg").unwrap()],
            severities: vec![1, 3, 5],
            seed: 0,
            captures: 2,
            lights: 1,
        };
        let capture = |clean: Cell, spoiled| CaptureCells {
            capture: "a".to_owned(),
            lights: vec![0],
            clean,
            spoiled,
        };
        let captures = [
            capture(
                cell("", 0, 0.010, 0.2),
                // Grown by 5 %: not harmed, though the finding is loud.
                vec![
                    cell("jpeg", 1, 0.0105, 9.0),
                    cell("jpeg", 3, 0.02, 0.6),
                    cell("jpeg", 5, 0.04, 3.0),
                ],
            ),
            capture(cell("", 0, 0.010, 1.5), vec![cell("mirror", 5, 0.9, 9.0)]),
        ];
        let found = Detector::all(&spoiling, &captures);
        // Harmed 0.6 and 3.0, clean 0.2 and 1.5: three of four pairs are in order.
        assert_eq!(
            found,
            [Detector {
                mode: "jpeg",
                harmed: 2,
                unharmed: 1,
                clean: 2,
                auroc: Some(0.75),
                found: Some(0.5),
                false_alarms: Some(0.5),
            }]
        );
    }
}
