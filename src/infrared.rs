//! A shot without flash: the depth camera's own infrared light in the flash's place.
//!
//! A ToF camera lights what it sees from beside its lens, as a flash does, and its amplitude falls off as a flash's
//! light: distance² and cosine. Its picture is therefore a flash photograph in infrared, and the room's photograph
//! gives it its colors.

use crate::{
    radiometry::{LinearImage, RadiometryError, linearise},
    registration::{RegistrationError, RigMaps, register},
    relight::networks::resampled,
    shot::Shot,
};
use drivers::{Beam, ColorFrame, Exposure, FlashLamp, Pixels, Plane, Transfer};
use glam::DVec3;
use rayon::prelude::*;
use thiserror::Error;

/// How far brightness is the room photograph's instead of infrared's, as an exponent: infrared knows no shadow of the
/// room's lamps, the photograph knows what is dark to the eye and bright in infrared. Of 0, ¼, ½ and ¾ the squared
/// errors of albedo on 30 rendered scenes are 0.42, 0.32, 0.40 and 0.61e-2 (the flash's own photograph: 0.26; the
/// room's as it is: 0.88).
const ROOM_SHARE: f32 = 0.25;

/// Why a shot cannot be lit by infrared.
#[derive(Debug, Error)]
pub enum InfraredError {
    /// The photograph with flash is all there is.
    #[error("there is no photograph without flash; add ambient.png, or leave out --no-flash")]
    NoRoom,
    /// The depth camera said nothing but distances.
    #[error(
        "the depth camera delivered no infrared picture; add amplitude.png or name amplitude.node, or leave out --no-flash"
    )]
    NoAmplitude,
    /// Nothing of the infrared picture lies on the photograph.
    #[error("the infrared picture is dark wherever the photograph is not; go nearer")]
    Dark,
    /// The photograph cannot be read.
    #[error(transparent)]
    Radiometry(#[from] RadiometryError),
    /// Depth cannot be brought onto the photograph.
    #[error(transparent)]
    Registration(#[from] RegistrationError),
}

/// The shot with its flash photograph replaced by what the infrared light would have shown in the room photograph's
/// colors, lit from the depth camera; the photograph with flash is not looked at.
///
/// The intensity of infrared in units of visible light is unknown, and so is the scale of what is made of the shot.
/// Where infrared has no answer the room's photograph stands in, at the ratio of both around there. Detail finer than the
/// depth camera's own pixels is the room photograph's.
///
/// # Errors
/// [`InfraredError`].
pub fn lit_by_infrared(shot: &Shot) -> Result<Shot, InfraredError> {
    let apart = |frame: &&ColorFrame| frame.at.as_nanos().abs_diff(shot.depth.at.as_nanos());
    let room = shot.ambient.iter().min_by_key(apart);
    let room = room.ok_or(InfraredError::NoRoom)?;
    if shot.depth.amplitude.is_none() {
        return Err(InfraredError::NoAmplitude);
    }
    let light = linearise(room)?;
    let maps = RigMaps::new(&shot.rig)?;
    let registered = register(&shot.depth, &maps, Some(&light))?;
    let amplitude = registered.amplitude.as_ref();
    let amplitude = amplitude.ok_or(InfraredError::NoAmplitude)?;
    let detailed = detailed(amplitude, &light, footprint(shot));
    let picture = colored(&detailed, &registered.metres, &light)?;
    let from = shot.rig.depth.as_ref();
    let mut out = shot.clone();
    out.rig.flash = FlashLamp {
        position_metres: from.map_or(DVec3::ZERO, |depth| depth.to_color.translation_metres),
        intensity: None,
        beam: Beam::default(),
    };
    out.flash = ColorFrame {
        pixels: Pixels::RgbF32(picture),
        light: shot.flash.light,
        exposure: Exposure::UNIT,
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
        ..room.clone()
    };
    out.ambient.clear();
    Ok(out)
}

/// Pixels of the photograph that one of the depth camera's covers, across.
fn footprint(shot: &Shot) -> f64 {
    let color = shot.rig.color.fx + shot.rig.color.fy;
    let depth = shot.rig.depth.as_ref();
    depth.map_or(1.0, |depth| color / (depth.lens.fx + depth.lens.fy))
}

/// Infrared with the room photograph's detail within the depth camera's pixels, `footprint` pixels wide.
fn detailed(amplitude: &Plane<f32>, room: &LinearImage, footprint: f64) -> Plane<f32> {
    let (width, height) = amplitude.size();
    let coarse = |side: usize| ((side as f64 / footprint) as usize).clamp(1, side);
    let size = (coarse(width), coarse(height));
    if size == (width, height) {
        return amplitude.clone();
    }
    let level = room.0.map(mean);
    let blurred = resampled(&resampled(&level, size), (width, height));
    let mut out = amplitude.clone();
    let ratios = level.samples().par_iter().zip(blurred.samples());
    out.samples_mut()
        .par_iter_mut()
        .zip(ratios)
        .for_each(|(value, (fine, coarse))| {
            let ratio = fine / coarse;
            if ratio.is_finite() {
                *value *= ratio.max(0.0);
            }
        });
    out
}

/// Flash light in the room's colors; NaN where the photograph is unknown.
fn colored(
    amplitude: &Plane<f32>,
    metres: &Plane<f32>,
    room: &LinearImage,
) -> Result<Plane<[f32; 3]>, InfraredError> {
    // How much of a flash at the camera arrives: nearly 1/distance².
    let falls = |index: usize| 1.0 / metres.samples()[index].powi(2);
    let ratio_of = |index: usize| {
        let (infrared, level) = (amplitude.samples()[index], mean(&room.0.samples()[index]));
        let ratio = infrared / (level * falls(index));
        (ratio.is_finite() && ratio > 0.0).then_some([ratio, level / infrared, falls(index)])
    };
    let stride = amplitude.len().div_ceil(60_000).max(1);
    let known: Vec<[f32; 3]> = (0..amplitude.len())
        .step_by(stride)
        .filter_map(ratio_of)
        .collect();
    let median = |of: usize| {
        let mut values: Vec<f32> = known.iter().map(|ratios| ratios[of]).collect();
        let middle = values.len() / 2;
        (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
    };
    let [Some(alike), Some(brightness), Some(falling)] = [0, 1, 2].map(median) else {
        return Err(InfraredError::Dark);
    };
    let (width, height) = room.0.size();
    // What the room's photograph would be, were it lit as by the infrared light.
    let guesses = (0..width * height).into_par_iter().map(|index| {
        let falls = falls(index);
        let falls = if falls.is_finite() { falls } else { falling };
        (mean(&room.0.samples()[index]) * falls * alike).max(0.0)
    });
    let guesses: Vec<f32> = guesses.collect();
    let beyond = amplitude.samples().iter().zip(&guesses);
    let beyond = beyond.map(|(infrared, guess)| infrared / guess);
    let beyond = beyond.map(|ratio| {
        if ratio > 0.0 && ratio.is_finite() {
            ratio
        } else {
            f32::NAN
        }
    });
    let beyond = Plane::new(width, height, beyond.collect()).expect("one per pixel");
    let beyond = closed(beyond);
    let pixels = room
        .0
        .samples()
        .par_iter()
        .zip(guesses)
        .zip(beyond.samples());
    let samples = pixels.map(|((rgb, guess), beyond)| {
        let level = mean(rgb);
        if !level.is_finite() {
            return [f32::NAN; 3];
        }
        let shared = brightness * guess * beyond.powf(1.0 - ROOM_SHARE);
        if level > 0.0 {
            rgb.map(|channel| (channel / level).max(0.0) * shared)
        } else {
            [shared; 3]
        }
    });
    let samples = samples.collect();
    Ok(Plane::new(width, height, samples).expect("one per pixel"))
}

/// By how much coarser grids are from which gaps are closed, finest first.
const COARSER: [usize; 4] = [4, 16, 64, 256];

/// The plane with its gaps closed by the mean of what is known around them, 1 where nothing is.
fn closed(mut plane: Plane<f32>) -> Plane<f32> {
    let size = plane.size();
    for factor in COARSER {
        if plane.samples().iter().all(|value| value.is_finite()) {
            return plane;
        }
        let small = (size.0.div_ceil(factor), size.1.div_ceil(factor));
        let around = resampled(&resampled(&plane, small), size);
        for (value, around) in plane.samples_mut().iter_mut().zip(around.samples()) {
            if value.is_nan() {
                *value = *around;
            }
        }
    }
    plane.map(|value| if value.is_finite() { *value } else { 1.0 })
}

fn mean(rgb: &[f32; 3]) -> f32 {
    (rgb[0] + rgb[1] + rgb[2]) / 3.0
}
