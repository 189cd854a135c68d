//! Many frames of one scene become one shot with less noise, and how to share out their number.
//!
//! Of N frames, n with the flash and m without, the difference has the variance σ_f²/n + (kσ_a)²/m,
//! least for n/m = σ_f/(kσ_a), k the ratio of the exposures. Light at unit exposure carries k already.

use super::{
    LinearImage, RadiometryError, SubtractOptions,
    align::Anchor,
    decode::linearise,
    subtract::Scatter,
    warp::{Resampled, resample_row},
};
use crate::shot::{Burst, Shot};
use drivers::{ColorFrame, DepthFrame, Pixels, Plane, Transfer};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Standard deviations from the frame in the middle beyond which something moved.
const MOVED: f32 = 4.0;
/// Change of a whole picture's light that is the mains' flicker and no motion, as a part of it.
const FLICKER: f32 = 0.1;
/// Uncertainty of a distance whose device states none, a fraction of it.
const DEPTH_SIGMA: f32 = 0.01;
/// Standard deviation of a normal distribution as a multiple of its median absolute deviation.
const NORMAL: f32 = 1.4826;
/// Most frames in a row of one light: the others must be near in time.
const LONGEST_RUN: u32 = 4;
/// Pixels looked at for the noise, at most.
const SAMPLES: usize = 20_000;

/// What a burst was, for `shot.json`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BurstReport {
    /// Color frames asked for.
    pub frames: u32,
    /// Noise of a flash frame as a multiple of an ambient frame's, at unit exposure.
    pub noise_ratio: f32,
    /// Flash and ambient frames of so many that give the least noise.
    pub best_split: [u32; 2],
    /// Flash and ambient frames that became part of the shot.
    pub used: [u32; 2],
    /// Noise of the flash's light to be expected, as a part of that of one flash and one ambient frame.
    pub expected_noise: f32,
}

impl BurstReport {
    /// Of `used` frames of `frames` asked for.
    pub fn new(frames: u32, noise_ratio: f32, used: [u32; 2]) -> Self {
        Self {
            frames,
            noise_ratio,
            best_split: split(frames, noise_ratio),
            used,
            expected_noise: (variance(used, noise_ratio) / variance([1, 1], noise_ratio)).sqrt(),
        }
    }
}

/// Variance of the flash's light, in that of one ambient frame.
fn variance([flash, ambient]: [u32; 2], ratio: f32) -> f32 {
    ratio * ratio / flash as f32 + 1.0 / ambient as f32
}

/// How many flash and how many ambient frames of `frames` ≥ 2 give the least noise, when a flash frame
/// has `ratio` = σ_f/(kσ_a) > 0 times the noise of an ambient frame; at least one of each.
pub fn split(frames: u32, ratio: f32) -> [u32; 2] {
    let frames = frames.max(2);
    // The variance is convex in n: the best whole number is next to the best number.
    let best = frames as f32 * ratio / (1.0 + ratio);
    let whole = |flash: f32| {
        let flash = (flash as u32).clamp(1, frames - 1);
        [flash, frames - flash]
    };
    let (below, above) = (whole(best.floor()), whole(best.ceil()));
    if variance(below, ratio) <= variance(above, ratio) {
        below
    } else {
        above
    }
}

/// The pattern of a burst: so many frames in a row with flash, and so many without, whose frames
/// together give the least noise.
pub fn pattern(ratio: f32) -> [u32; 2] {
    let runs = (1..=LONGEST_RUN).flat_map(|run| [[run, 1], [1, run]]);
    let noise = |pattern: &[u32; 2]| pattern.iter().sum::<u32>() as f32 * variance(*pattern, ratio);
    runs.min_by(|a, b| noise(a).total_cmp(&noise(b)))
        .unwrap_or([1, 1])
}

