//! The photographs of a shot as light, to be spoiled and put back.

use super::{CorruptionError, field::upper};
use crate::{radiometry, shot::Shot};
use drivers::{ColorFrame, Illumination, Pixels, Plane, Timestamp, Transfer, chance::Chance};

/// Electrons at the picture's white and base gain, and of read noise: the synthetic camera's.
const FULL_WELL: f32 = 8000.0;
const READ_NOISE: f32 = 4.0;
/// Share of the pixels brighter than white: highlights.
const HIGHLIGHTS_PERCENT: f32 = 1.0;
/// Of the flash's light, where a room must be lit to be spoiled.
const MADE_ROOM: f32 = 0.5;
/// A room under this share of the flash's mean light is dark.
const DARK: f32 = 1e-3;

/// Linear light, unit exposure; NaN (all three) = clipped or unknown.
pub(super) type Light = Plane<[f32; 3]>;

/// The light of each photograph.
pub(super) struct Photographs {
    /// Flash and room.
    pub flash: Light,
    /// The room alone; one for each ambient frame.
    pub ambient: Vec<Light>,
}

impl Photographs {
    /// Decodes them.
    pub fn of(shot: &Shot) -> Result<Self, CorruptionError> {
        let light = |frame: &ColorFrame| radiometry::linearise(frame).map(|light| light.0);
        Ok(Self {
            flash: light(&shot.flash)?,
            ambient: shot.ambient.iter().map(light).collect::<Result<_, _>>()?,
        })
    }

    /// Decodes them and makes sure that there is room light to be spoiled: where there is no ambient
    /// frame, or a dark one, the room becomes half as bright as the flash and lit from the same side.
    pub fn in_lit_room(shot: &Shot) -> Result<Self, CorruptionError> {
        let mut light = Self::of(shot)?;
        if !light.room_is_lit()? {
            let room = light.flash.map(|rgb| rgb.map(|value| MADE_ROOM * value));
            light.brighten(&room);
        }
        Ok(light)
    }

    /// True where the ambient photograph shows more than a trace of the flash photograph's light.
    pub fn room_is_lit(&self) -> Result<bool, CorruptionError> {
        let flash = mean(&self.flash).filter(|mean| *mean > 0.0);
        let flash = flash.ok_or(CorruptionError::NoLight {
            photograph: "flash",
        })?;
        let room = self.ambient.first().and_then(mean);
        Ok(room.is_some_and(|room| room > DARK * flash))
    }

    /// Adds light to the room, in all photographs; makes the ambient one where there is none.
    pub fn brighten(&mut self, room: &Light) {
        if self.ambient.is_empty() {
            self.ambient.push(room.map(|_| [0.0; 3]));
        }
        for light in std::iter::once(&mut self.flash).chain(&mut self.ambient) {
            for (to, from) in light.samples_mut().iter_mut().zip(room.samples()) {
                *to = std::array::from_fn(|channel| to[channel] + from[channel]);
            }
        }
    }

    /// The shot with these photographs, as linear floating point at each frame's own exposure.
    pub fn into_shot(self, shot: &Shot) -> Shot {
        let mut frames = shot.ambient.clone();
        if frames.is_empty() && !self.ambient.is_empty() {
            let before = shot.flash.at.as_nanos().saturating_sub(1);
            frames.push(ColorFrame {
                at: Timestamp::from_nanos(before),
                sequence: shot.flash.sequence.saturating_sub(1),
                light: Illumination::Ambient,
                ..shot.flash.clone()
            });
        }
        let ambient = frames.iter().zip(&self.ambient);
        Shot {
            flash: showing(&shot.flash, &self.flash),
            ambient: ambient
                .map(|(frame, light)| showing(frame, light))
                .collect(),
            ..shot.clone()
        }
    }

    /// The light that all but the highlights of the flash photograph stay under.
    pub fn white(&self) -> Result<f32, CorruptionError> {
        let white = upper(brightest(&self.flash), HIGHLIGHTS_PERCENT).filter(|white| *white > 0.0);
        white.ok_or(CorruptionError::NoLight {
            photograph: "flash",
        })
    }

    /// Adds shot and read noise of a sensor at this gain, its exposure set so that all but the
    /// highlights stay under its white; noise in each photograph is its own.
    pub fn add_noise(&mut self, gain: f32, chance: Chance) -> Result<(), CorruptionError> {
        let white = self.white()?;
        let electron = white * gain / FULL_WELL;
        let lights = std::iter::once(&mut self.flash).chain(&mut self.ambient);
        for (photograph, light) in (0..).zip(lights) {
            let chance = chance.of(photograph);
            for (counter, value) in (0..).zip(light.samples_mut().as_flattened_mut()) {
                let variance = value.max(0.0) * electron + (READ_NOISE * electron).powi(2);
                *value += variance.sqrt() * chance.normal(counter);
            }
        }
        Ok(())
    }
}

/// A frame that shows other light.
fn showing(frame: &ColorFrame, light: &Light) -> ColorFrame {
    let factor = frame.exposure.factor();
    ColorFrame {
        pixels: Pixels::RgbF32(light.map(|rgb| rgb.map(|value| value * factor))),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
        ..frame.clone()
    }
}

/// The brightest channel of every pixel, NaN where unknown.
pub(super) fn brightest(light: &Light) -> impl Iterator<Item = f32> {
    let pixels = light.samples().iter();
    pixels.map(|[red, green, blue]| red.max(*green).max(*blue))
}

/// Mean of all channels of the known pixels; `None` where there are none.
pub(super) fn mean(light: &Light) -> Option<f32> {
    let known = light.samples().as_flattened().iter();
    let known = known.filter(|value| value.is_finite());
    let (sum, count) = known.fold((0.0, 0_u64), |(sum, count), value| {
        (sum + f64::from(*value), count + 1)
    });
    (count > 0).then(|| (sum / count as f64) as f32)
}

/// Light at a place between pixels, linear; beyond the border its nearest pixel.
pub(super) fn sampled(light: &Light, x: f32, y: f32) -> [f32; 3] {
    let (width, height) = light.size();
    let x = x.clamp(0.0, (width - 1) as f32);
    let y = y.clamp(0.0, (height - 1) as f32);
    let (left, top) = (x as usize, y as usize);
    let (across, down) = (x - left as f32, y - top as f32);
    let mut sum = [0.0; 3];
    for (column, row, weight) in [
        (left, top, (1.0 - across) * (1.0 - down)),
        (left + 1, top, across * (1.0 - down)),
        (left, top + 1, (1.0 - across) * down),
        (left + 1, top + 1, across * down),
    ] {
        // An unknown pixel must not reach where it has no weight.
        if weight > 0.0 {
            let rgb = light[(column, row)];
            sum = std::array::from_fn(|channel| sum[channel] + weight * rgb[channel]);
        }
    }
    sum
}
