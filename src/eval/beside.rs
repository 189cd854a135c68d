//! Rows of another report of the same captures, made with another backend: one process holds one.

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
        "{}: is a report of other captures ({found} of them, {expected} here); make it of the same ones", path.display()
    )]
    OtherCaptures {
        path: PathBuf,
        found: usize,
        expected: usize,
    },
}

/// A row of networks as another backend ran it.
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
    /// Mean PSNR in linear light.
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
    mean: Option<Mean>,
    worst_direction: Option<Mean>,
    relight_ms: Option<f64>,
}

#[derive(Deserialize)]
struct Mean {
    linear_psnr_db: Decibel,
}

/// The rows of networks in the report in `folder`, of clean depth, that relight.
///
/// # Errors
/// [`BesideError`] when there is no such report, or one of other captures than `report`'s.
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
    let names: Vec<&str> = other.captures.iter().map(|one| one.name.as_str()).collect();
    if names != report.capture_names() {
        return Err(BesideError::OtherCaptures {
            path: path.clone(),
            found: names.len(),
            expected: report.captures.len(),
        });
    }
    let rows = other.rows.into_iter().filter_map(|row| {
        let one = OtherBackend {
            label: row.label,
            backend: row.backend?,
            parameters: row.parameters?,
            relight_ms: row.relight_ms?,
            mean_db: row.mean?.linear_psnr_db,
            worst_db: row.worst_direction?.linear_psnr_db,
        };
        let same = |here: &RowSummary| {
            here.label == one.label && here.backend.as_ref() == Some(&one.backend)
        };
        (one.parameters > 0 && !report.rows.iter().any(same)).then_some(one)
    });
    Ok(rows.collect())
}
