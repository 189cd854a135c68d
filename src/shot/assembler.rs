//! Frames in any order → shots, by the time they were exposed.

use super::{
    DropCounts, Shot,
    evidence::{Brightness, Comparison},
};
use drivers::{ColorFrame, DepthFrame, Frame, Illumination, Rig, Timestamp, admission};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeSet, time::Duration};

/// How far apart frames of one shot may lie, and how long one is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Longest time between a flash frame and an ambient frame of its shot, seconds.
    pub bracket_seconds: f32,
    /// Longest time between a flash frame and its depth frame, seconds.
    pub depth_seconds: f32,
    /// Color frames, exposed later than a flash frame, after which its shot is made from what is
    /// there.
    pub patience_frames: u32,
    /// Most color frames, and most depth frames, held at once.
    pub pending_frames: usize,
    /// Make a shot with an ambient frame on one side only.
    pub allow_one_ambient: bool,
    /// Least relative rise of light, in the brightest tenth of the picture, that proves a flash.
    pub flash_rise: f32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            bracket_seconds: 0.25,
            depth_seconds: 0.05,
            patience_frames: 5,
            pending_frames: 8,
            allow_one_ambient: true,
            flash_rise: 0.1,
        }
    }
}

/// Start times remembered of each camera, so that no frame is used twice.
const REMEMBERED: usize = 256;

/// Puts shots together from frames that come late, twice, out of order or not at all.
///
/// A shot is made of a flash frame, the nearest unused ambient frames before and after it, and the
/// nearest unused depth frame, all by exposure time. It is given out as soon as all are there and
/// no nearer depth frame can be expected; when `patience_frames` color frames have passed, a shot is
/// made with one ambient frame if need be, and a flash frame without any, or without depth, is
/// dropped. The light of a flash frame must be proved by its pixels against each ambient frame of
/// its shot. Where they contradict it, the flash frame and the frames that contradict it are all
/// dropped: which of them is mislabelled cannot be known.
///
/// Holds at most [`Limits::pending_frames`] frames of each camera; knows no clock. Frames older than
/// everything remembered count as late for good, so a device whose clock was set back needs a new
/// assembler.
#[derive(Debug)]
pub struct Assembler {
    rig: Rig,
    limits: Limits,
    pub(super) color: Vec<Pending>,
    pub(super) depth: Vec<DepthFrame>,
    pub(super) color_seen: Seen,
    depth_seen: Seen,
    drops: DropCounts,
}

#[derive(Debug)]
pub(super) struct Pending {
    frame: ColorFrame,
    brightness: Brightness,
    /// Color frames that came since and were exposed later.
    overtaken: u32,
}

/// Start times of frames that were let in.
#[derive(Debug, Default)]
pub(super) struct Seen {
    pub(super) times: BTreeSet<Timestamp>,
    /// Everything up to here was forgotten.
    floor: Option<Timestamp>,
}

enum Newness {
    New,
    Duplicate,
    Late,
}

impl Seen {
    fn note(&mut self, at: Timestamp) -> Newness {
        if self.floor.is_some_and(|floor| at <= floor) {
            return Newness::Late;
        }
        if !self.times.insert(at) {
            return Newness::Duplicate;
        }
        if self.times.len() > REMEMBERED {
            self.floor = self.times.pop_first();
        }
        Newness::New
    }
}

impl Assembler {
    /// An assembler for the frames of one device in one session.
    pub fn new(rig: Rig, limits: Limits) -> Self {
        Self {
            rig,
            limits,
            color: Vec::new(),
            depth: Vec::new(),
            color_seen: Seen::default(),
            depth_seen: Seen::default(),
            drops: DropCounts::default(),
        }
    }

    /// Takes a frame; gives a shot when one is complete. At most one shot becomes complete with a
    /// frame in practice; should it be more, the next call gives the next.
    pub fn push(&mut self, frame: Frame) -> Option<Shot> {
        if admission::admit(&frame, &self.rig).is_err() {
            self.drops.malformed += 1;
            return self.next_shot(false);
        }
        let seen = match frame {
            Frame::Color(_) => &mut self.color_seen,
            Frame::Depth(_) => &mut self.depth_seen,
        };
        match seen.note(frame.at()) {
            Newness::Duplicate => self.drops.duplicate += 1,
            Newness::Late => self.drops.late += 1,
            Newness::New => match frame {
                Frame::Color(frame) => self.take_color(frame),
                Frame::Depth(frame) => {
                    self.depth.push(frame);
                }
            },
        }
        let shot = self.next_shot(false);
        self.make_room();
        shot
    }

    /// Makes shots of what remains, at the end of a recording; frames left over are counted as
    /// unused. The assembler still knows what it has seen.
    pub fn finish(&mut self) -> Vec<Shot> {
        let shots: Vec<Shot> = std::iter::from_fn(|| self.next_shot(true)).collect();
        self.drops.unused_ambient += self.color.drain(..).count() as u64;
        self.drops.unused_depth += self.depth.drain(..).count() as u64;
        shots
    }

    /// What was dropped so far.
    pub fn drops(&self) -> &DropCounts {
        &self.drops
    }

    fn take_color(&mut self, frame: ColorFrame) {
        let Some(brightness) = Brightness::of(&frame) else {
            self.drops.unreadable += 1;
            return;
        };
        for pending in &mut self.color {
            pending.overtaken += u32::from(frame.at > pending.frame.at);
        }
        self.color.push(Pending {
            frame,
            brightness,
            overtaken: 0,
        });
    }

