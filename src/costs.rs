//! What the terms of a scene's model cost on this machine: measured at first use, then kept.

use crate::{
    develop::{DevelopError, Options, Stage, develop_light, work_out},
    inference::InferenceError,
    parsimony::{Bounced, CostModel, Geometry, Glance, Shadow, Terms, cost::Line},
    radiometry::{self, SubtractOptions},
    relight::{
        Lamp, RelightOptions, Shadows,
        networks::{
            Channels, Network, NetworkError,
            compact::{Compact, Correction, MOST_PIXELS},
        },
    },
    scene::Material,
    shot::{Assembler, Limits, Shot},
};
use drivers::{Device, Settings, synthetic};
use serde::{Deserialize, Serialize};
use std::{
    fs,
    io::Write as _,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};
use thiserror::Error;

/// The largest file that is read as kept costs, bytes.
const LARGEST_FILE: u64 = 1 << 16;
/// Widths of the photographs that are measured; three quarters as high.
const WIDTHS: [usize; 2] = [192, 512];
/// Each time is the least of so many runs: what else the machine does only adds to it.
const RUNS: usize = 7;
/// Weight of the last shot in what shots have taken lately.
const LAST_SHOT: f64 = 0.25;
/// Shots are expected to take at least and at most so many times as long as measured.
const PACES: std::ops::RangeInclusive<f64> = 0.25..=8.0;
/// Sides of the grids that networks are measured on; the larger is the largest they are asked on.
const GRIDS: [usize; 2] = [64, 256];
/// The networks' answers where none were at hand: 28 and 7 kFLOP a pixel at 20 GFLOP/s.
const UNMEASURED: [f64; 2] = [1400.0, 350.0];
/// Bringing them into memory where that was not measured.
const UNMEASURED_LOAD_MS: f64 = 100.0;

/// Brings the compact networks into memory.
pub type LoadCompact<'a> = dyn Fn() -> Result<Compact, InferenceError> + Send + 'a;

/// Why costs could not be measured.
#[derive(Debug, Error)]
pub enum CostError {
    /// The computed scene that is measured gave no shot.
    #[error("the computed scene that costs are measured on gave no shot; report this as a bug")]
    NoShot,
    /// It could not be developed.
    #[error(transparent)]
    Develop(#[from] DevelopError),
}

/// Costs as kept in a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    format: u32,
    threads: usize,
    optimised: bool,
    /// How many times as long shots have taken lately as `costs` says.
    pace: f64,
    costs: CostModel,
}

/// The costs of this machine and build, and what to say about them.
#[derive(Debug, Clone, PartialEq)]
pub struct Known {
    /// Milliseconds of every step.
    pub costs: CostModel,
    /// Why they will be measured again next time.
    pub warning: Option<String>,
}

/// Costs from `file`, or measured now (half a second to a few) and kept in it.
///
/// A file of another number of threads, of another kind of build, or that makes no sense is measured
/// anew and replaced.
///
/// # Errors
/// [`CostError`] when nothing can be measured.
pub fn known(file: Option<&Path>, networks: Option<&LoadCompact<'_>>) -> Result<Known, CostError> {
    if let Some(kept) = file.and_then(kept) {
        return Ok(Known {
            costs: kept.costs.at_pace(kept.pace),
            warning: None,
        });
    }
    let mut costs = measured()?;
    if let Some(load) = networks {
        let began = Instant::now();
        // A network that fails here fails again where it is used, and is reported there.
        if let Ok(compact) = load() {
            let loading = began.elapsed();
            if let Ok([surfaces, light]) = answering(&compact) {
                (costs.surfaces_network, costs.light_network) = (surfaces, light);
                costs.network_load_ms = milliseconds(loading);
            }
        }
    }
    let warning = match file {
        None => Some("there is no cache folder (set XDG_CACHE_HOME or HOME): what steps cost here is measured again in every run".to_owned()),
        Some(file) => keep(file, costs, 1.0).err().map(|error| {
            format!(
                "{}: what steps cost here could not be kept ({error}) and is measured again in every run; make the folder writable",
                file.display()
            )
        }),
    };
    Ok(Known { costs, warning })
}

