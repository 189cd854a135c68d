//! A folder of results: every file the README names, or none.

use super::{
    EncodeError, Precision,
    commit::{CommitError, Existing, Staging},
    exr,
    file_system::FileSystem,
    manifest::{LightEntry, MANIFEST, Manifest},
    png,
    sheet::{self, Panel},
    tone::Tone,
};
use crate::{radiometry::LinearImage, scene::Scene};
use drivers::Plane;
use rayon::prelude::*;
use std::{borrow::Cow, path::Path};
use thiserror::Error;

/// Name of the recording of a shot's own frames, beside its results.
pub const FRAMES: &str = "shot.mcap";

/// The photograph under one light, as it is to be written.
#[derive(Debug, Clone, Copy)]
pub struct RelitView<'a> {
    /// Unit vector toward the light: x right, y up, z toward the camera.
    pub toward_person: [f32; 3],
    /// What the light is called.
    pub label: &'a str,
    /// Scene-linear light; NaN = unknown.
    pub relit: &'a LinearImage,
    /// 0 = shadow, 1 = lit; NaN = unknown.
    pub shadow: &'a Plane<f32>,
}

/// Everything that goes into a folder of results.
#[derive(Debug, Clone)]
pub struct Results<'a> {
    /// Where the shot came from, for people.
    pub source: &'a str,
    /// What comes first on the contact sheet: the photographs as they were taken. Made small by the
    /// caller, one after the other: at 12 megapixels each takes 144 MB in light.
    pub photographs: &'a [Panel],
    /// The light of the flash alone, on the color grid.
    pub flash_only: &'a LinearImage,
    /// Surfaces; on a smaller working grid they are stretched to the color grid.
    pub scene: &'a Scene,
    /// One entry per light, in the order asked for.
    pub relit: &'a [RelitView<'a>],
    /// Milliseconds per stage.
    pub timings_ms: &'a [(String, f64)],
    /// What the stages found.
    pub report: serde_json::Value,
    /// What to know before trusting the pictures, in plain words.
    pub warnings: &'a [String],
    /// Further files, as they are: name and contents.
    pub attachments: &'a [(&'a str, &'a [u8])],
}

