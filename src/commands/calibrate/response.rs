//! `calibrate response`: the transfer curve of a camera, from one still scene at several exposures.

use super::super::{Answer, CommandError, error::InputError, progress::Progress};
use crate::{
    folder::{Limits, Samples, decode_limited},
    output::StagedFile,
    radiometry::recover_response,
};
use clap::Args;
use drivers::Plane;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `calibrate response`.
#[derive(Debug, Args)]
pub struct Response {
    /// The pictures: camera fixed, scene still, light constant, 8 bits per channel.
    #[arg(value_name = "IMAGE", required = true, num_args = 2..)]
    images: Vec<PathBuf>,
    /// Seconds × gain of each picture, in their order.
    #[arg(long, value_name = "S,S,…", value_delimiter = ',', required = true)]
    exposures: Vec<f32>,
    /// Write the curve here, as TOML, or as JSON for a name that ends in .json [default: print it].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// The file that is written.
#[derive(Serialize)]
struct Curve {
    /// Root mean square difference between seen and predicted values, in 8-bit codes.
    residual_codes: f32,
    /// Lowest and highest code with evidence.
    codes_seen: [u8; 2],
    /// As `transfer` of a color frame.
    transfer: drivers::Transfer,
}

impl Response {
    pub(super) fn run(self) -> Result<Answer, CommandError> {
        if self.images.len() != self.exposures.len() {
            return Err(CommandError::Arguments(format!(
                "--exposures has {} numbers for {} pictures; give one for each",
                self.exposures.len(),
                self.images.len()
            )));
        }
        let progress = Progress::of(self.images.len() + 1, "reading");
        let mut stack = Vec::with_capacity(self.images.len());
        for (path, exposure) in self.images.iter().zip(&self.exposures) {
            stack.push((*exposure, read(path)?));
            progress.step();
        }
        progress.doing("fitting");
        let found = recover_response(&stack)?;
        drop(progress);
        let curve = Curve {
            residual_codes: found.residual_codes,
            codes_seen: found.codes_seen,
            transfer: found.transfer,
        };
        let warnings = (curve.residual_codes > 3.0)
            .then(|| {
                format!(
                    "the curve misses the pictures by {:.1} of 255 codes; was the scene still and \
                     the light constant, and are the exposures right?",
                    curve.residual_codes
                )
            })
            .into_iter()
            .collect();
        let text = match &self.out {
            Some(out) => {
                write(out, &curve)?;
                let [low, high] = curve.codes_seen;
                format!(
                    "{}: curve with evidence from code {low} to {high}, residual {:.2} codes",
                    out.display(),
                    curve.residual_codes
                )
            }
            None => as_toml(&curve)?,
        };
        Ok(Answer::new(text, &curve).with_warnings(warnings))
    }
}

/// One picture of the stack.
fn read(path: &Path) -> Result<Plane<[u8; 3]>, CommandError> {
    match decode_limited(path, None, Limits::default())?.samples {
        Samples::Rgb8(plane) => Ok(plane),
        Samples::Gray8(plane) => Ok(plane.map(|value| [*value; 3])),
        other => Err(InputError {
            path: path.to_owned(),
            problem: format!("holds {}", other.describe()),
            remedy: "give 8-bit pictures: their curve is what is looked for",
        }
        .into()),
    }
}

fn as_toml(curve: &Curve) -> Result<String, CommandError> {
    toml::to_string(curve).map_err(|error| CommandError::Damaged(error.to_string()))
}

fn write(out: &Path, curve: &Curve) -> Result<(), CommandError> {
    let text = if out.extension().is_some_and(|kind| kind == "json") {
        serde_json::to_string_pretty(curve)
            .map_err(|error| CommandError::Damaged(error.to_string()))?
    } else {
        as_toml(curve)?
    };
    Ok(StagedFile::write(out, text.as_bytes())?)
}
