//! `info`: what a capture folder, a recording or a folder of results holds.

use super::{Answer, CommandError, input::Kind, progress::Progress};
use crate::{folder, output::manifest::Manifest};
use clap::Args;
use drivers::{Distortion, Rig, recording};
use std::path::{Path, PathBuf};

/// Arguments of `info`.
#[derive(Debug, Args)]
pub struct Info {
    /// A capture folder, a recording (.mcap) or a folder of results.
    #[arg(value_name = "PATH")]
    path: PathBuf,
}

impl Info {
    /// Reads all of it, so that what is damaged is found.
    pub(super) fn run(self) -> Result<Answer, CommandError> {
        let kind = Kind::of(&self.path)?;
        let _progress = Progress::of_unknown("reading all of it");
        match kind {
            Kind::Results => results(&self.path),
            Kind::Capture => capture(&self.path),
            Kind::Recording => recorded(&self.path),
        }
    }
}

fn results(path: &Path) -> Result<Answer, CommandError> {
    let manifest =
        Manifest::verify(path).map_err(|error| CommandError::Damaged(error.to_string()))?;
    let mut lines = vec![
        format!("{}: results, every file as it was written", path.display()),
        format!("  from       {} by {}", manifest.source, manifest.program),
        format!("  size       {}×{}", manifest.width, manifest.height),
    ];
    lines.extend(
        manifest
            .lights
            .iter()
            .map(|light| format!("  light      {:?} → {}", light.direction, light.relit_png)),
    );
    lines.extend(
        manifest
            .timings_ms
            .iter()
            .map(|(stage, ms)| format!("  {stage:<10} {ms:.1} ms")),
    );
    let json = serde_json::json!({ "kind": "results", "results": manifest });
    Ok(Answer::new(lines.join("\n"), &json).with_warnings(manifest.warnings))
}

fn capture(path: &Path) -> Result<Answer, CommandError> {
    let capture = folder::read(path)?;
    let shot = &capture.shot;
    let lights = capture.truth.as_ref().map_or(0, |truth| truth.lights.len());
    let answered = shot
        .depth
        .metres
        .samples()
        .iter()
        .filter(|metres| !metres.is_nan())
        .count();
    let answered = answered as f64 / shot.depth.metres.len().max(1) as f64;
    let mut lines = vec![format!("{}: capture folder", path.display())];
    lines.extend(rig_lines(&shot.rig));
    lines.push(format!("  ambient    {} photographs", shot.ambient.len()));
    lines.push(format!("  depth      {:.1} % answered", 100.0 * answered));
    lines.push(format!("  truth      {lights} lights"));
    let json = serde_json::json!({
        "kind": "capture",
        "name": capture.name,
        "rig": shot.rig,
        "ambient_frames": shot.ambient.len(),
        "depth_answered_fraction": answered,
        "amplitude": shot.depth.amplitude.is_some(),
        "mask": shot.mask.is_some(),
        "truth_lights": lights,
    });
    Ok(Answer::new(lines.join("\n"), &json))
}

fn recorded(path: &Path) -> Result<Answer, CommandError> {
    let summary = recording::summarize(path)?;
    let (color, depth) = (summary.color_size, summary.depth_size);
    let lines = [
        format!(
            "{}: recording of {}",
            path.display(),
            summary.device.address
        ),
        format!("  model      {}", summary.device.model),
        format!(
            "  color      {}×{}, {} ambient and {} flash frames, {} lost",
            color.0, color.1, summary.ambient_frames, summary.flash_frames, summary.color_gaps
        ),
        format!(
            "  depth      {}×{}, {} frames, {} lost",
            depth.0, depth.1, summary.depth_frames, summary.depth_gaps
        ),
        format!(
            "  length     {:.3} s, {} bytes",
            summary.duration_seconds, summary.bytes
        ),
    ];
    let warnings = summary.truncated_at.map(|byte| {
        format!(
            "{}: cut at byte {byte}; what stands before is whole and can be used",
            path.display()
        )
    });
    let json = serde_json::json!({ "kind": "recording", "recording": summary });
    Ok(Answer::new(lines.join("\n"), &json).with_warnings(warnings.into_iter().collect()))
}

fn rig_lines(rig: &Rig) -> Vec<String> {
    let lens = |lens: &drivers::Intrinsics| {
        let model = match lens.distortion {
            Distortion::None {} => "no distortion",
            Distortion::BrownConrady { .. } => "Brown–Conrady",
            Distortion::Rational { .. } => "rational distortion",
        };
        format!(
            "{}×{}, focal length {:.1} pixels, {model}",
            lens.width, lens.height, lens.fx
        )
    };
    vec![
        format!("  color      {}", lens(&rig.color)),
        match &rig.depth {
            Some(depth) => format!("  depth      {}", lens(&depth.lens)),
            None => "  depth      on the color grid".to_owned(),
        },
        match rig.flash.intensity {
            Some(intensity) => format!("  flash      intensity {intensity}"),
            None => "  flash      of unknown intensity".to_owned(),
        },
    ]
}