/// Learns from a shot that was expected to take `expected_ms` by the costs in `file`, and took `took_ms`:
/// the machine may be warmer or busier than it was when they were measured. A file that cannot be read
/// or written is left as it is; whoever reads it says so.
pub fn learn(file: &Path, expected_ms: f64, took_ms: f64) {
    let ratio = took_ms / expected_ms;
    let (Some(kept), true) = (kept(file), ratio.is_finite() && ratio > 0.0) else {
        return;
    };
    let pace = (kept.pace * ratio.powf(LAST_SHOT)).clamp(*PACES.start(), *PACES.end());
    keep(file, kept.costs, pace).ok();
}

/// Milliseconds of one answer of either network.
fn answering(compact: &Compact) -> Result<[Line; 2], NetworkError> {
    let line = |network: &dyn Network, name: &str, count: usize, wanted: &[&str]| {
        let measured = GRIDS.map(|side| {
            let given = Channels {
                size: (side, side),
                count,
                samples: (0..count * side * side)
                    .map(|i| (i % 251) as f32 / 251.0)
                    .collect(),
            };
            // The first answer of a size prepares for it.
            network.answer(&[(name, &given)], wanted)?;
            let ms = timed(|| network.answer(&[(name, &given)], wanted).map(drop));
            Ok((side * side, ms))
        });
        let [small, large] = measured;
        Ok(Line::through(small?, large?))
    };
    debug_assert_eq!(GRIDS[1] * GRIDS[1], MOST_PIXELS);
    Ok([
        line(compact.surfaces.as_ref(), "sight", 16, &["factor"])?,
        line(compact.light.as_ref(), "lamp", 17, &["weight"])?,
    ])
}

fn unmeasured(per_megapixel_ms: f64) -> Line {
    Line {
        fixed_ms: 1.0,
        per_megapixel_ms,
    }
}

/// Where costs are kept: the service's cache folder, else the user's.
pub fn usual_file() -> Option<PathBuf> {
    let folder = |name: &str| {
        let value = std::env::var_os(name).filter(|value| !value.is_empty());
        value.map(PathBuf::from).filter(|path| path.is_absolute())
    };
    folder("CACHE_DIRECTORY")
        .or_else(|| folder("XDG_CACHE_HOME").map(|cache| cache.join("captured")))
        .or_else(|| folder("HOME").map(|home| home.join(".cache/captured")))
        .map(|cache| cache.join("costs.toml"))
}

fn kept(file: &Path) -> Option<Kept> {
    let size = fs::metadata(file).ok()?.len();
    if size > LARGEST_FILE {
        return None;
    }
    let kept: Kept = toml::from_str(&fs::read_to_string(file).ok()?).ok()?;
    let usable = kept.costs.is_usable() && PACES.contains(&kept.pace);
    (kept == of_this_build(kept.costs, kept.pace) && usable).then_some(kept)
}

fn of_this_build(costs: CostModel, pace: f64) -> Kept {
    Kept {
        format: 4,
        threads: rayon::current_num_threads(),
        optimised: !cfg!(debug_assertions),
        pace,
        costs,
    }
}

/// Replaces the file as a whole, so that a reader never meets half of one.
fn keep(file: &Path, costs: CostModel, pace: f64) -> std::io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let kept = of_this_build(costs, pace);
    let text = toml::to_string(&kept).map_err(std::io::Error::other)?;
    let mut staged = tempfile::NamedTempFile::new_in(folder)?;
    staged.write_all(text.as_bytes())?;
    staged.persist(file)?;
    Ok(())
}

