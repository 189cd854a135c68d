//! A shot's color frames → the light of the flash alone.

use super::align::{AlignmentOutcome, Anchor};
use super::levels::Levels;
use super::noise::Grid;
use super::warp::{Resampled, Warp, resample_row};
use super::{
    FlashOnly, LinearImage, NoiseModel, RadiometryError, Sensor, SubtractionReport, decode,
    demosaic, exposure, linearise, motion, report,
};
use drivers::{ColorFrame, Pixels, Plane};
use rayon::prelude::*;

/// What to take into account; by default everything that needs no guess.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubtractOptions {
    /// Align the ambient frames on the flash frame.
    pub align: bool,
    /// Divide each frame by its own exposure; false = subtract pixel values as if all frames
    /// had the flash frame's exposure.
    pub use_exposure: bool,
    /// Mask what moved between the frames.
    pub motion: bool,
    /// Where the frames' exposures are unknown: estimate their ratio from the pictures, in place
    /// of the stated exposures.
    pub estimate_exposure: bool,
    /// The sensor's data, where known; `None` = noise is measured in the picture.
    pub sensor: Option<Sensor>,
}

impl Default for SubtractOptions {
    fn default() -> Self {
        Self {
            align: true,
            use_exposure: true,
            motion: true,
            estimate_exposure: false,
            sensor: None,
        }
    }
}

