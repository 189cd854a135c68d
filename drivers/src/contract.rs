//! What every device must uphold, as a check that can be run on real hardware.
//!
//! Each claim has a name; a driver passes when no claim fails. A claim that could not be put to the
//! test (too few frames, a device that ended) is *unknown*, never passed.

use crate::{
    admission,
    calibration::Rig,
    device::{Device, DriverError, Losses, Settings, Stream},
    frame::{Frame, Illumination, Timestamp},
};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// How a claim fared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Held wherever it was put to the test.
    Pass,
    /// Broken at least once.
    Fail,
    /// Not put to the test.
    Unknown,
}

/// One claim of the contract and what was seen.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Claim {
    /// Name, a sentence with underscores.
    pub name: String,
    /// How it fared.
    pub verdict: Verdict,
    /// What was seen, in words.
    pub evidence: String,
}

/// All claims of one device.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// Address of the device.
    pub device: String,
    /// Frames looked at.
    pub frames: usize,
    /// Frames that the device did not deliver meanwhile.
    pub losses: Losses,
    /// Every claim, in the order it was settled.
    pub claims: Vec<Claim>,
}

impl Report {
    /// True when no claim failed.
    pub fn passed(&self) -> bool {
        self.claims
            .iter()
            .all(|claim| claim.verdict != Verdict::Fail)
    }

    /// The claim of this name.
    pub fn claim(&self, name: &str) -> Option<&Claim> {
        self.claims.iter().find(|claim| claim.name == name)
    }
}

/// Longest wait for one frame of a device that should be delivering.
const PATIENCE: Duration = Duration::from_secs(2);
/// A wait that is allowed to fail, and how much longer than asked it may take: two scheduler
/// quanta of a busy single-board computer.
const SHORT: Duration = Duration::from_millis(1);
const OVERSHOOT: Duration = Duration::from_millis(250);
/// Timeouts in a row after which a device counts as silent.
const SILENCES: usize = 5;

/// Puts a device to the test over `frames` frames, then stops it and starts it again.
///
/// `observe` hears each claim as it is settled.
pub fn check(device: &mut dyn Device, frames: usize, observe: &mut dyn FnMut(&Claim)) -> Report {
    let info = device.info();
    let mut claims = Claims {
        settled: Vec::new(),
        observe,
    };
    let rig = device.rig();
    match admission::admit_rig(&rig) {
        Ok(()) => claims.settle(
            "the_rig_is_sound",
            Verdict::Pass,
            "sizes, lenses, rotation and flash are usable".into(),
        ),
        Err(refusal) => claims.settle("the_rig_is_sound", Verdict::Fail, refusal.to_string()),
    }
    let settings = Settings::default();
    let mut seen = Seen::new(rig);
    match device.start(&settings) {
        Ok(mut stream) => {
            claims.settle(
                "it_starts",
                Verdict::Pass,
                "with the default settings".into(),
            );
            let kept = *stream.settings() == settings;
            claims.settle(
                "the_stream_states_what_was_asked",
                verdict(kept),
                in_words(stream.settings()),
            );
            let (outcome, evidence) = short_wait(stream.as_mut(), &mut seen);
            claims.settle(
                "a_timeout_is_honoured_within_its_patience",
                outcome,
                evidence,
            );
            seen.take(stream.as_mut(), frames, info.finite);
            seen.losses = stream.losses();
        }
        Err(error) => claims.settle("it_starts", Verdict::Fail, error.to_string()),
    }
    seen.settle(&mut claims, frames, info.finite);
    restart(device, &settings, &mut claims);
    let refused = device
        .start(&Settings {
            exposure_seconds: Some(f32::NAN),
            ..settings
        })
        .err();
    let (outcome, evidence) = match refused {
        Some(DriverError::Setting { reason, .. }) => (Verdict::Pass, format!("refused: {reason}")),
        Some(other) => (Verdict::Fail, format!("refused as {other}")),
        // A recording cannot grant anything and so need not refuse.
        None if info.finite => (Verdict::Unknown, "a finite device grants nothing".into()),
        None => (Verdict::Fail, "an exposure of NaN was accepted".into()),
    };
    claims.settle("an_impossible_setting_is_refused", outcome, evidence);
    Report {
        device: info.address,
        frames: seen.count,
        losses: seen.losses,
        claims: claims.settled,
    }
}