/// Why no results were written; nothing is left behind.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The folder could not be written.
    #[error(transparent)]
    Commit(#[from] CommitError),
    /// A picture could not be encoded.
    #[error("{name}: {source}")]
    Encode {
        /// The file.
        name: String,
        /// The cause.
        source: EncodeError,
    },
    /// The report holds what JSON cannot.
    #[error("shot.json: {0}; leave numbers that are not finite out of the report")]
    Manifest(#[from] serde_json::Error),
}

/// True for the names this module gives to files.
fn is_ours(name: &str) -> bool {
    const FIXED: [&str; 7] = [
        FRAMES,
        "albedo.exr",
        "normal.exr",
        "roughness.exr",
        "depth.exr",
        "overview.png",
        MANIFEST,
    ];
    let numbered = |prefix: &str, extension: &str| {
        let middle = name
            .strip_prefix(prefix)
            .and_then(|rest| rest.strip_suffix(extension));
        middle.is_some_and(|digits| {
            digits.len() >= 3 && digits.bytes().all(|byte| byte.is_ascii_digit())
        })
    };
    FIXED.contains(&name)
        || numbered("relit_", ".exr")
        || numbered("relit_", ".png")
        || numbered("shadow_", ".png")
}

/// Writes `relit_000.exr`, `relit_000.png`, `shadow_000.png` … per light, `albedo.exr`,
/// `normal.exr`, `roughness.exr`, `depth.exr`, `overview.png` and `shot.json` into `dir`, which
/// appears when all of them are on disk.
///
/// Relit light and albedo are half floats where these are exact to 1 part in 2048 (see
/// [`Precision::for_light`]), normals and roughness half floats, depth full floats. One file is
/// encoded at a time, so memory stays at one encoded picture.
///
/// # Errors
/// [`OutputError::Commit`] when the folder exists, cannot be written or the disk is full;
/// [`OutputError::Encode`] for pictures without pixels.
pub fn write(
    results: &Results<'_>,
    dir: &Path,
    existing: Existing,
    disk: &dyn FileSystem,
) -> Result<Manifest, OutputError> {
    let size = results.flash_only.0.size();
    let scene = results.scene;
    let tone = if scene.scale_known {
        Tone::absolute()
    } else {
        Tone::robust(results.relit.iter().map(|view| &view.relit.0))
    };
    let mut staging = Staging::begin(disk, dir, existing, is_ours)?.journaled()?;
    let mut put = |name: &str, bytes: Result<Vec<u8>, EncodeError>| {
        let bytes = bytes.map_err(|source| OutputError::Encode {
            name: name.into(),
            source,
        })?;
        staging.put(name, &bytes).map_err(OutputError::from)
    };

    for (name, bytes) in results.attachments {
        put(name, Ok(bytes.to_vec()))?;
    }
    let mut lights = Vec::with_capacity(results.relit.len());
    for (number, view) in results.relit.iter().enumerate() {
        let entry = LightEntry {
            direction: view.toward_person,
            label: view.label.into(),
            relit_exr: format!("relit_{number:03}.exr"),
            relit_png: format!("relit_{number:03}.png"),
            shadow_png: format!("shadow_{number:03}.png"),
        };
        let precision = Precision::for_light(&view.relit.0);
        put(&entry.relit_exr, exr::rgb(&view.relit.0, precision))?;
        put(&entry.relit_png, png::picture(view.relit, &tone))?;
        put(&entry.shadow_png, png::fraction(view.shadow))?;
        lights.push(entry);
    }

    let half = Precision::Half;
    let precision = Precision::for_light(&scene.albedo);
    put(
        "albedo.exr",
        exr::rgb(&on_grid(&scene.albedo, size), precision),
    )?;
    let normal = person_normals(scene);
    put("normal.exr", exr::rgb(&on_grid(&normal, size), half))?;
    let one_channel = |plane: &Plane<f32>| {
        let plane = plane.map(|&value| [value]);
        let stretched = on_grid(&plane, size);
        stretched.map(|[value]| *value)
    };
    put(
        "roughness.exr",
        exr::gray(&one_channel(&scene.roughness), half),
    )?;
    put(
        "depth.exr",
        exr::gray(&one_channel(&scene.depth_metres), Precision::Float),
    )?;
    put(
        "overview.png",
        png::rgb8(&overview(results, &normal, &tone)),
    )?;

    let mut warnings = results.warnings.to_vec();
    if !scene.scale_known {
        warnings.push(format!(
            "The flash's intensity is unknown: albedo and relit light are right up to one global \
             scale, and the PNG pictures show {:.4} as white.",
            tone.white()
        ));
    }
    let manifest = Manifest {
        format: 1,
        program: concat!("captured ", env!("CARGO_PKG_VERSION")).into(),
        source: results.source.into(),
        width: size.0,
        height: size.1,
        scale_known: scene.scale_known,
        png_white: tone.white(),
        timings_ms: results.timings_ms.to_vec(),
        report: results.report.clone(),
        lights,
        warnings,
        files: staging.files().to_vec(),
        blake3: String::new(),
    };
    let (manifest, bytes) = manifest.seal()?;
    staging.put(MANIFEST, &bytes)?;
    staging.commit()?;
    Ok(manifest)
}

/// Camera axes (x right, y down, z forward) → x right, y up, z toward the camera.
fn person_normals(scene: &Scene) -> Plane<[f32; 3]> {
    scene.normal.map(|normal| [normal.x, -normal.y, -normal.z])
}

/// The page with every picture on it.
fn overview(results: &Results<'_>, normal: &Plane<[f32; 3]>, tone: &Tone) -> Plane<[u8; 3]> {
    let scene = results.scene;
    let mut panels = results.photographs.to_vec();
    let flash_tone = Tone::robust([&results.flash_only.0]);
    panels.push(Panel::light(
        "flash alone",
        &results.flash_only.0,
        &flash_tone,
    ));
    panels.push(Panel::distance("depth", &scene.depth_metres));
    panels.push(Panel::normal("normals", normal));
    let albedo_tone = if scene.scale_known {
        Tone::absolute()
    } else {
        Tone::robust([&scene.albedo])
    };
    panels.push(Panel::light("albedo", &scene.albedo, &albedo_tone));
    panels.push(Panel::fraction("roughness", &scene.roughness));
    panels.push(Panel::fraction("confidence", &scene.confidence));
    for view in results.relit {
        panels.push(Panel::light(
            format!("relit {}", view.label),
            &view.relit.0,
            tone,
        ));
        panels.push(Panel::fraction(
            format!("shadow {}", view.label),
            view.shadow,
        ));
    }
    let (width, height) = results.flash_only.0.size();
    let lights = match results.relit.len() {
        1 => "1 light".into(),
        count => format!("{count} lights"),
    };
    sheet::lay_out(
        &format!("{} · {width}×{height} · {lights}", results.source),
        &panels,
    )
}

/// A plane on another grid of the same camera: bilinear between known samples, the nearest where a
/// neighbour is unknown (NaN in its first channel).
fn on_grid<const N: usize>(
    plane: &Plane<[f32; N]>,
    (width, height): (usize, usize),
) -> Cow<'_, Plane<[f32; N]>> {
    let (from_width, from_height) = plane.size();
    if (from_width, from_height) == (width, height) || plane.is_empty() || width == 0 {
        return Cow::Borrowed(plane);
    }
    // Pixel centres lie on whole numbers, so the grids share their corners, half a pixel out.
    let source = |at: usize, from: usize, to: usize| {
        let position = (at as f32 + 0.5) * from as f32 / to as f32 - 0.5;
        let clamped = position.clamp(0.0, (from - 1) as f32);
        let low = (clamped as usize).min(from.saturating_sub(2));
        (low, (low + 1).min(from - 1), clamped - low as f32)
    };
    let mut out = Plane::filled(width, height, [f32::NAN; N]);
    out.samples_mut()
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            let (top, bottom, down) = source(y, from_height, height);
            for (x, pixel) in row.iter_mut().enumerate() {
                let (left, right, across) = source(x, from_width, width);
                let corners = [
                    plane[(left, top)],
                    plane[(right, top)],
                    plane[(left, bottom)],
                    plane[(right, bottom)],
                ];
                *pixel = if corners.iter().any(|corner| corner[0].is_nan()) {
                    corners[usize::from(across >= 0.5) + 2 * usize::from(down >= 0.5)]
                } else {
                    std::array::from_fn(|channel| {
                        let mix = |a: f32, b: f32, part: f32| a + (b - a) * part;
                        mix(
                            mix(corners[0][channel], corners[1][channel], across),
                            mix(corners[2][channel], corners[3][channel], across),
                            down,
                        )
                    })
                };
            }
        });
    Cow::Owned(out)
}
