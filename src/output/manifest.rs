//! `shot.json`: where results came from, how far to trust them, and a BLAKE3 of every file.

use super::{
    commit::FileEntry,
    file_system::{Disk, FileSystem},
};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeSet,
    io::Read as _,
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Name of the manifest in its folder.
pub const MANIFEST: &str = "shot.json";
/// The only format there is.
const FORMAT: u32 = 1;
/// Far more than any manifest needs.
const MAX_BYTES: u64 = 16 << 20;

/// One light and the files made for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightEntry {
    /// Unit vector toward the light: x right, y up, z toward the camera; zero for an environment,
    /// whose light comes from everywhere.
    pub direction: [f32; 3],
    /// What the light is called.
    pub label: String,
    /// Scene-linear picture.
    pub relit_exr: String,
    /// sRGB picture.
    pub relit_png: String,
    /// 0 = shadow.
    pub shadow_png: String,
}

/// All of `shot.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// 1.
    pub format: u32,
    /// Program and version that wrote the folder.
    pub program: String,
    /// Where the shot came from.
    pub source: String,
    /// Pixels per row of every picture.
    pub width: usize,
    /// Rows of every picture.
    pub height: usize,
    /// False when albedo and relit light are right up to one global scale only.
    pub scale_known: bool,
    /// Scene-linear light that became white in the PNG pictures.
    pub png_white: f32,
    /// Milliseconds per stage, in the order they ran.
    pub timings_ms: Vec<(String, f64)>,
    /// What the stages found: confidences, fractions, terms used.
    pub report: serde_json::Value,
    /// One entry per light, in the order asked for.
    pub lights: Vec<LightEntry>,
    /// What to know before trusting the pictures, in plain words.
    pub warnings: Vec<String>,
    /// Every other file of the folder.
    pub files: Vec<FileEntry>,
    /// BLAKE3 of this manifest, written with this field empty.
    pub blake3: String,
}

/// Why a folder of results is not whole.
#[derive(Debug, Error)]
pub enum ManifestError {
    /// A file is missing or cannot be read.
    #[error("{path}: {source}; the folder is incomplete, make it again")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// Not a manifest.
    #[error("{path}: {problem}; the folder is damaged, make it again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

impl Manifest {
    /// The bytes of `shot.json`, with the manifest's own hash filled in.
    ///
    /// # Errors
    /// [`serde_json::Error`] when the report holds what JSON cannot.
    pub fn seal(mut self) -> Result<(Self, Vec<u8>), serde_json::Error> {
        self.format = FORMAT;
        self.blake3 = String::new();
        // `blake3` is the last field, so the text ends with its empty quotes and a brace.
        let blank = serde_json::to_string_pretty(&self)?;
        self.blake3 = blake3::hash(blank.as_bytes()).to_hex().to_string();
        let text = serde_json::to_string_pretty(&self)?
            + "
";
        Ok((self, text.into_bytes()))
    }

    /// True when `text` is what [`Self::seal`] wrote.
    fn is_sealed(&self, text: &str) -> bool {
        let tail = format!("\"blake3\": \"{}\"\n}}\n", self.blake3);
        text.strip_suffix(&tail).is_some_and(|body| {
            let blank = format!("{body}\"blake3\": \"\"\n}}");
            blake3::hash(blank.as_bytes()).to_hex().as_str() == self.blake3
        })
    }

    /// Reads a folder's manifest and checks every file against it.
    ///
    /// # Errors
    /// [`ManifestError::Io`] for a missing file, [`ManifestError::Damaged`] for one that is not
    /// what was written.
    pub fn verify(dir: &Path) -> Result<Self, ManifestError> {
        let manifest = Self::read(&Disk, dir)?;
        manifest.verify_files(&Disk, dir)?;
        Ok(manifest)
    }

    /// Reads a folder's manifest and checks it against itself, but not the files it lists.
    ///
    /// # Errors
    /// As [`Self::verify`].
    pub fn read(disk: &dyn FileSystem, dir: &Path) -> Result<Self, ManifestError> {
        let path = dir.join(MANIFEST);
        let io = |source| ManifestError::Io {
            path: path.clone(),
            source,
        };
        let damaged = |problem: String| ManifestError::Damaged {
            path: path.clone(),
            problem,
        };
        let (bytes, file) = disk.open(&path).map_err(io)?;
        if bytes > MAX_BYTES {
            return Err(damaged(format!("{bytes} bytes are more than {MAX_BYTES}")));
        }
        let mut text = String::new();
        file.take(MAX_BYTES).read_to_string(&mut text).map_err(io)?;
        let manifest: Self =
            serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))?;
        if manifest.format != FORMAT {
            return Err(damaged(format!("format is {}", manifest.format)));
        }
        if !manifest.is_sealed(&text) {
            return Err(damaged("blake3 of the manifest itself differs".into()));
        }
        let mut seen = BTreeSet::new();
        for entry in &manifest.files {
            if Path::new(&entry.name)
                .file_name()
                .is_none_or(|name| name != entry.name.as_str())
            {
                return Err(damaged(format!(
                    "files names {:?}, outside the folder",
                    entry.name
                )));
            }
            if !seen.insert(&entry.name) {
                return Err(damaged(format!("files names {:?} twice", entry.name)));
            }
        }
        Ok(manifest)
    }

    /// Checks every file of `dir` against what the manifest states of it.
    ///
    /// # Errors
    /// As [`Self::verify`].
    pub fn verify_files(&self, disk: &dyn FileSystem, dir: &Path) -> Result<(), ManifestError> {
        for entry in &self.files {
            let path = dir.join(&entry.name);
            match entry.is_whole(disk, dir) {
                Ok(true) => {}
                Ok(false) => {
                    let problem = "blake3 differs from the one in shot.json".into();
                    return Err(ManifestError::Damaged { path, problem });
                }
                Err(source) => return Err(ManifestError::Io { path, source }),
            }
        }
        Ok(())
    }
}