/// Noise of a shot's flash frame as a multiple of its ambient frame's, at unit exposure: the median over
/// the picture. 1 without an ambient frame.
///
/// # Errors
/// [`RadiometryError`] for frames that cannot be read.
pub fn noise_ratio(shot: &Shot) -> Result<f32, RadiometryError> {
    let Some(ambient) = shot.ambient.first() else {
        return Ok(1.0);
    };
    let options = SubtractOptions::default();
    let (lit, unlit) = (linearise(&shot.flash)?, linearise(ambient)?);
    let lit_scatter = Scatter::of(&shot.flash, &lit, &options)?;
    let unlit_scatter = Scatter::of(ambient, &unlit, &options)?;
    let step = (lit.0.len() / SAMPLES).max(1);
    let pairs = lit.0.samples().iter().zip(unlit.0.samples()).step_by(step);
    let mut ratios: Vec<f32> = pairs
        .map(|(lit, unlit)| lit_scatter.variance(*lit) / unlit_scatter.variance(*unlit))
        .filter(|ratio| ratio.is_finite() && *ratio > 0.0)
        .collect();
    if ratios.is_empty() {
        return Ok(1.0);
    }
    let middle = ratios.len() / 2;
    let (_, median, _) = ratios.select_nth_unstable_by(middle, f32::total_cmp);
    Ok(median.sqrt())
}

/// One shot of a burst, at the moment of the flash frame in the middle: pictures aligned on it and
/// averaged in linear light, distances averaged. What moved away from the frame in the middle does not
/// count, and what that frame does not know stays unknown.
///
/// # Errors
/// [`RadiometryError`] for frames that cannot be read or differ in size.
pub fn merge(burst: &Burst) -> Result<Shot, RadiometryError> {
    let middle = &burst.flash[burst.flash.len() / 2];
    let lit = linearise(middle)?;
    let nearest = |frame: &&ColorFrame| frame.at.distance(middle.at);
    // The one in the middle comes first: the others are held against it.
    let mut flash: Vec<&ColorFrame> = burst.flash.iter().collect();
    flash.sort_by_key(nearest);
    let mut ambient: Vec<&ColorFrame> = burst.ambient.iter().collect();
    ambient.sort_by_key(nearest);
    let mut depth: Vec<&DepthFrame> = burst.depth.iter().collect();
    depth.sort_by_key(|frame| frame.at.distance(middle.at));
    Ok(Shot {
        flash: ColorFrame {
            at: middle.at,
            ..mean(&flash, &lit)?
        },
        ambient: vec![mean(&ambient, &lit)?],
        depth: mean_depth(&depth),
        rig: burst.rig,
        mask: None,
    })
}

/// Mean of frames on the grid of `target`, as linear light with the time and exposure of the first.
fn mean(frames: &[&ColorFrame], target: &LinearImage) -> Result<ColorFrame, RadiometryError> {
    let (width, height) = target.0.size();
    let first = frames[0];
    let options = SubtractOptions::default();
    let anchor = Anchor::of(target);
    let mut reference = Plane::filled(width, height, [f32::NAN; 3]);
    let mut sums = Plane::filled(width, height, [0.0f32; 3]);
    let mut counts = Plane::filled(width, height, 0.0f32);
    let mut scatter = None;
    for (number, frame) in frames.iter().enumerate() {
        let light = linearise(frame)?;
        if light.0.size() != (width, height) {
            let (found_width, found_height) = light.0.size();
            return Err(RadiometryError::SizesDiffer {
                frame: "a frame of the burst",
                width,
                height,
                found_width,
                found_height,
            });
        }
        let warp = anchor.align(&light).warp;
        if scatter.is_none() {
            scatter = Some(Scatter::of(frame, &light, &options)?);
        }
        let Some(known) = &scatter else { continue };
        reference
            .samples_mut()
            .par_chunks_mut(width)
            .zip(sums.samples_mut().par_chunks_mut(width))
            .zip(counts.samples_mut().par_chunks_mut(width))
            .enumerate()
            .for_each_init(Vec::new, |row, (y, ((reference, sums), counts))| {
                row.clear();
                row.extend(light.0.row(y).iter().map(|&light| Resampled {
                    light,
                    variance_factor: 1.0,
                    inside: true,
                }));
                if !warp.is_identity() {
                    resample_row(&light, &warp, y, row);
                }
                for x in 0..width {
                    let seen = row[x].light;
                    if number == 0 {
                        reference[x] = seen;
                    }
                    let here: f32 = reference[x].iter().sum();
                    let off = seen.iter().sum::<f32>() - here;
                    // Three channels of two frames.
                    let noise = MOVED * MOVED * 6.0 * known.variance(reference[x]);
                    let flicker = FLICKER * here;
                    // Never true of what is unknown in either.
                    if off * off <= noise + flicker * flicker {
                        for (sum, channel) in sums[x].iter_mut().zip(seen) {
                            *sum += channel;
                        }
                        counts[x] += 1.0;
                    }
                }
            });
    }
    let factor = first.exposure.factor();
    for (sum, count) in sums.samples_mut().iter_mut().zip(counts.samples()) {
        // Without any this is 0/0: unknown.
        *sum = sum.map(|channel| channel / count * factor);
    }
    Ok(ColorFrame {
        pixels: Pixels::RgbF32(sums),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
        ..first.clone()
    })
}

