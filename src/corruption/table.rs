//! The eighteen corruptions of FlashToF-C: name, what happens, and how much at each severity.

use super::{
    bright_ambient, depth_holes, depth_resolution, flash_saturation, flying_pixels, hand_shake,
    infrared_black, jpeg_artefacts, mains_flicker, mirror, misalignment, motion, multipath,
    phase_wrap, sensor_noise, thin_structures, tof_noise, wrong_transfer,
};
use crate::{radiometry::RadiometryError, shot::Shot};
use drivers::chance::Chance;
use thiserror::Error;

/// The highest severity; 0 leaves a shot as it is.
pub const MOST_SEVERE: u8 = 5;

/// Why a shot was not made worse.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CorruptionError {
    /// There is no such corruption.
    #[error("there is no corruption \"{name}\"; there are {}", names())]
    Unknown {
        /// What was asked for.
        name: String,
    },
    /// A severity beyond the last.
    #[error("{name}: severity {severity} is outside 0 (unchanged) to {MOST_SEVERE} (worst)")]
    Severity {
        /// The corruption.
        name: &'static str,
        /// What was asked for.
        severity: u8,
    },
    /// Not one depth sample has an answer.
    #[error("the capture has no depth sample with an answer; spoil a capture that has depth")]
    NoDepth,
    /// A photograph in which everything is dark, clipped or unknown.
    #[error("the {photograph} photograph is dark, clipped or unknown everywhere; take another")]
    NoLight {
        /// Which one.
        photograph: &'static str,
    },
    /// A photograph that cannot be read.
    #[error(transparent)]
    Radiometry(#[from] RadiometryError),
}

/// One way to make a shot worse, in five levels.
#[derive(Debug, Clone, Copy)]
pub struct Corruption {
    /// As typed.
    pub name: &'static str,
    /// What happens, in plain words.
    pub description: &'static str,
    /// How much happens at severity 1 to 5.
    pub levels: [f32; MOST_SEVERE as usize],
    /// What the levels count.
    pub unit: &'static str,
    at_level: fn(&Shot, f32, Chance) -> Result<Shot, CorruptionError>,
}

impl Corruption {
    /// The one of this name.
    ///
    /// # Errors
    /// [`CorruptionError::Unknown`], listing all names.
    pub fn named(name: &str) -> Result<&'static Self, CorruptionError> {
        let found = CORRUPTIONS
            .iter()
            .find(|corruption| corruption.name == name);
        found.ok_or_else(|| CorruptionError::Unknown { name: name.into() })
    }

    /// Whether it changes the depth and leaves the photographs alone; else it is the other way
    /// round.
    pub fn spoils_depth(&self) -> bool {
        !matches!(
            self.name,
            "bright-ambient"
                | "flash-saturation"
                | "motion"
                | "hand-shake"
                | "mains-flicker"
                | "wrong-transfer"
                | "sensor-noise"
                | "jpeg"
        )
    }

    /// The shot as it would have come out: a function of its arguments and nothing else. Severity 0
    /// returns it bit for bit; with one seed, what a severity spoils a higher one spoils more.
    ///
    /// A changed photograph is linear floating point afterwards, NaN where it clipped (after
    /// `jpeg`, a JPEG). The depth camera's own sigma is dropped where its depth was changed.
    ///
    /// # Errors
    /// [`CorruptionError::Severity`] above [`MOST_SEVERE`]; [`CorruptionError::NoDepth`],
    /// [`CorruptionError::NoLight`] and [`CorruptionError::Radiometry`] for a shot without what is
    /// to be spoiled.
    pub fn on_shot(&self, shot: &Shot, severity: u8, seed: u64) -> Result<Shot, CorruptionError> {
        let Some(step) = severity.checked_sub(1) else {
            return Ok(shot.clone());
        };
        let level = self.levels.get(usize::from(step));
        let level = level.ok_or(CorruptionError::Severity {
            name: self.name,
            severity,
        })?;
        // Two corruptions of one shot must not share their dice.
        let key = self.name.bytes().fold(0_u64, |key, letter| {
            key.wrapping_mul(257).wrapping_add(u64::from(letter))
        });
        (self.at_level)(shot, *level, Chance::new(seed).of(key))
    }
}

fn names() -> String {
    CORRUPTIONS.map(|corruption| corruption.name).join(", ")
}

