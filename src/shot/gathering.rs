//! Many frames of one still scene, of both lights, for a shot with less noise.

use super::{
    DropCounts, Limits,
    evidence::{Brightness, Comparison},
};
use drivers::{ColorFrame, DepthFrame, Frame, Illumination, Rig, Timestamp, admission};
use std::{collections::BTreeSet, time::Duration};

/// Frames held at most, as a multiple of those wanted: a camera whose light is none of ours delivers them
/// as it likes.
const HELD: usize = 3;

/// Frames of one scene, each in the order of exposure, the light of all of them known.
#[derive(Debug, Clone)]
pub struct Burst {
    /// With flash; one or more.
    pub flash: Vec<ColorFrame>,
    /// Without; one or more.
    pub ambient: Vec<ColorFrame>,
    /// Depth; one or more.
    pub depth: Vec<DepthFrame>,
    /// Geometry.
    pub rig: Rig,
}

/// Collects a [`Burst`]. As in a shot, the light of each flash frame must be proved by its pixels against
/// the nearest ambient frames before and after it; unlike there, an ambient frame may prove several.
#[derive(Debug)]
pub struct Gathering {
    rig: Rig,
    limits: Limits,
    /// Flash and ambient frames wanted.
    wanted: [usize; 2],
    color: Vec<Held>,
    depth: Vec<DepthFrame>,
    /// Start times of what was let in, of either camera.
    seen: [BTreeSet<Timestamp>; 2],
    drops: DropCounts,
}

#[derive(Debug)]
struct Held {
    frame: ColorFrame,
    brightness: Brightness,
    /// A flash frame that its neighbours have proved.
    proved: bool,
}

impl Gathering {
    /// For at least so many `[flash, ambient]` frames of one device.
    pub fn new(rig: Rig, limits: Limits, wanted: [usize; 2]) -> Self {
        Self {
            rig,
            limits,
            wanted,
            color: Vec::new(),
            depth: Vec::new(),
            seen: [BTreeSet::new(), BTreeSet::new()],
            drops: DropCounts::default(),
        }
    }

    /// Takes a frame; true when there are enough.
    pub fn push(&mut self, frame: Frame) -> bool {
        if admission::admit(&frame, &self.rig).is_err() {
            self.drops.malformed += 1;
            return false;
        }
        let camera = usize::from(matches!(frame, Frame::Depth(_)));
        if !self.seen[camera].insert(frame.at()) {
            self.drops.duplicate += 1;
            return false;
        }
        match frame {
            Frame::Depth(frame) => self.depth.push(frame),
            Frame::Color(frame) => match Brightness::of(&frame) {
                Some(brightness) => self.color.push(Held {
                    frame,
                    brightness,
                    proved: false,
                }),
                None => self.drops.unreadable += 1,
            },
        }
        let most = HELD * self.wanted.iter().sum::<usize>();
        self.depth.truncate(most);
        if self.color.len() >= most {
            self.settle(true);
            return true;
        }
        let [flash, ambient] = self.count();
        if flash < self.wanted[0] || ambient < self.wanted[1] || self.depth.is_empty() {
            return false;
        }
        self.settle(false);
        let [_, ambient] = self.count();
        let proved = self.color.iter().filter(|held| held.proved).count();
        proved >= self.wanted[0] && ambient >= self.wanted[1]
    }

    /// What was gathered; `None` where a light, or depth, is missing altogether.
    pub fn finish(mut self) -> (Option<Burst>, DropCounts) {
        self.settle(true);
        self.color.sort_by_key(|held| held.frame.at);
        self.depth.sort_by_key(|frame| frame.at);
        let [mut flash, mut ambient] = [Vec::new(), Vec::new()];
        for Held { frame, .. } in self.color {
            match frame.light {
                Illumination::Flash => flash.push(frame),
                Illumination::Ambient => ambient.push(frame),
            }
        }
        let whole = !(flash.is_empty() || ambient.is_empty() || self.depth.is_empty());
        let burst = whole.then_some(Burst {
            flash,
            ambient,
            depth: self.depth,
            rig: self.rig,
        });
        (burst, self.drops)
    }

    fn count(&self) -> [usize; 2] {
        let flash = |held: &&Held| held.frame.light == Illumination::Flash;
        let flashes = self.color.iter().filter(flash).count();
        [flashes, self.color.len() - flashes]
    }

    /// Decides the flash frames that have ambient frames on both sides, or with `last` all of them, and
    /// lets go of those that are none.
    fn settle(&mut self, last: bool) {
        let undecided: Vec<Timestamp> = self
            .color
            .iter()
            .filter(|held| held.frame.light == Illumination::Flash && !held.proved)
            .map(|held| held.frame.at)
            .collect();
        for at in undecided {
            self.decide(at, last);
        }
    }