struct Claims<'a> {
    settled: Vec<Claim>,
    observe: &'a mut dyn FnMut(&Claim),
}

impl Claims<'_> {
    fn settle(&mut self, name: &str, verdict: Verdict, evidence: String) {
        let claim = Claim {
            name: name.into(),
            verdict,
            evidence,
        };
        (self.observe)(&claim);
        self.settled.push(claim);
    }

    /// Passes when `broken` is empty and something was tried.
    fn count(&mut self, name: &str, tried: usize, broken: &[String]) {
        let (verdict, evidence) = match broken {
            [] if tried == 0 => (Verdict::Unknown, "nothing to look at".into()),
            [] => (Verdict::Pass, format!("{tried} looked at")),
            [first, ..] => (
                Verdict::Fail,
                format!("{} of {tried}; first: {first}", broken.len()),
            ),
        };
        self.settle(name, verdict, evidence);
    }
}

fn verdict(held: bool) -> Verdict {
    if held { Verdict::Pass } else { Verdict::Fail }
}

fn in_words(settings: &Settings) -> String {
    let asked = |value: Option<f32>, unit: &str| {
        value.map_or("the device's own".into(), |value| format!("{value}{unit}"))
    };
    format!(
        "exposure {}, gain {}, flash on one color frame in {}",
        asked(settings.exposure_seconds, " s"),
        asked(settings.gain, "×"),
        settings.flash_every
    )
}

fn short_wait(stream: &mut dyn Stream, seen: &mut Seen) -> (Verdict, String) {
    let asked = Instant::now();
    let answer = stream.next_frame(SHORT);
    let took = asked.elapsed();
    let evidence = match &answer {
        Ok(_) => format!("a frame came after {took:?}"),
        Err(error) => format!("{took:?}: {error}"),
    };
    match answer {
        Ok(frame) => seen.look(&frame),
        // The first picture of a camera may be late; anything else ends the session.
        Err(DriverError::Timeout { .. }) => {}
        Err(error) => seen.ended = Some(error),
    }
    // A frame in time says nothing about waiting; rendering it may take what it takes.
    let outcome = match (&seen.ended, seen.count) {
        (_, 1..) => Verdict::Unknown,
        (Some(_), _) => Verdict::Fail,
        _ => verdict(took <= SHORT + OVERSHOOT),
    };
    (outcome, evidence)
}

fn restart(device: &mut dyn Device, settings: &Settings, claims: &mut Claims) {
    let name = "it_can_be_stopped_and_started_again";
    let outcome = device.start(settings).and_then(|mut stream| {
        for _ in 0..SILENCES {
            match stream.next_frame(PATIENCE) {
                Err(DriverError::Timeout { .. }) => {}
                other => return other.map(Some),
            }
        }
        Ok(None)
    });
    match outcome {
        Ok(Some(frame)) => {
            let evidence = format!("a frame at {} ns after a restart", frame.at().as_nanos());
            claims.settle(name, Verdict::Pass, evidence);
        }
        Ok(None) => claims.settle(name, Verdict::Fail, "silent after a restart".into()),
        Err(error) => claims.settle(name, Verdict::Fail, error.to_string()),
    }
}

/// What one camera delivered last.
#[derive(Default)]
struct Track {
    frames: usize,
    last: Option<(Timestamp, u64)>,
    times: Vec<String>,
    sequences: Vec<String>,
}

impl Track {
    fn add(&mut self, frame: &Frame) {
        let (at, sequence) = (frame.at(), frame.sequence());
        if let Some((before, count)) = self.last {
            if at <= before {
                self.times.push(format!(
                    "{} ns after {} ns",
                    at.as_nanos(),
                    before.as_nanos()
                ));
            }
            if sequence <= count {
                self.sequences.push(format!("{sequence} after {count}"));
            }
        }
        self.last = Some((at, sequence));
        self.frames += 1;
    }
}

struct Seen {
    rig: Rig,
    count: usize,
    color: Track,
    depth: Track,
    ambient: usize,
    flash: usize,
    refused: Vec<String>,
    curves: Vec<String>,
    curve: Option<(crate::frame::Transfer, f32, f32)>,
    answers: usize,
    silences: usize,
    losses: Losses,
    ended: Option<DriverError>,
}