/// Measures every step on a computed scene in two sizes.
fn measured() -> Result<CostModel, CostError> {
    let [small, large] = WIDTHS.map(steps);
    let (small, large) = (small?, large?);
    let line = |step: fn(&Steps) -> f64| {
        Line::through((small.pixels, step(&small)), (large.pixels, step(&large)))
    };
    Ok(CostModel {
        radiometry: line(|steps| steps.radiometry),
        alignment: line(|steps| steps.aligned_radiometry - steps.radiometry),
        reduce: line(|steps| steps.reduce),
        registration: line(|steps| steps.registration),
        flat: line(|steps| steps.flat),
        shape: line(|steps| steps.matte - steps.flat),
        one_roughness: line(|steps| steps.one_roughness - steps.matte),
        varying: line(|steps| steps.varying - steps.one_roughness),
        slabs: line(|steps| steps.slabs),
        obscurance: line(|steps| steps.obscurance),
        lamp: line(|steps| steps.lamp),
        sweep: line(|steps| steps.swept_lamp - steps.lamp),
        correction: line(|steps| steps.correction),
        enlarge: line(|steps| steps.enlarge),
        glance: line(|steps| steps.glance),
        surfaces_network: unmeasured(UNMEASURED[0]),
        light_network: unmeasured(UNMEASURED[1]),
        network_load_ms: UNMEASURED_LOAD_MS,
    })
}

/// Milliseconds of every step on one photograph.
#[derive(Default)]
struct Steps {
    pixels: usize,
    radiometry: f64,
    aligned_radiometry: f64,
    reduce: f64,
    registration: f64,
    flat: f64,
    matte: f64,
    one_roughness: f64,
    varying: f64,
    slabs: f64,
    obscurance: f64,
    lamp: f64,
    swept_lamp: f64,
    correction: f64,
    enlarge: f64,
    glance: f64,
}

fn steps(width: usize) -> Result<Steps, CostError> {
    let shot = computed(width)?;
    let base = Options::default();
    let subtract = |align: bool| {
        let options = SubtractOptions {
            align,
            ..base.subtract
        };
        radiometry::subtract(&shot.flash, &shot.ambient, &options)
    };
    let flash_only = subtract(true).map_err(DevelopError::from)?;
    let pixels = flash_only.light.0.len();
    // One development with some terms, by stages.
    let stages = |terms: Terms| -> Result<[f64; 3], DevelopError> {
        let options = terms.options(&base, 0.1);
        let mut runs = [const { Vec::new() }; 3];
        for _ in 0..RUNS {
            let mut began: Option<(Stage, Instant)> = None;
            let mut end = |began: &mut Option<(Stage, Instant)>| {
                if let Some((stage, at)) = began.take() {
                    runs[stage as usize - 1].push(milliseconds(at.elapsed()));
                }
            };
            work_out(&shot, &flash_only, &options, &mut |stage| {
                end(&mut began);
                began = Some((stage, Instant::now()));
            })?;
            end(&mut began);
        }
        Ok(runs.map(least))
    };
    let matte = Terms {
        material: Material::Matte,
        ..Terms::CLOSED
    };
    let [registration, varying, prepare] = stages(Terms::CLOSED)?;
    let [_, flat, _] = stages(Terms::FEWEST)?;
    let [_, one_roughness, slabs] = stages(Terms {
        material: Material::OneRoughness,
        indirect: Bounced::None,
        ..Terms::CLOSED
    })?;
    let [_, matte, bare] = stages(Terms {
        indirect: Bounced::None,
        shadow: Shadow::None,
        ..matte
    })?;
    let development = develop_light(&shot, flash_only.clone(), &base, &mut |_| ())?;
    let prepared = &development.prepared;
    let lamp = Lamp::from_person([0.6, 0.4, 0.7]).unwrap_or_else(|_| unreachable!("a direction"));
    let unshadowed = RelightOptions {
        shadows: Shadows::None,
        ..RelightOptions::default()
    };
    let correction = Correction::of(&development.scene, prepared);
    let lamp_ms = timed(|| prepared.relight(&lamp, unshadowed));
    let swept_ms = timed(|| prepared.relight(&lamp, RelightOptions::default()));
    let asked_ms = timed(|| {
        let swept = correction.swept(prepared, &lamp);
        correction.given(&swept, &lamp)
    });
    let mut coarse = Terms {
        geometry: Geometry::Smooth,
        ..Terms::FEWEST
    }
    .options(&base, 0.0);
    coarse.working_pixels = pixels / 4;
    let reduced = develop_light(&shot, flash_only.clone(), &coarse, &mut |_| ())?;
    let small = reduced.prepared.relight(&lamp, RelightOptions::default());
    let glance = {
        let mut runs = Vec::new();
        for _ in 0..RUNS {
            let began = Instant::now();
            Glance::at(&shot, &flash_only, &base)?;
            runs.push(milliseconds(began.elapsed()));
        }
        least(runs)
    };
    Ok(Steps {
        pixels,
        radiometry: timed(|| subtract(false)),
        aligned_radiometry: timed(|| subtract(true)),
        reduce: timed(|| crate::develop::reduced(&flash_only, 2)),
        registration,
        // What a scene is prepared with in any case counts with its surfaces.
        flat: flat + bare,
        matte: matte + bare,
        one_roughness: one_roughness + bare,
        varying: varying + bare,
        slabs: (slabs - bare).max(0.0),
        obscurance: (prepare - slabs).max(0.0),
        lamp: lamp_ms,
        swept_lamp: swept_ms,
        // What the network says is then shaded as a lamp without shadows is.
        correction: (asked_ms + lamp_ms - swept_ms).max(0.0),
        enlarge: timed(|| reduced.finish(small.clone())),
        glance,
    })
}

