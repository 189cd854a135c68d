//! Rows of another report of some of the same captures, made with another backend: one process holds one.

use super::light_error::Decibel;
use super::report::Report;
use super::summary::RowSummary;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The largest report that is read, bytes.
const LARGEST_FILE: u64 = 1 << 30;

/// Why a report cannot stand beside another.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum BesideError {
    #[error("{}: {problem}; give the folder of a report that `capturectl eval --report` wrote", path.display())]
    Unreadable { path: PathBuf, problem: String },
    #[error(
        "{}: is a report of another capture, {capture}; make it of captures that stand here", path.display()
    )]
    OtherCapture { path: PathBuf, capture: String },
}

/// A row of networks as another backend ran it. Its answers are those of the row here: backends differ in
/// their time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OtherBackend {
    /// As in [`super::roster::Row::label`].
    pub label: String,
    /// What ran its networks.
    pub backend: String,
    /// Numbers that training set, all its networks together.
    pub parameters: u64,
    /// Mean over captures of the median milliseconds per relit picture.
    pub relight_ms: f64,
    /// Mean PSNR in linear light, of the row here.
    pub mean_db: Decibel,
    /// The lowest mean PSNR of a part of the hemisphere.
    pub worst_db: Decibel,
}

/// What is asked of the other report.
#[derive(Deserialize)]
struct Other {
    captures: Vec<Named>,
    rows: Vec<OtherRow>,
}

#[derive(Deserialize)]
struct Named {
    name: String,
}

#[derive(Deserialize)]
struct OtherRow {
    label: String,
    parameters: Option<u64>,
    backend: Option<String>,
    relight_ms: Option<f64>,
}

/// The rows of networks in the report in `folder`, of clean depth, that relight.
///
/// # Errors
/// [`BesideError`] when there is no such report, or one of a capture that `report` does not have.
pub fn other_backends(folder: &Path, report: &Report) -> Result<Vec<OtherBackend>, BesideError> {
    let path = folder.join("report.json");
    let unreadable = |problem: String| BesideError::Unreadable {
        path: path.clone(),
        problem,
    };
    let size = std::fs::metadata(&path).map_err(|error| unreadable(error.to_string()))?;
    if size.len() > LARGEST_FILE {
        return Err(unreadable(format!("has over {LARGEST_FILE} bytes")));
    }
    let text = std::fs::read(&path).map_err(|error| unreadable(error.to_string()))?;
    let other: Other =
        serde_json::from_slice(&text).map_err(|error| unreadable(error.to_string()))?;
    let here = report.capture_names();
    if let Some(other) = other
        .captures
        .iter()
        .find(|one| !here.contains(&one.name.as_str()))
    {
        return Err(BesideError::OtherCapture {
            path,
            capture: other.name.clone(),
        });
    }
    let rows = other.rows.into_iter().filter_map(|row| {
        let same =
            |here: &&RowSummary| here.label == row.label && here.parameters == row.parameters;
        let here = report.rows.iter().find(same)?;
        let figures = here.figures.present()?;
        let one = OtherBackend {
            backend: row.backend?,
            parameters: row.parameters?,
            relight_ms: row.relight_ms?,
            mean_db: figures.mean?.linear_psnr_db,
            worst_db: figures.worst_direction?.linear_psnr_db,
            label: row.label,
        };
        let elsewhere = here.backend.as_ref() != Some(&one.backend);
        (one.parameters > 0 && elsewhere).then_some(one)
    });
    Ok(rows.collect())
}