/// Mean of distances, amplitudes and their noise, at the time of the first. Distances far from the median of
/// a pixel's are of something that moved; a median favours no frame.
fn mean_depth(frames: &[&DepthFrame]) -> DepthFrame {
    let first = frames[0];
    let (width, height) = first.metres.size();
    let stated = |x: usize, y: usize| {
        let sigma = first.sigma.as_ref().map(|sigma| sigma[(x, y)]);
        sigma.filter(|sigma| *sigma > 0.0)
    };
    let agreeing = |x: usize, y: usize| {
        let seen = frames.iter().filter_map(|frame| frame.metres.get(x, y));
        let mut seen: Vec<f32> = seen.copied().filter(|metres| !metres.is_nan()).collect();
        if first.metres[(x, y)].is_nan() {
            return (f32::NAN, 0.0);
        }
        let middle = seen.len() / 2;
        let median = *seen.select_nth_unstable_by(middle, f32::total_cmp).1;
        let mut apart: Vec<f32> = seen.iter().map(|metres| (metres - median).abs()).collect();
        let deviation = *apart.select_nth_unstable_by(middle, f32::total_cmp).1;
        // Devices state less noise than they have; the frames themselves show it.
        let sigma = stated(x, y).unwrap_or(DEPTH_SIGMA * median);
        let limit = MOVED * sigma.max(NORMAL * deviation);
        let near = seen
            .iter()
            .filter(|metres| (**metres - median).abs() <= limit);
        let (sum, count) = near.fold((0.0, 0.0f32), |(sum, count), metres| {
            (sum + metres, count + 1.0)
        });
        (sum / count, count)
    };
    let metres = Plane::from_fn(width, height, |x, y| agreeing(x, y).0);
    let sigma = first.sigma.as_ref().map(|_| {
        Plane::from_fn(width, height, |x, y| {
            let (_, count) = agreeing(x, y);
            stated(x, y).map_or(f32::NAN, |sigma| sigma / count.max(1.0).sqrt())
        })
    });
    let amplitude = first.amplitude.as_ref().map(|own| {
        Plane::from_fn(own.width(), own.height(), |x, y| {
            let all = frames
                .iter()
                .filter_map(|frame| frame.amplitude.as_ref()?.get(x, y));
            let (sum, count) = all.fold((0.0, 0.0f32), |(sum, count), v| (sum + v, count + 1.0));
            sum / count
        })
    });
    DepthFrame {
        metres,
        sigma,
        amplitude,
        ..first.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        radiometry::subtract,
        shot::{Gathering, Limits},
    };
    use drivers::Settings;
    use proptest::prelude::*;
    use std::time::Duration;

    /// So many frames of the synthetic desk, in the pattern of `run` with flash and `rest` without.
    fn burst([run, rest]: [u32; 2], wanted: [usize; 2], noise: f32) -> Burst {
        let address = format!(
            "synthetic:desk?width=160&depth_width=80&pixels=rgb16&flicker=0&jitter=0&noise={noise}"
        );
        let mut device = drivers::open(&address).unwrap();
        let mut gathering = Gathering::new(device.rig(), Limits::default(), wanted);
        let settings = Settings {
            flash_every: run + rest,
            flash_run: run,
            ..Settings::default()
        };
        let mut stream = device.start(&settings).unwrap();
        while !gathering.push(stream.next_frame(Duration::ZERO).unwrap()) {}
        gathering.finish().0.unwrap()
    }

    /// Root mean square difference of the flash's light from what it is without noise, where both are
    /// known.
    fn error(shot: &Shot, truth: &Shot) -> f32 {
        let light = |shot: &Shot| {
            let options = SubtractOptions {
                motion: false,
                align: false,
                ..SubtractOptions::default()
            };
            let found = subtract(&shot.flash, &shot.ambient, &options);
            found.unwrap().light.0
        };
        let (seen, truth) = (light(shot), light(truth));
        let (mut sum, mut count) = (0.0, 0.0);
        for (seen, truth) in seen.samples().iter().zip(truth.samples()) {
            let off = seen[1] - truth[1];
            if off.is_finite() {
                sum += off * off;
                count += 1.0;
            }
        }
        assert!(count > 10_000.0);
        (sum / count).sqrt()
    }

    #[test]
    fn the_noise_of_a_burst_is_what_was_foretold() {
        let truth = merge(&burst([1, 1], [1, 1], 0.0)).unwrap();
        let first = |burst: &Burst| Shot {
            flash: burst.flash[0].clone(),
            ambient: burst.ambient[..1].to_vec(),
            depth: burst.depth[0].clone(),
            rig: burst.rig,
            mask: None,
        };
        let one = first(&burst([1, 1], [1, 1], 3.0));
        let ratio = noise_ratio(&one).unwrap();
        let mut found = Vec::new();
        for (pattern, wanted) in [([1, 1], [8, 8]), ([3, 1], [12, 4]), ([1, 3], [4, 12])] {
            let burst = burst(pattern, wanted, 3.0);
            let used = [burst.flash.len() as u32, burst.ambient.len() as u32];
            let report = BurstReport::new(16, ratio, used);
            let merged = merge(&burst).unwrap();
            let measured = error(&merged, &truth) / error(&one, &truth);
            eprintln!("{used:?}: noise {measured:.3}, foretold {report:?}");
            // What was taken for motion is missing, and the ratio is a median over the picture.
            assert!(
                (measured / report.expected_noise - 1.0).abs() < 0.12,
                "{used:?}: {measured} of {report:?}"
            );
            assert!(drivers::admission::admit_color(&merged.flash, &merged.rig).is_ok());
            found.push(measured);
        }
        // A flash frame holds the room's light too, and so more noise.
        assert!((1.0..4.0).contains(&ratio), "{ratio}");
        assert!(found[0] < found[2], "many ambient frames are no substitute");
    }

    #[test]
    fn distances_are_averaged_too() {
        let truth = burst([1, 1], [1, 1], 0.0);
        let burst = burst([1, 1], [8, 8], 3.0);
        let error = |depth: &DepthFrame| {
            let pairs = depth
                .metres
                .samples()
                .iter()
                .zip(truth.depth[0].metres.samples());
            let off: Vec<f32> = pairs
                .map(|(a, b)| a - b)
                .filter(|off| off.is_finite())
                .collect();
            (off.iter().map(|off| off * off).sum::<f32>() / off.len() as f32).sqrt()
        };
        let merged = merge(&burst).unwrap();
        let ratio = error(&merged.depth) / error(&burst.depth[0]);
        let expected = (burst.depth.len() as f32).sqrt().recip();
        assert!(
            (0.8..1.3).contains(&(ratio / expected)),
            "{ratio} of {expected}"
        );
    }

    #[test]
    fn what_moved_in_one_frame_leaves_no_ghost() {
        let mut burst = burst([1, 1], [5, 5], 1.0);
        let clean = merge(&burst).unwrap();
        if let Pixels::Rgb16(pixels) = &mut burst.flash[0].pixels {
            for y in 40..70 {
                for x in 60..90 {
                    pixels[(x, y)] = [60_000; 3];
                }
            }
        }
        let merged = merge(&burst).unwrap();
        let (Pixels::RgbF32(clean), Pixels::RgbF32(merged)) =
            (&clean.flash.pixels, &merged.flash.pixels)
        else {
            panic!("a merged frame is floating point");
        };
        let (before, after) = (clean[(75, 55)][1], merged[(75, 55)][1]);
        assert!(
            (after / before - 1.0).abs() < 0.05,
            "{before} became {after}"
        );
    }

    #[test]
    fn patterns_follow_the_noise() {
        for (ratio, expected) in [
            (1.0, [1, 1]),
            (2.0, [2, 1]),
            (0.5, [1, 2]),
            (3.0, [3, 1]),
            (100.0, [LONGEST_RUN, 1]),
            (0.01, [1, LONGEST_RUN]),
        ] {
            assert_eq!(pattern(ratio), expected, "{ratio}");
        }
    }

    proptest! {
        /// No split of the same number of frames has less noise.
        #[test]
        fn the_split_is_the_best_there_is(frames in 2u32..200, exponent in -3.0f32..3.0) {
            let ratio = 10f32.powf(exponent);
            let found = split(frames, ratio);
            prop_assert_eq!(found[0] + found[1], frames);
            let least = (1..frames)
                .map(|flash| variance([flash, frames - flash], ratio))
                .fold(f32::INFINITY, f32::min);
            prop_assert!(variance(found, ratio) <= least * (1.0 + 1e-5));
        }
    }
}