/// All of them, in the order of the charts: depth, light, surfaces. Pixels are those of a picture
/// of 256×256; larger pictures are spoiled as much in proportion.
pub static CORRUPTIONS: [Corruption; 18] = [
    Corruption {
        name: "tof-noise",
        description: "noise on depth, more where little infrared comes back",
        levels: [2.0, 5.0, 10.0, 20.0, 40.0],
        unit: "mm standard deviation at the median amplitude",
        at_level: tof_noise::on_shot,
    },
    Corruption {
        name: "depth-holes",
        description: "patches of depth without an answer",
        levels: [2.0, 5.0, 10.0, 20.0, 40.0],
        unit: "% of the samples lost",
        at_level: depth_holes::on_shot,
    },
    Corruption {
        name: "flying-pixels",
        description: "samples beside a step hang between front and back",
        levels: [10.0, 25.0, 50.0, 75.0, 100.0],
        unit: "% of the samples within 2 pixels of a step",
        at_level: flying_pixels::on_shot,
    },
    Corruption {
        name: "multipath",
        description: "infrared that arrives over a second surface makes corners deeper; nothing happens on a flat wall",
        levels: [0.5, 1.0, 2.0, 4.0, 8.0],
        unit: "× the one-bounce light at 80 MHz",
        at_level: multipath::on_shot,
    },
    Corruption {
        name: "phase-wrap",
        description: "what lies beyond the camera's range is taken for near",
        levels: [3.0, 6.0, 12.0, 25.0, 50.0],
        unit: "% of the samples, the farthest, lie beyond the range",
        at_level: phase_wrap::on_shot,
    },
    Corruption {
        name: "misalignment",
        description: "depth lies beside the photograph, as after a knock on the rig",
        levels: [0.5, 1.0, 2.0, 4.0, 8.0],
        unit: "pixels in one direction",
        at_level: misalignment::on_shot,
    },
    Corruption {
        name: "low-depth-resolution",
        description: "a depth camera of fewer pixels",
        levels: [2.0, 3.0, 4.0, 6.0, 8.0],
        unit: "× as coarse a side",
        at_level: depth_resolution::on_shot,
    },
    Corruption {
        name: "bright-ambient",
        description: "a brighter room: its noise stays when its light is subtracted; where the room was dark it is lit as the flash lights it",
        levels: [1.0, 3.0, 6.0, 14.0, 30.0],
        unit: "× the flash's mean light added",
        at_level: bright_ambient::on_shot,
    },
    Corruption {
        name: "flash-saturation",
        description: "the brightest pixels of the flash photograph clip",
        levels: [1.0, 3.0, 8.0, 20.0, 40.0],
        unit: "% of the pixels",
        at_level: flash_saturation::on_shot,
    },
    Corruption {
        name: "motion",
        description: "something moves between flash and ambient photograph; a dark room is lit first, half as bright as the flash",
        levels: [1.0, 2.0, 4.0, 8.0, 16.0],
        unit: "pixels, inside an ellipse half as wide and high as the picture",
        at_level: motion::on_shot,
    },
    Corruption {
        name: "hand-shake",
        description: "each photograph is smeared along its own line, and the ambient one lies beside the flash photograph",
        levels: [1.0, 2.0, 4.0, 8.0, 16.0],
        unit: "pixels",
        at_level: hand_shake::on_shot,
    },
    Corruption {
        name: "mains-flicker",
        description: "the room's lamps pulse while rows are read out, each photograph in another phase; a dark room is lit first, half as bright as the flash",
        levels: [5.0, 10.0, 20.0, 40.0, 80.0],
        unit: "% of the room's light, up and down",
        at_level: mains_flicker::on_shot,
    },
    Corruption {
        name: "wrong-transfer",
        description: "pixel values follow another curve than the one stated",
        levels: [1.05, 1.1, 1.2, 1.4, 1.8],
        unit: "gamma too much",
        at_level: wrong_transfer::on_shot,
    },
    Corruption {
        name: "sensor-noise",
        description: "shot and read noise of a sensor at high gain, in all photographs",
        levels: [2.0, 4.0, 8.0, 16.0, 32.0],
        unit: "× gain of a sensor of 8000 electrons",
        at_level: sensor_noise::on_shot,
    },
    Corruption {
        name: "jpeg",
        description: "photographs of 8 bits, stored as JPEG",
        levels: [90.0, 70.0, 50.0, 25.0, 8.0],
        unit: "JPEG quality",
        at_level: jpeg_artefacts::on_shot,
    },
    Corruption {
        name: "infrared-black",
        description: "the surfaces that send least infrared back swallow nearly all of it: seven samples in ten without an answer, the rest wrong by 5 %",
        levels: [5.0, 10.0, 20.0, 30.0, 50.0],
        unit: "% of the samples",
        at_level: infrared_black::on_shot,
    },
    Corruption {
        name: "mirror",
        description: "patches of surface mirror infrared: depth is that of what they show, behind them",
        levels: [2.0, 5.0, 10.0, 20.0, 35.0],
        unit: "% of the samples",
        at_level: mirror::on_shot,
    },
    Corruption {
        name: "thin-structures",
        description: "thin things before a background are missing in depth; nothing happens where there are none",
        levels: [2.0, 4.0, 6.0, 10.0, 16.0],
        unit: "pixels wide, at most",
        at_level: thin_structures::on_shot,
    },
];
