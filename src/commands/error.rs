//! Why a command failed.

use super::client::ClientError;
use crate::{
    api::{Fault, FaultKind, LightError},
    calibration::CalibrationError,
    config::ConfigError,
    corruption::CorruptionError,
    costs::CostError,
    eval::{BesideError, EvalError, ReportError},
    folder::{FolderError, ImageError},
    inference::InferenceError,
    infrared::InfraredError,
    output::{CommitError, FilmError},
    radiometry::ResponseError,
    session::SessionError,
    store::StoreError,
};
use drivers::DriverError;
use std::path::PathBuf;
use thiserror::Error;

/// A file of the command line that cannot be used.
#[derive(Debug, Error)]
#[error("{path}: {problem}; {remedy}")]
pub struct InputError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong, with the field.
    pub problem: String,
    /// What to do.
    pub remedy: &'static str,
}

/// A result that cannot be written.
#[derive(Debug, Error)]
#[error("{path}: {problem}; {remedy}")]
pub struct ResultError {
    /// The file or folder.
    pub path: PathBuf,
    /// What happened.
    pub problem: String,
    /// What to do.
    pub remedy: &'static str,
}

/// Why a command failed; every message names the file, field or device.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "each is what its type says")]
pub enum CommandError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Light(#[from] LightError),
    #[error("{0}")]
    Arguments(String),
    #[error("{0}")]
    Damaged(String),
    #[error(transparent)]
    Image(#[from] ImageError),
    #[error(transparent)]
    Costs(#[from] CostError),
    #[error(transparent)]
    Inference(#[from] InferenceError),
    #[error(transparent)]
    Infrared(#[from] InfraredError),
    #[error(transparent)]
    Response(#[from] ResponseError),
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    #[error(transparent)]
    Corruption(#[from] CorruptionError),
    #[error(transparent)]
    Eval(#[from] EvalError),
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(transparent)]
    Beside(#[from] BesideError),
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Unwritten(FolderError),
    #[error(transparent)]
    Commit(#[from] CommitError),
    #[error(transparent)]
    Film(#[from] FilmError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Result(#[from] ResultError),
    #[error(transparent)]
    Device(#[from] DriverError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Client(#[from] ClientError),
}

impl CommandError {
    /// Which part failed, in which words.
    pub fn fault(&self) -> Fault {
        let kind = match self {
            Self::Light(_) | Self::Arguments(_) => FaultKind::Request,
            Self::Config(_)
            | Self::Input(_)
            | Self::Damaged(_)
            | Self::Folder(_)
            | Self::Image(_)
            | Self::Inference(_)
            | Self::Infrared(_)
            | Self::Response(_)
            | Self::Calibration(_)
            | Self::Corruption(_)
            | Self::Beside(_)
            | Self::Eval(_) => FaultKind::Input,
            Self::Result(_)
            | Self::Report(_)
            | Self::Unwritten(_)
            | Self::Film(_)
            | Self::Commit(_) => FaultKind::Output,
            Self::Costs(_) => FaultKind::Shot,
            Self::Device(error) => crate::session::kind_of(error),
            Self::Session(error) => return error.fault(),
            Self::Store(error) => return error.fault(),
            Self::Client(error) => return error.fault(),
        };
        Fault {
            kind,
            message: self.to_string(),
            remedy: None,
        }
    }
}