impl Seen {
    fn new(rig: Rig) -> Self {
        Self {
            rig,
            count: 0,
            color: Track::default(),
            depth: Track::default(),
            ambient: 0,
            flash: 0,
            refused: vec![],
            curves: vec![],
            curve: None,
            answers: 0,
            silences: 0,
            losses: Losses::default(),
            ended: None,
        }
    }

    fn take(&mut self, stream: &mut dyn Stream, frames: usize, finite: bool) {
        let mut silent = 0;
        // A finite device is followed to its end, to see that it has one.
        while (self.count < frames || finite) && self.ended.is_none() && silent < SILENCES {
            match stream.next_frame(PATIENCE) {
                Ok(frame) => {
                    silent = 0;
                    self.look(&frame);
                }
                Err(DriverError::Timeout { .. }) => {
                    silent += 1;
                    self.silences += 1;
                }
                Err(error) => self.ended = Some(error),
            }
        }
    }

    fn look(&mut self, frame: &Frame) {
        self.count += 1;
        if let Err(refusal) = admission::admit(frame, &self.rig) {
            self.refused
                .push(format!("sequence {}: {refusal}", frame.sequence()));
        }
        match frame {
            Frame::Color(color) => {
                self.color.add(frame);
                match color.light {
                    Illumination::Ambient => self.ambient += 1,
                    Illumination::Flash => self.flash += 1,
                }
                let curve = (color.transfer.clone(), color.black_level, color.white_level);
                if self.curve.as_ref().is_some_and(|first| *first != curve) {
                    self.curves
                        .push(format!("sequence {}: {curve:?}", color.sequence));
                }
                self.curve.get_or_insert(curve);
            }
            Frame::Depth(depth) => {
                self.depth.add(frame);
                self.answers += usize::from(depth.metres.samples().iter().any(|z| !z.is_nan()));
            }
        }
    }

    fn settle(&self, claims: &mut Claims, frames: usize, finite: bool) {
        let enough = match (&self.ended, finite) {
            (Some(DriverError::Ended { .. }), true) => true,
            (None, false) => self.count >= frames,
            _ => false,
        };
        let end = self
            .ended
            .as_ref()
            .map_or("still running".into(), ToString::to_string);
        let evidence = format!("{} frames, {} timeouts, {end}", self.count, self.silences);
        claims.settle(
            "frames_keep_coming",
            verdict(enough && self.count > 0),
            evidence,
        );
        let ended = matches!(self.ended, Some(DriverError::Ended { .. }));
        claims.settle(
            "only_a_finite_device_ends",
            verdict(ended == finite),
            format!("finite: {finite}; {end}"),
        );
        claims.count(
            "frames_are_what_the_vocabulary_promises",
            self.count,
            &self.refused,
        );
        let pairs = |track: &Track| track.frames.saturating_sub(1);
        let (color, depth) = (&self.color, &self.depth);
        claims.count(
            "color_timestamps_strictly_increase",
            pairs(color),
            &color.times,
        );
        claims.count(
            "color_sequence_strictly_increases",
            pairs(color),
            &color.sequences,
        );
        claims.count(
            "depth_timestamps_strictly_increase",
            pairs(depth),
            &depth.times,
        );
        claims.count(
            "depth_sequence_strictly_increases",
            pairs(depth),
            &depth.sequences,
        );
        claims.count("curve_and_levels_stay_the_same", pairs(color), &self.curves);
        let needed = Settings::default().flash_every as usize;
        let lights = match (self.ambient, self.flash) {
            (1.., 1..) => Verdict::Pass,
            // Too few frames for a whole bracket prove nothing.
            (a, f) if a + f < needed => Verdict::Unknown,
            _ => Verdict::Fail,
        };
        let evidence = format!("{} ambient, {} flash", self.ambient, self.flash);
        claims.settle("both_lights_appear", lights, evidence);
        let (outcome, evidence) = match (depth.frames, self.answers) {
            (0, _) if self.count < 4 => (Verdict::Unknown, "no depth frame among so few".into()),
            (0, _) => (
                Verdict::Fail,
                format!("no depth frame among {}", self.count),
            ),
            (n, answers) => (
                verdict(answers > 0),
                format!("{answers} of {n} frames hold an answer"),
            ),
        };
        claims.settle("depth_appears", outcome, evidence);
    }
}