/// Takes the room's light out of the flash frame: `flash − Σ wᵢ ambientᵢ`, in linear light at
/// unit exposure, with its variance.
///
/// Without an ambient frame `flash` is flash-only already. Of two ambient frames the light at the
/// flash's moment is interpolated linearly in time (never extrapolated); more are averaged.
///
/// # Errors
/// What [`linearise`] refuses in any frame, [`RadiometryError::SizesDiffer`] when an ambient
/// frame has another size, [`RadiometryError::NoUsablePixel`] when nothing is left.
pub fn subtract(
    flash: &ColorFrame,
    ambient: &[ColorFrame],
    options: &SubtractOptions,
) -> Result<FlashOnly, RadiometryError> {
    let (width, height) = flash.pixels.size();
    for frame in ambient {
        let (found_width, found_height) = frame.pixels.size();
        if (found_width, found_height) != (width, height) {
            return Err(RadiometryError::SizesDiffer {
                frame: "an ambient frame",
                width,
                height,
                found_width,
                found_height,
            });
        }
    }
    let mut light = linearise(flash)?;
    let scatter = Scatter::of(flash, &light, options)?;
    let moments: Vec<u64> = ambient.iter().map(|frame| frame.at.as_nanos()).collect();
    let anchor = (options.align && !ambient.is_empty()).then(|| Anchor::of(&light));
    let mut rooms = Vec::with_capacity(ambient.len());
    for (frame, weight) in ambient.iter().zip(weights(flash.at.as_nanos(), &moments)) {
        if weight > 0.0 || options.motion {
            rooms.push(Room::of(
                frame,
                weight,
                flash,
                &light,
                anchor.as_ref(),
                options,
            )?);
        }
    }

    let mut variance = Plane::filled(width, height, 0.0f32);
    let mut suspects = Plane::filled(width, height, 0u8);
    let search = options.motion && !rooms.is_empty();
    let agreement = if rooms.len() == 2 {
        motion::agreement(&rooms[0].light, &rooms[1].light)
    } else {
        1.0
    };
    let columns = report::sample_stride(width, height);
    let tallies: Vec<RowTally> = light
        .0
        .samples_mut()
        .par_chunks_mut(width)
        .zip(variance.samples_mut().par_chunks_mut(width))
        .zip(suspects.samples_mut().par_chunks_mut(width))
        .enumerate()
        .map_init(
            || vec![Vec::new(); rooms.len()],
            |moved, (y, ((light, variance), suspects))| {
                let mut tally = RowTally::default();
                let rows = rooms.iter().zip(moved.iter_mut());
                let rows: Vec<Row<'_>> = rows.map(|(room, row)| room.row(y, row)).collect();
                for x in 0..width {
                    let mut room_light = [0.0f32; 3];
                    let mut room_variance = 0.0f32;
                    let mut inside = true;
                    for (room, row) in rooms.iter().zip(rows.iter()) {
                        let seen = row.at(x);
                        inside &= seen.inside;
                        if room.weight > 0.0 {
                            for (sum, channel) in room_light.iter_mut().zip(seen.light) {
                                *sum += room.weight * room.scale * channel;
                            }
                            let gain = room.weight * room.scale;
                            room_variance += gain
                                * gain
                                * seen.variance_factor
                                * room.scatter.variance(seen.light);
                        }
                    }
                    let flash_variance = scatter.variance(light[x]);
                    let difference: [f32; 3] =
                        std::array::from_fn(|channel| light[x][channel] - room_light[channel]);
                    let sum: f32 = difference.iter().sum();
                    let fate = sum * 0.0;
                    let total = flash_variance + room_variance + fate;
                    tally.clipped += usize::from(sum.is_nan() && (inside || light[x][0].is_nan()));
                    if search && sum.is_finite() {
                        let against_room =
                            motion::exceeds(sum, total, room_light.iter().sum::<f32>());
                        let between_rooms = rows.len() == 2 && {
                            let seen = [rows[0].at(x), rows[1].at(x)];
                            let variances: [f32; 2] = std::array::from_fn(|i| {
                                seen[i].variance_factor * rooms[i].scatter.variance(seen[i].light)
                            });
                            motion::disagree(seen[0].light, seen[1].light, variances, agreement)
                        };
                        suspects[x] = u8::from(against_room || between_rooms);
                    }
                    if !rooms.is_empty() && y % columns == 0 && x % columns == 0 && sum.is_finite()
                    {
                        tally
                            .room_to_flash
                            .push(report::ratio(room_light.iter().sum(), sum));
                    }
                    light[x] = difference.map(|channel| channel + fate);
                    variance[x] = total;
                }
                tally
            },
        )
        .collect();
    let alignment = rooms.first().map(|room| (room.warp, room.outcome));
    let exposure_ratio = rooms.first().map_or(1.0, |room| room.exposure_ratio);
    drop(rooms);

    let pixels = (width * height) as f32;
    let moved = if search {
        motion::mask(&suspects, &mut light, &mut variance)
    } else {
        0
    };
    drop(suspects);
    let clipped: usize = tallies.iter().map(|tally| tally.clipped).sum();
    let quality = report::quality(&light, &variance);
    if quality.usable == 0 {
        return Err(RadiometryError::NoUsablePixel {
            clipped_percent: clipped as f32 / pixels * 100.0,
        });
    }
    let ratios = tallies
        .into_iter()
        .flat_map(|tally| tally.room_to_flash)
        .collect();
    let (warp, outcome) =
        alignment.unwrap_or((Warp::identity(width, height), AlignmentOutcome::NotNeeded));
    let report = SubtractionReport {
        shift_pixels: warp.shift().map(|shift| 0.0 - shift),
        corner_shift_pixels: warp.corner_shift(),
        alignment: outcome,
        clipped_fraction: clipped as f32 / pixels,
        moved_fraction: moved as f32 / pixels,
        negative_fraction: quality.negative_fraction,
        inconsistent_fraction: quality.inconsistent_fraction,
        ambient_to_flash: report::median(ratios).unwrap_or(0.0),
        exposure_ratio,
        exposure_estimated: options.estimate_exposure && !ambient.is_empty(),
        snr_db: quality.snr_db,
        weak_fraction: quality.weak_fraction,
    };
    Ok(FlashOnly {
        light,
        variance,
        report,
    })
}

/// What one row found.
#[derive(Default)]
struct RowTally {
    clipped: usize,
    room_to_flash: Vec<f32>,
}

/// The share of each ambient frame in the room's light at `flash_at`; sums to 1.
fn weights(flash_at: u64, ambient_at: &[u64]) -> Vec<f32> {
    match *ambient_at {
        [first, second] => {
            let span = second as f64 - first as f64;
            let along = if span == 0.0 {
                0.5
            } else {
                ((flash_at as f64 - first as f64) / span).clamp(0.0, 1.0)
            };
            vec![(1.0 - along) as f32, along as f32]
        }
        _ => vec![1.0 / ambient_at.len() as f32; ambient_at.len()],
    }
}

/// One ambient frame, ready to be taken away.
struct Room {
    light: LinearImage,
    warp: Warp,
    outcome: AlignmentOutcome,
    scatter: Scatter,
    weight: f32,
    /// Factor on the linear light; 1 where exposures are as stated.
    scale: f32,
    exposure_ratio: f32,
}

