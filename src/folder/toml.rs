//! `capture.toml` and `lights.toml`: read, with the file's name in what is wrong with them.

use super::FolderError;
use drivers::rig_file::{self, Declared, RigToml, WrongField};
use serde::{Deserialize, de::DeserializeOwned};
use std::{io::Read as _, path::Path};

/// Far more than any capture needs; a larger file is not one.
const MAX_TOML_BYTES: u64 = 1 << 20;

/// All of `truth/lights.toml`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightsToml {
    #[serde(default)]
    pub scale: Scale,
    #[serde(default)]
    pub light: Vec<LightTable>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Scale {
    #[default]
    Known,
    Unknown,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightTable {
    pub direction: [f32; 3],
    pub image: String,
    pub shadow: Option<String>,
    pub intensity: Option<[f32; 3]>,
}

/// Reads and parses one TOML file.
pub(super) fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, FolderError> {
    let (file, bytes) = super::decode::open_regular(path)?;
    if bytes > MAX_TOML_BYTES {
        return Err(FolderError::Toml {
            path: path.into(),
            problem: format!("is {bytes} bytes, more than the {MAX_TOML_BYTES} allowed"),
        });
    }
    let mut text = String::new();
    file.take(MAX_TOML_BYTES)
        .read_to_string(&mut text)
        .map_err(|source| FolderError::Io {
            path: path.into(),
            source,
        })?;
    ::toml::from_str(&text).map_err(|error| FolderError::Toml {
        path: path.into(),
        problem: error.to_string().trim_end().to_owned(),
    })
}

/// Reads and checks a `capture.toml` or a `rig.toml`.
pub(super) fn declared(path: &Path) -> Result<Declared, FolderError> {
    let table = parse::<RigToml>(path)?;
    table.check().map_err(|wrong| Fields(path).named(wrong))
}

/// One file's fields being checked.
pub(super) struct Fields<'a>(pub &'a Path);

impl Fields<'_> {
    pub fn wrong(&self, field: &str, problem: impl Into<String>, remedy: &str) -> FolderError {
        FolderError::Field {
            path: self.0.into(),
            field: field.into(),
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    fn named(&self, wrong: WrongField) -> FolderError {
        self.wrong(&wrong.field, wrong.problem, &wrong.remedy)
    }

    pub fn finite(&self, field: &str, values: &[f64]) -> Result<(), FolderError> {
        rig_file::finite(field, values).map_err(|wrong| self.named(wrong))
    }

    pub fn positive(&self, field: &str, value: f64) -> Result<(), FolderError> {
        rig_file::positive(field, value).map_err(|wrong| self.named(wrong))
    }
}