    fn decide(&mut self, at: Timestamp, last: bool) {
        let Some(place) = self.color.iter().position(|held| held.frame.at == at) else {
            return;
        };
        let reach = Duration::try_from_secs_f32(self.limits.bracket_seconds).unwrap_or_default();
        let nearest = |after: bool| {
            let ambient = self.color.iter().filter(|held| {
                held.frame.light == Illumination::Ambient
                    && (held.frame.at > at) == after
                    && held.frame.at.distance(at) <= reach
            });
            ambient.min_by_key(|held| held.frame.at.distance(at))
        };
        let sides = [nearest(false), nearest(true)];
        if !last && sides.iter().any(Option::is_none) {
            return;
        }
        let flash = &self.color[place].brightness;
        let verdicts: Vec<(Timestamp, Comparison)> = sides
            .into_iter()
            .flatten()
            .map(|side| {
                let found = flash.against(&side.brightness, self.limits.flash_rise);
                (side.frame.at, found)
            })
            .collect();
        let any = |wanted| verdicts.iter().any(|(_, found)| *found == wanted);
        if any(Comparison::NotBrighter) {
            let contradicting = verdicts
                .iter()
                .filter(|(_, found)| *found == Comparison::NotBrighter);
            let gone: Vec<Timestamp> = contradicting.map(|(at, _)| *at).chain([at]).collect();
            self.drops.contradicted += gone.len() as u64;
            self.color.retain(|held| !gone.contains(&held.frame.at));
            return;
        }
        if any(Comparison::Brighter) && !any(Comparison::PartlyBrighter) {
            self.color[place].proved = true;
            return;
        }
        match verdicts.is_empty() {
            true => self.drops.flash_without_ambient += 1,
            false if any(Comparison::PartlyBrighter) => self.drops.partly_lit += 1,
            false => self.drops.unproven += 1,
        }
        self.color.remove(place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::Settings;

    /// Frames of the synthetic desk, so many in a row with flash and so many without.
    fn frames(run: u32, rest: u32, count: usize) -> (Rig, Vec<Frame>) {
        let mut device = drivers::open("synthetic:desk?width=64&depth_width=32").unwrap();
        let settings = Settings {
            flash_every: run + rest,
            flash_run: run,
            ..Settings::default()
        };
        let rig = device.rig();
        let mut stream = device.start(&settings).unwrap();
        let frames = (0..count).map(|_| stream.next_frame(Duration::ZERO).unwrap());
        (rig, frames.collect())
    }

    fn gathered(rig: Rig, frames: Vec<Frame>, wanted: [usize; 2]) -> (Option<Burst>, DropCounts) {
        let mut gathering = Gathering::new(rig, Limits::default(), wanted);
        for frame in frames {
            if gathering.push(frame) {
                break;
            }
        }
        gathering.finish()
    }

    #[test]
    fn a_burst_holds_as_many_frames_of_each_light_as_were_wanted() {
        for (run, rest, wanted) in [(1, 1, [5, 5]), (3, 1, [6, 2]), (1, 3, [2, 6])] {
            let (rig, frames) = frames(run, rest, 80);
            let (burst, drops) = gathered(rig, frames, wanted);
            let burst = burst.unwrap();
            assert!(burst.flash.len() >= wanted[0] && burst.ambient.len() >= wanted[1]);
            assert!(burst.flash.len() + burst.ambient.len() <= wanted[0] + wanted[1] + 3);
            assert!(!burst.depth.is_empty());
            assert_eq!(drops.total(), 0);
        }
    }

    #[test]
    fn frames_of_the_wrong_name_and_frames_that_come_twice_are_left_out() {
        let (rig, mut all) = frames(2, 1, 60);
        let mut liars = Vec::new();
        for frame in &mut all {
            if let Frame::Color(color) = frame
                && [4, 10].contains(&color.sequence)
            {
                color.light = match color.light {
                    Illumination::Flash => Illumination::Ambient,
                    Illumination::Ambient => Illumination::Flash,
                };
                liars.push(color.at);
            }
        }
        assert_eq!(liars.len(), 2);
        let twice: Vec<Frame> = all.iter().flat_map(|f| [f.clone(), f.clone()]).collect();
        let (burst, drops) = gathered(rig, twice, [8, 4]);
        let burst = burst.unwrap();
        assert!(drops.contradicted > 0 && drops.duplicate > 0, "{drops:?}");
        let kept = burst.flash.iter().chain(&burst.ambient);
        let mut times: Vec<Timestamp> = kept.map(|frame| frame.at).collect();
        assert!(times.iter().all(|at| !liars.contains(at)));
        times.sort_unstable();
        times.dedup();
        assert_eq!(times.len(), burst.flash.len() + burst.ambient.len());
    }

    #[test]
    fn a_flash_that_never_fires_leaves_no_burst_and_no_heap_of_frames() {
        let (rig, mut all) = frames(1, 1, 80);
        all.retain(|frame| !matches!(frame, Frame::Color(c) if c.light == Illumination::Flash));
        let (burst, _) = gathered(rig, all, [4, 4]);
        assert!(burst.is_none());
    }
}