    /// Lets go of the frames that came first where too many are held.
    fn make_room(&mut self) {
        let most = self.limits.pending_frames.max(1);
        while self.color.len() > most {
            let dropped = self.color.remove(0);
            match dropped.frame.light {
                Illumination::Ambient => self.drops.unused_ambient += 1,
                // Never decided in time: frames before it in time kept coming.
                Illumination::Flash => self.drops.flash_without_ambient += 1,
            }
        }
        while self.depth.len() > most {
            self.depth.remove(0);
            self.drops.unused_depth += 1;
        }
    }

    /// Decides flash frames, earliest first, until one makes a shot.
    fn next_shot(&mut self, force: bool) -> Option<Shot> {
        loop {
            let mut flashes: Vec<Timestamp> = self
                .color
                .iter()
                .filter(|pending| pending.frame.light == Illumination::Flash)
                .map(|pending| pending.frame.at)
                .collect();
            flashes.sort_unstable();
            let at = flashes.into_iter().find(|at| force || self.is_ripe(*at))?;
            if let Some(shot) = self.decide(at) {
                return Some(shot);
            }
        }
    }

    fn is_ripe(&self, at: Timestamp) -> bool {
        let waited = self
            .color
            .iter()
            .find(|pending| pending.frame.at == at)
            .is_some_and(|flash| {
                flash.overtaken >= self.limits.patience_frames
                // About to be let go.
                || self.color.len() > self.limits.pending_frames
            });
        let (before, after) = self.neighbours(at);
        // A depth frame exposed later settles which one is nearest.
        let depth_settled =
            self.depth_near(at).is_some() && self.depth.iter().any(|depth| depth.at >= at);
        waited || (before.is_some() && after.is_some() && depth_settled)
    }

    /// Places of the nearest ambient frames before and after a moment.
    fn neighbours(&self, at: Timestamp) -> (Option<usize>, Option<usize>) {
        let near = |side: fn(Timestamp, Timestamp) -> bool| {
            self.color
                .iter()
                .enumerate()
                .filter(|(_, pending)| {
                    pending.frame.light == Illumination::Ambient
                        && side(pending.frame.at, at)
                        && within(pending.frame.at, at, self.limits.bracket_seconds)
                })
                .min_by_key(|(_, pending)| pending.frame.at.distance(at))
                .map(|(place, _)| place)
        };
        (
            near(|ambient, flash| ambient < flash),
            near(|ambient, flash| ambient > flash),
        )
    }

    fn depth_near(&self, at: Timestamp) -> Option<usize> {
        self.depth
            .iter()
            .enumerate()
            .filter(|(_, depth)| within(depth.at, at, self.limits.depth_seconds))
            // Of two equally near ones the earlier, whichever came first.
            .min_by_key(|(_, depth)| (depth.at.distance(at), depth.at))
            .map(|(place, _)| place)
    }

    /// Takes the flash frame of this moment out, with what makes a shot of it, or drops it.
    fn decide(&mut self, at: Timestamp) -> Option<Shot> {
        let (before, after) = self.neighbours(at);
        let place = self
            .color
            .iter()
            .position(|pending| pending.frame.at == at)?;
        let flash = &self.color[place];
        let sides: Vec<usize> = before.into_iter().chain(after).collect();
        let enough = if self.limits.allow_one_ambient { 1 } else { 2 };
        if sides.len() < enough {
            self.color.remove(place);
            self.drops.flash_without_ambient += 1;
            return None;
        }
        let verdicts: Vec<(usize, Comparison)> = sides
            .into_iter()
            .map(|side| {
                let ambient = &self.color[side].brightness;
                (
                    side,
                    flash.brightness.against(ambient, self.limits.flash_rise),
                )
            })
            .collect();
        let with = |wanted: Comparison| -> Vec<Timestamp> {
            let found = verdicts
                .iter()
                .filter(|(_, comparison)| *comparison == wanted);
            found.map(|(side, _)| self.color[*side].frame.at).collect()
        };
        let (proving, contradicting) = (with(Comparison::Brighter), with(Comparison::NotBrighter));
        if !contradicting.is_empty() {
            self.drops.contradicted += 1 + contradicting.len() as u64;
            self.color.retain(|pending| {
                pending.frame.at != at && !contradicting.contains(&pending.frame.at)
            });
            return None;
        }
        if !with(Comparison::PartlyBrighter).is_empty() {
            self.color.remove(place);
            self.drops.partly_lit += 1;
            return None;
        }
        if proving.len() < enough {
            self.color.remove(place);
            self.drops.unproven += 1;
            return None;
        }
        let Some(depth) = self.depth_near(at) else {
            self.color.remove(place);
            self.drops.flash_without_depth += 1;
            return None;
        };
        let depth = self.depth.remove(depth);
        let mut ambient: Vec<ColorFrame> = proving
            .into_iter()
            .filter_map(|side| self.remove(side))
            .collect();
        ambient.sort_by_key(|frame| frame.at);
        let flash = self.remove(at)?;
        Some(Shot {
            flash,
            ambient,
            depth,
            rig: self.rig,
            mask: None,
        })
    }

    fn remove(&mut self, at: Timestamp) -> Option<ColorFrame> {
        let place = self
            .color
            .iter()
            .position(|pending| pending.frame.at == at)?;
        Some(self.color.remove(place).frame)
    }
}

fn within(a: Timestamp, b: Timestamp, seconds: f32) -> bool {
    a.distance(b) <= Duration::try_from_secs_f32(seconds).unwrap_or(Duration::ZERO)
}
