//! Flashes that nobody commanded, a person's or a studio's, told by brightness alone.
//!
//! A flash makes pictures brighter for a moment, and then they are as before. So a brighter picture is
//! held back until one comes that is as dark as those before it; light that stays is the room's.

use crate::frame::{ColorFrame, Illumination, Timestamp};
use std::time::Duration;

/// A picture this much brighter than the room, as a part of its light, was lit by something else.
const RISE: f32 = 0.25;
/// One this near is of the room's light alone.
const SAME: f32 = 0.08;
/// Light, as a fraction of white at unit exposure, that the room counts as at least: below it noise
/// passes for a change.
const DARK: f32 = 0.002;
/// Weight of a new picture in what is known of the room.
const NEW: f32 = 0.3;
/// Lit pictures of one flash that are kept; more tell nothing new and take memory.
const KEPT: usize = 3;
/// Pictures in a row of no clear light after which they are what the room looks like now.
const MOST_STRANGE: u32 = 8;

/// Tells the light of a camera's pictures, in the order in which they were taken.
#[derive(Debug)]
pub struct Witness {
    /// Mean light of the room at unit exposure; `None` before the first picture.
    room: Option<f32>,
    /// Pictures of the flash that shines now, if it is one.
    held: Vec<ColorFrame>,
    /// When it began to shine.
    since: Option<Timestamp>,
    /// Longest time that a flash shines.
    longest: Duration,
    strange: u32,
    /// Pictures whose light stayed unknown.
    pub unlit: u64,
}

impl Witness {
    /// For flashes that shine for at most `longest`.
    pub fn new(longest: Duration) -> Self {
        Self {
            room: None,
            held: Vec::new(),
            since: None,
            longest,
            strange: 0,
            unlit: 0,
        }
    }

    /// Takes a picture, and gives those whose light is known now, in their order. Of one that cannot be
    /// looked at no light is known.
    pub fn tell(&mut self, frame: ColorFrame) -> Vec<ColorFrame> {
        let Some(light) = mean_light(&frame) else {
            self.unlit += 1;
            return Vec::new();
        };
        let room = *self.room.get_or_insert(light);
        let rise = (light - room) / room.max(DARK);
        if rise.abs() <= SAME {
            self.room = Some(room + NEW * (light - room));
            (self.since, self.strange) = (None, 0);
            let lit = self.held.drain(..);
            let mut told: Vec<ColorFrame> = lit
                .map(|frame| labelled(frame, Illumination::Flash))
                .collect();
            told.push(labelled(frame, Illumination::Ambient));
            return told;
        }
        let since = *self.since.get_or_insert(frame.at);
        let shines = frame.at.since(since) <= self.longest;
        if rise >= RISE && shines {
            self.strange = 0;
            if self.held.len() < KEPT {
                self.held.push(frame);
            } else {
                self.unlit += 1;
            }
            return Vec::new();
        }
        self.unlit += 1;
        self.strange += 1;
        if !shines || self.strange >= MOST_STRANGE {
            // No flash: somebody switched a lamp.
            self.unlit += self.held.drain(..).count() as u64;
            (self.since, self.strange) = (None, 0);
            self.room = Some(light);
        }
        Vec::new()
    }
}

fn labelled(frame: ColorFrame, light: Illumination) -> ColorFrame {
    ColorFrame { light, ..frame }
}

