//! A shot that was taken becomes a folder: its frames, and its results where these were asked for.

use super::{SessionError, Taken};
use crate::{
    api::CheckedLights,
    darkroom::{self, Answering, Order, Source},
    output::{
        CommitError, Destination, FRAMES, Manifest, OutputError, Staging, manifest::MANIFEST,
    },
};
use drivers::{DriverError, Frame, recording::Writer};
use std::path::Path;

/// A shot that is safe on the disk.
#[derive(Debug, Clone)]
pub struct Kept {
    /// Names of all files.
    pub files: Vec<String>,
    /// What lowers the trust in the results.
    pub warnings: Vec<String>,
    /// What `shot.json` says.
    pub manifest: Manifest,
}

/// Writes the frames of a shot, and with `lights` what it looks like under them, to where `to` says;
/// by what `answering` says.
///
/// `observe` hears what is being done.
///
/// # Errors
/// [`SessionError::Darkroom`] when the shot cannot be developed; [`SessionError::Output`] when the
/// folder exists or cannot be written. Nothing is left behind then.
pub fn keep(
    taken: &Taken,
    lights: Option<&CheckedLights>,
    answering: &Answering,
    to: &Destination<'_>,
    observe: &mut dyn FnMut(&str),
) -> Result<Kept, SessionError> {
    let frames = recording_of(taken)?;
    let manifest = match lights {
        None => keep_frames(taken, &frames, to)?,
        Some(lights) => {
            let order = Order {
                shot: &taken.shot,
                source: Source {
                    name: &taken.info.address,
                    drops: Some(taken.drops),
                    burst: taken.burst.as_ref(),
                },
                lamps: &lights.lamps,
                environment: lights
                    .environment
                    .as_ref()
                    .map(|(name, environment)| (name.as_str(), environment)),
                answering,
                warnings: lights.warnings.clone(),
                attachments: &[(FRAMES, &frames)],
            };
            darkroom::print(&order, to, observe)?
        }
    };
    let files = manifest.files.iter().map(|file| file.name.clone());
    Ok(Kept {
        files: files.chain([MANIFEST.to_owned()]).collect(),
        warnings: manifest.warnings.clone(),
        manifest,
    })
}

/// The frames alone.
fn keep_frames(
    taken: &Taken,
    frames: &[u8],
    to: &Destination<'_>,
) -> Result<Manifest, SessionError> {
    let mut staging = Staging::begin(to.disk, to.folder, to.existing, |name| {
        name == FRAMES || name == MANIFEST
    })?
    .journaled()?;
    staging.put(FRAMES, frames)?;
    let (width, height) = taken.shot.flash.pixels.size();
    let manifest = Manifest {
        format: 1,
        program: concat!("captured ", env!("CARGO_PKG_VERSION")).to_owned(),
        source: taken.info.address.clone(),
        width,
        height,
        scale_known: taken.shot.rig.flash.intensity.is_some(),
        png_white: 1.0,
        timings_ms: Vec::new(),
        report: serde_json::json!({ "drops": taken.drops, "burst": taken.burst }),
        lights: Vec::new(),
        warnings: Vec::new(),
        files: staging.files().to_vec(),
        blake3: String::new(),
    };
    let (manifest, bytes) = manifest.seal().map_err(OutputError::from)?;
    staging.put(MANIFEST, &bytes)?;
    staging.commit()?;
    Ok(manifest)
}

/// A recording of the shot's own frames in the order of their exposure, so that the shot can be
/// developed again.
fn recording_of(taken: &Taken) -> Result<Vec<u8>, SessionError> {
    let shot = &taken.shot;
    let mut frames: Vec<Frame> = shot.ambient.iter().cloned().map(Frame::Color).collect();
    frames.push(Frame::Color(shot.flash.clone()));
    frames.push(Frame::Depth(shot.depth.clone()));
    frames.sort_by_key(Frame::at);

    let unwritten = |path: &Path, source| SessionError::from(CommitError::unwritten(path, source));
    let folder = tempfile::tempdir().map_err(|error| unwritten(&std::env::temp_dir(), error))?;
    let path = folder.path().join(FRAMES);
    let write = || {
        let mut writer = Writer::create(&path, &taken.info, &shot.rig, &taken.settings)?;
        for frame in &frames {
            writer.push(frame)?;
        }
        writer.close()
    };
    write().map_err(|error| match error {
        DriverError::Io { path, source } => unwritten(&path, source),
        other => other.into(),
    })?;
    std::fs::read(&path).map_err(|error| unwritten(&path, error))
}