/// A shot of the computed desk.
fn computed(width: usize) -> Result<Shot, CostError> {
    let mut device = synthetic::Synthetic::new(synthetic::Options {
        width,
        height: width * 3 / 4,
        depth_width: width / 2,
        ..synthetic::Options::default()
    });
    let settings = Settings::default();
    let mut assembler = Assembler::new(device.rig(), Limits::default());
    let mut stream = device.start(&settings).map_err(|_| CostError::NoShot)?;
    loop {
        let frame = stream.next_frame(Duration::from_secs(1));
        if let Some(shot) = assembler.push(frame.map_err(|_| CostError::NoShot)?) {
            return Ok(shot);
        }
    }
}

fn timed<T>(mut work: impl FnMut() -> T) -> f64 {
    let runs = (0..RUNS).map(|_| {
        let began = Instant::now();
        std::hint::black_box(work());
        milliseconds(began.elapsed())
    });
    least(runs.collect())
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

fn least(runs: Vec<f64>) -> f64 {
    runs.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_are_measured_once_and_a_file_that_makes_no_sense_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("new/costs.toml");
        let first = known(Some(&file), None).unwrap();
        assert!(first.costs.is_usable() && first.warning.is_none());
        assert!(first.costs.flat.at(1_000_000) > 0.0 && first.costs.lamp.at(1_000_000) > 0.0);
        // Kept to the digit; two measurements never agree so.
        assert_eq!(known(Some(&file), None).unwrap(), first);
        fs::write(&file, "format = 1\nthreads = -3").unwrap();
        assert_ne!(known(Some(&file), None).unwrap(), first);
        assert!(kept(&file).is_some());
    }

    #[test]
    fn shots_that_take_longer_make_the_next_ones_expected_to() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("costs.toml");
        let measured = known(Some(&file), None).unwrap().costs.flat.at(1_000_000);
        let expected = || known(Some(&file), None).unwrap().costs.flat.at(1_000_000);
        for _ in 0..24 {
            // A machine three times as slow as it was, whatever is expected of it.
            learn(&file, 10.0 * expected() / measured, 30.0);
        }
        assert!(
            (expected() / measured - 3.0).abs() < 0.01,
            "{}",
            expected() / measured
        );
        learn(&file, 0.0, 30.0);
        learn(&file, f64::NAN, 30.0);
        assert!((expected() / measured - 3.0).abs() < 0.01);
        for _ in 0..24 {
            learn(&file, 1.0, 1e9);
        }
        assert!((expected() / measured - PACES.end()).abs() < 0.01);
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_said_and_costs_are_known_all_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        fs::write(&blocked, "").unwrap();
        let found = known(Some(&blocked.join("costs.toml")), None).unwrap();
        assert!(found.warning.unwrap().contains("could not be kept"));
    }
}