/// Mean light at unit exposure, what is clipped counted as white; `None` for a picture that cannot be
/// looked at.
fn mean_light(frame: &ColorFrame) -> Option<f32> {
    let light = frame.sampled_light()?;
    let count = light.len() as f32;
    (count > 0.0).then(|| light.into_iter().sum::<f32>() / count / frame.exposure.factor())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frame::{Exposure, Pixels, Transfer},
        jpeg,
        plane::Plane,
    };
    use proptest::prelude::*;

    const PERIOD: u64 = 40_000_000;
    const LONGEST: Duration = Duration::from_millis(200);

    fn picture(number: u64, light: f32) -> ColorFrame {
        ColorFrame {
            at: Timestamp::from_nanos(PERIOD * (number + 1)),
            sequence: number,
            light: Illumination::Ambient,
            exposure: Exposure::UNIT,
            pixels: Pixels::RgbF32(Plane::filled(4, 4, [light; 3])),
            transfer: Transfer::Linear,
            black_level: 0.0,
            white_level: 1.0,
        }
    }

    fn told(lights: &[f32]) -> (Vec<(u64, Illumination)>, u64) {
        let mut witness = Witness::new(LONGEST);
        let pictures = lights.iter().enumerate();
        let told = pictures.flat_map(|(n, light)| witness.tell(picture(n as u64, *light)));
        let told = told.map(|frame| (frame.sequence, frame.light)).collect();
        (told, witness.unlit)
    }

    use Illumination::{Ambient, Flash};

    #[test]
    fn a_flash_is_told_when_it_is_over_and_in_its_place() {
        let (told, unlit) = told(&[0.1, 0.1, 0.4, 0.1, 0.1]);
        let lights = [Ambient, Ambient, Flash, Ambient, Ambient];
        assert_eq!(told, (0..5).zip(lights).collect::<Vec<_>>());
        assert_eq!(unlit, 0);
    }

    #[test]
    fn the_light_of_jpeg_pictures_is_told_and_of_those_that_lie_none_is() {
        let picture = |number: u64, side: usize, light: u8| ColorFrame {
            pixels: Pixels::Mjpg {
                width: 64,
                height: 64,
                bytes: jpeg(&Plane::filled(side, side, [light; 3]), 90),
            },
            transfer: Transfer::Srgb,
            ..picture(number, 0.0)
        };
        let mut witness = Witness::new(LONGEST);
        let mut told = Vec::new();
        // The fourth is of another size than it says.
        for (number, (side, light)) in [(64, 60), (64, 180), (64, 60), (80, 180), (64, 60)]
            .into_iter()
            .enumerate()
        {
            told.extend(witness.tell(picture(number as u64, side, light)));
        }
        let told: Vec<_> = told.iter().map(|f| (f.sequence, f.light)).collect();
        assert_eq!(told, [(0, Ambient), (1, Flash), (2, Ambient), (4, Ambient)]);
        assert_eq!(witness.unlit, 1);
    }

    #[test]
    fn a_picture_that_a_flash_lit_in_part_is_of_no_known_light() {
        // 13 % more: a flash that ended at the beginning of the exposure.
        let (told, unlit) = told(&[0.1, 0.3, 0.113, 0.1]);
        assert_eq!(told, [(0, Ambient), (1, Flash), (3, Ambient)]);
        assert_eq!(unlit, 1);
    }

    #[test]
    fn a_lamp_that_is_switched_on_is_no_flash_and_then_the_room() {
        let mut lights = vec![0.1; 3];
        lights.extend([0.4; 20]);
        lights.extend([0.9, 0.4]);
        let (told, _) = told(&lights);
        let flashes: Vec<u64> = told
            .iter()
            .filter(|(_, light)| *light == Flash)
            .map(|(number, _)| *number)
            .collect();
        assert_eq!(flashes, [23], "only the flash in the brighter room");
        assert!(told.contains(&(22, Ambient)));
    }

    proptest! {
        /// Rooms of any light with noise, flashes of any strength and length, each from the beginning
        /// of an exposure to the end of one: no picture has the other light's name, and flashes that
        /// are not too long are told.
        #[test]
        fn a_light_that_is_told_is_true(
            room in 0.004f32..0.5,
            flashes in prop::collection::vec((2usize..8, 1usize..5, 0.4f32..5.0), 1..12),
            noise in prop::collection::vec(-0.02f32..0.02, 200),
        ) {
            let mut truth = Vec::new();
            let mut lights = Vec::new();
            let mut noise = noise.into_iter().cycle();
            let mut shine = |lights: &mut Vec<f32>, truth: &mut Vec<Illumination>, count: usize, factor: f32, light| {
                for _ in 0..count {
                    let noise: f32 = noise.next().unwrap_or(0.0);
                    lights.push((room * factor * (1.0 + noise)).min(1.0));
                    truth.push(light);
                }
            };
            for (pause, length, strength) in &flashes {
                shine(&mut lights, &mut truth, *pause, 1.0, Ambient);
                shine(&mut lights, &mut truth, *length, 1.0 + strength, Flash);
            }
            shine(&mut lights, &mut truth, 3, 1.0, Ambient);
            let (told, _) = told(&lights);
            for (number, light) in &told {
                prop_assert_eq!(truth[*number as usize], *light);
            }
            let count = told.iter().filter(|(_, light)| *light == Flash).count();
            let expected: usize = flashes.iter().map(|(_, length, _)| (*length).min(KEPT)).sum();
            prop_assert_eq!(count, expected);
        }
    }
}
