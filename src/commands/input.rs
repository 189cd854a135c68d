//! A path of the command line becomes a capture: a folder, or the first shot of a recording.

use super::{CommandError, error::InputError};
use crate::{
    config::Config,
    folder::{self, Capture, read_mask_beside, read_truth, truth_beside},
    output::{FRAMES, manifest::MANIFEST},
    session,
    shot::{DropCounts, Shot},
};
use drivers::replay::Replay;
use std::path::Path;

/// Metres of one step of a PNG depth in the truth beside a recording.
const TRUTH_DEPTH_UNIT_METRES: f64 = 0.001;

/// What a path can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Capture,
    Recording,
    Results,
}

impl Kind {
    /// Looks at the path, not yet into the files.
    pub fn of(path: &Path) -> Result<Self, InputError> {
        let found = std::fs::metadata(path).map_err(|error| InputError {
            path: path.to_owned(),
            problem: format!("cannot be read: {error}"),
            remedy: "name a capture folder, a recording or a folder of results",
        })?;
        Ok(if !found.is_dir() {
            Self::Recording
        } else if path.join(MANIFEST).is_file() {
            Self::Results
        } else {
            Self::Capture
        })
    }
}

/// A capture and the frames that did not become part of it.
#[derive(Debug)]
pub(super) struct Input {
    pub capture: Capture,
    /// `None` for a folder, whose frames are not put together.
    pub drops: Option<DropCounts>,
}

/// Reads a capture folder, or the first shot of a recording with the mask and the truth that lie
/// beside it, or the frames that a shot kept of itself.
pub(super) fn read(path: &Path, config: &Config) -> Result<Input, CommandError> {
    match Kind::of(path)? {
        Kind::Capture => Ok(Input {
            capture: folder::read(path)?,
            drops: None,
        }),
        Kind::Recording => play(path, config),
        Kind::Results => {
            let frames = path.join(FRAMES);
            if !frames.is_file() {
                return Err(InputError {
                    path: frames,
                    problem: "missing: these results do not hold the frames they were made from"
                        .to_owned(),
                    remedy: "name the capture or recording that shot.json gives as their source",
                }
                .into());
            }
            play(&frames, config)
        }
    }
}

fn play(path: &Path, config: &Config) -> Result<Input, CommandError> {
    let mut replay = Replay::open(path)?;
    let taken = session::take(&mut replay, &config.capture, None)?;
    let size = taken.shot.rig.color.size();
    let mask = read_mask_beside(path, size)?;
    let truth = read_truth(&truth_beside(path), size, TRUTH_DEPTH_UNIT_METRES)?;
    let name = path
        .file_stem()
        .map_or_else(|| "recording".into(), |name| name.to_string_lossy());
    Ok(Input {
        capture: Capture {
            name: name.into_owned(),
            shot: Shot { mask, ..taken.shot },
            truth,
        },
        drops: Some(taken.drops),
    })
}