impl Room {
    fn of(
        frame: &ColorFrame,
        weight: f32,
        flash: &ColorFrame,
        flash_light: &LinearImage,
        anchor: Option<&Anchor>,
        options: &SubtractOptions,
    ) -> Result<Self, RadiometryError> {
        let light = linearise(frame)?;
        let scatter = Scatter::of(frame, &light, options)?;
        let (width, height) = light.0.size();
        let (warp, outcome) = if let Some(anchor) = anchor {
            let found = anchor.align(&light);
            (found.warp, found.outcome)
        } else {
            (Warp::identity(width, height), AlignmentOutcome::NotAsked)
        };
        // Light of this frame times `scale` is the room's light in the flash frame.
        let stated = flash.exposure.factor() / frame.exposure.factor();
        let scale = if options.estimate_exposure {
            exposure::ratio(flash_light, &light, &warp).unwrap_or(1.0)
        } else if options.use_exposure {
            1.0
        } else {
            stated.recip()
        };
        let exposure_ratio = stated * scale;
        Ok(Self {
            light,
            warp,
            outcome,
            scatter,
            weight,
            scale,
            exposure_ratio,
        })
    }

    /// Row `y` as the flash frame sees it; where that moves, it takes the place of what `moved` held.
    fn row<'a>(&'a self, y: usize, moved: &'a mut Vec<Resampled>) -> Row<'a> {
        let still = self.light.0.row(y);
        if self.warp.is_identity() {
            return Row::Still(still);
        }
        moved.resize(still.len(), Resampled::still([f32::NAN; 3]));
        resample_row(&self.light, &self.warp, y, moved);
        Row::Moved(moved)
    }
}

/// A row of an ambient frame.
enum Row<'a> {
    /// As it lies.
    Still(&'a [[f32; 3]]),
    /// Resampled.
    Moved(&'a [Resampled]),
}

impl Row<'_> {
    #[inline(always)]
    fn at(&self, x: usize) -> Resampled {
        match self {
            Self::Still(row) => Resampled::still(row[x]),
            Self::Moved(row) => row[x],
        }
    }
}

/// Steps of the quantisation table.
const QUANTISATION_STEPS: usize = 256;

/// Variance of a frame's light at unit exposure.
pub(super) struct Scatter {
    model: NoiseModel,
    /// From the sum of a light's channels to their mean as a share of white.
    per_sum: f32,
    /// From a variance of that share to one of light.
    per_share: f32,
    /// By the square root of light, which spreads dark values as most transfer curves do.
    quantisation: [f32; QUANTISATION_STEPS],
}

impl Scatter {
    pub(super) fn of(
        frame: &ColorFrame,
        light: &LinearImage,
        options: &SubtractOptions,
    ) -> Result<Self, RadiometryError> {
        let (step, grid) = match &frame.pixels {
            Pixels::Bayer { pattern, .. } => (
                decode::STEP_16,
                Grid::BayerGreen {
                    offset: demosaic::green_offset(*pattern),
                },
            ),
            Pixels::Rgb16(_) => (decode::STEP_16, Grid::Full),
            Pixels::RgbF32(_) => (0.0, Grid::Full),
            _ => (decode::STEP_8, Grid::Full),
        };
        let levels = Levels::of(frame, step)?;
        let model = match &options.sensor {
            Some(sensor) => NoiseModel::of_sensor(sensor, frame.exposure.gain),
            None => NoiseModel::estimate(light, levels.factor, grid),
        };
        let quantisation = std::array::from_fn(|i| {
            let root = i as f32 / (QUANTISATION_STEPS - 1) as f32;
            let value = super::transfer::encode(levels.transfer, root * root);
            levels.quantisation(levels.black + levels.span * value)
        });
        Ok(Self {
            model,
            per_sum: levels.factor / 3.0,
            per_share: 1.0 / (levels.factor * levels.factor),
            quantisation,
        })
    }

    /// Mean variance of the channels of `light`.
    pub(super) fn variance(&self, light: [f32; 3]) -> f32 {
        let relative = (light[0] + light[1] + light[2]).max(0.0) * self.per_sum;
        let index = (relative.sqrt() * (QUANTISATION_STEPS - 1) as f32) as usize;
        let quantisation = self.quantisation[index.min(QUANTISATION_STEPS - 1)];
        (self.model.variance(relative) + quantisation) * self.per_share
    }
}
