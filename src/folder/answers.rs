//! Answers made elsewhere: a folder in the layout of `capturectl relight`'s results, read when asked.

use super::{FolderError, images};
use crate::radiometry::LinearImage;
use drivers::Plane;
use glam::Vec3;
use serde::Deserialize;
use std::{
    io::Read as _,
    path::{Path, PathBuf},
};

/// Name of the file that says how long each picture took.
const TIMES: &str = "times.json";
/// Far more than the times of any number of lights need.
const MAX_TIMES_BYTES: u64 = 1 << 20;

/// All of `times.json`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Times {
    /// One entry per light, in their order; null = not measured.
    milliseconds: Vec<Option<f64>>,
}

/// What somebody answered for one capture: `relit_NNN.exr`, `shadow_NNN.png`, `albedo.exr`,
/// `normal.exr`, `roughness.exr` and `times.json`, each of which may be missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Answers {
    dir: PathBuf,
    size: (usize, usize),
    milliseconds: Vec<Option<f64>>,
}

impl Answers {
    /// Looks into `dir`, the folder of a capture with a photograph of `size` pixels and a truth of
    /// `lights` lights; `Ok(None)` when there is no such folder.
    ///
    /// # Errors
    /// [`FolderError::Io`] for what is no folder or cannot be read, [`FolderError::Field`] for a
    /// `times.json` that is none.
    pub fn read(
        dir: &Path,
        size: (usize, usize),
        lights: usize,
    ) -> Result<Option<Self>, FolderError> {
        let io = |source| FolderError::Io {
            path: dir.into(),
            source,
        };
        match dir.metadata() {
            Ok(metadata) if metadata.is_dir() => {}
            Ok(_) => return Err(io(std::io::ErrorKind::NotADirectory.into())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(io(source)),
        }
        Ok(Some(Self {
            dir: dir.into(),
            size,
            milliseconds: times(&dir.join(TIMES), lights)?,
        }))
    }

    /// The picture under one light: scene-linear, white Lambertian = 1; NaN = no answer.
    ///
    /// # Errors
    /// [`FolderError::Image`] for a file that cannot be decoded or has another size.
    pub fn relit(&self, light: usize) -> Result<Option<LinearImage>, FolderError> {
        let file = self.file(&format!("relit_{light:03}"), "exr")?;
        let plane = file.map(|path| images::linear(&path, self.size));
        Ok(plane.transpose()?.map(LinearImage))
    }

    /// The cast shadow of one light: 0 = shadow, 1 = lit.
    ///
    /// # Errors
    /// As [`Self::relit`]; [`FolderError::Field`] for more than one channel.
    pub fn shadow(&self, light: usize) -> Result<Option<Plane<f32>>, FolderError> {
        let file = self.file(&format!("shadow_{light:03}"), "png")?;
        file.map(|path| images::data(&path, self.size)).transpose()
    }

    /// Diffuse albedo, linear; NaN = no answer.
    ///
    /// # Errors
    /// As [`Self::relit`].
    pub fn albedo(&self) -> Result<Option<LinearImage>, FolderError> {
        let file = self.file("albedo", "exr")?;
        let plane = file.map(|path| images::linear(&path, self.size));
        Ok(plane.transpose()?.map(LinearImage))
    }

    /// Unit normals in camera axes (x right, y down, z forward); NaN = no answer.
    ///
    /// # Errors
    /// As [`Self::relit`]; [`FolderError::Field`] for a file without three channels.
    pub fn normal(&self) -> Result<Option<Plane<Vec3>>, FolderError> {
        let file = self.file("normal", "exr")?;
        file.map(|path| images::normals(&path, self.size))
            .transpose()
    }

    /// Karis roughness; NaN = no answer.
    ///
    /// # Errors
    /// As [`Self::shadow`].
    pub fn roughness(&self) -> Result<Option<Plane<f32>>, FolderError> {
        let file = self.file("roughness", "exr")?;
        file.map(|path| images::data(&path, self.size)).transpose()
    }

    /// How long the picture under one light took, where that was measured.
    pub fn milliseconds(&self, light: usize) -> Option<f64> {
        self.milliseconds.get(light).copied().flatten()
    }

    fn file(&self, stem: &str, extension: &str) -> Result<Option<PathBuf>, FolderError> {
        images::find(&self.dir, stem, &[extension])
    }
}

/// The times of a capture with so many lights; none where the file is missing.
fn times(path: &Path, lights: usize) -> Result<Vec<Option<f64>>, FolderError> {
    let io = |source| FolderError::Io {
        path: path.into(),
        source,
    };
    let file = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(io(source)),
    };
    let wrong = |field: &str, problem: String| FolderError::Field {
        path: path.into(),
        field: field.into(),
        problem,
        remedy:
            "write {\"milliseconds\": [12.5, null, …]}, one entry per light, or remove the file"
                .into(),
    };
    let mut text = String::new();
    let read = file.take(MAX_TIMES_BYTES + 1).read_to_string(&mut text);
    match read {
        Ok(bytes) if bytes as u64 > MAX_TIMES_BYTES => {
            let problem = format!("is larger than {MAX_TIMES_BYTES} bytes");
            return Err(wrong("its size", problem));
        }
        Ok(_) => {}
        Err(source) => return Err(io(source)),
    }
    let Times { milliseconds } = serde_json::from_str(&text)
        .map_err(|error| wrong("its text", format!("is not as expected: {error}")))?;
    if milliseconds.len() != lights {
        let problem = format!(
            "has {} entries but the capture has {lights} lights",
            milliseconds.len()
        );
        return Err(wrong("milliseconds", problem));
    }
    let bad = |ms: &&f64| !ms.is_finite() || **ms < 0.0;
    if let Some(bad) = milliseconds.iter().flatten().find(bad) {
        return Err(wrong("milliseconds", format!("holds {bad}")));
    }
    Ok(milliseconds)
}
