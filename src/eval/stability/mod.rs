//! The stability run: captures made worse on purpose, and what each row loses by it.

mod detectors;
mod figures;
mod trial;
mod words;

pub use detectors::{Detector, HARMED_GROWTH};
pub use figures::{COMPARED, CurvePoint, RowCurve, RowGrowth, StabilityReport, WayReport};
pub(super) use trial::{Asked, measure};
pub(super) use words::csv;

use super::light_error::Decibel;
use super::report::SilentRow;
use crate::corruption::Corruption;
use serde::{Deserialize, Serialize};

/// Which captures are made worse, how, and under how many lights they are compared.
#[derive(Debug, Clone)]
pub struct Spoiling {
    /// The ways, each at most once.
    pub ways: Vec<&'static Corruption>,
    /// Severities, ascending, each once, 1 to [`crate::corruption::MOST_SEVERE`].
    pub severities: Vec<u8>,
    /// Of the dice; each capture's own follow from it and the capture's name.
    pub seed: u64,
    /// At most so many of the captures that have true pictures, evenly over those given.
    pub captures: usize,
    /// At most so many lights of each, one from each of as many equal parts by angle off the axis.
    pub lights: usize,
}

/// One capture in every state it was brought into.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaptureCells {
    /// Name of the capture.
    pub capture: String,
    /// Indices of the lights compared, in the order of their angle off the axis.
    pub lights: Vec<usize>,
    /// As it came.
    pub clean: Cell,
    /// Made worse, way by way, severity by severity.
    pub spoiled: Vec<Cell>,
}

/// One capture in one state, through every row that answers here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Name of the corruption; empty for the capture as it came.
    pub way: String,
    /// Its severity; 0 for the capture as it came.
    pub severity: u8,
    /// The rows that answered.
    pub rows: Vec<CellRow>,
    /// The rows that did not.
    pub silent: Vec<SilentRow>,
    /// What the shot says about itself.
    pub findings: Vec<CellFinding>,
    /// Why nothing could be measured: the way does not exist for this capture, or what it leaves
    /// cannot be developed.
    pub refused: Option<String>,
}

/// One finding of [`crate::verdict`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellFinding {
    /// Name of the failure mode.
    pub mode: String,
    /// How strong it is; 1 and more = harmful.
    pub score: f32,
}

/// One row's pictures of one cell, means over the lights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellRow {
    /// As in [`super::roster::Row::label`].
    pub label: String,
    /// Mean squared error in linear light.
    pub linear_mse: f64,
    /// PSNR in linear light, the mean of the lights' own.
    pub linear_psnr_db: Decibel,
    /// Lights it answered.
    pub lights: usize,
    /// Fraction of the pixels with a truth that it answered.
    pub answered_fraction: f64,
}

impl Cell {
    /// The mean squared error of the row of this label.
    fn mse(&self, label: &str) -> Option<f64> {
        let row = self.rows.iter().find(|row| row.label == label)?;
        Some(row.linear_mse)
    }
}
