//! Any device, made worse on purpose: a seeded schedule of what goes wrong on real hardware.

use crate::{
    address,
    calibration::Rig,
    chance::Chance,
    device::{Device, DeviceInfo, DriverError, Settings, Stream},
    frame::{Frame, Illumination, Timestamp},
};
use std::{collections::VecDeque, path::Path, time::Duration};

/// What goes wrong, and how often; the default is nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// Chooses the schedule.
    pub seed: u64,
    /// Probability that a frame is lost.
    pub drop: f64,
    /// Probability that a frame arrives [`Faults::HELD_FRAMES`] frames late.
    pub delay: f64,
    /// Probability that a frame arrives twice.
    pub duplicate: f64,
    /// Probability that a frame changes places with the next.
    pub swap: f64,
    /// Probability that a color frame claims the other light.
    pub mislabel: f64,
    /// Most color frames by which a command to the flash lands late. Drawn anew for every bracket; the
    /// device claims the light it asked for, as a driver does that trusts its commands.
    pub latency: u32,
    /// Standard deviation added to the time of a frame, seconds; three of them at most.
    pub jitter: f64,
    /// Probability that asking for a frame times out.
    pub timeout: f64,
    /// Frames after which the device is unplugged, in each session; 0 = never.
    pub unplug: u64,
}

const KNOWN: [address::Known; 10] = [
    ("seed", "whole number, 0"),
    ("drop", "probability, 0"),
    ("delay", "probability, 0"),
    ("duplicate", "probability, 0"),
    ("swap", "probability, 0"),
    ("mislabel", "probability, 0"),
    ("latency", "color frames at most, 0"),
    ("jitter", "seconds, 0"),
    ("timeout", "probability, 0"),
    ("unplug", "after so many frames, 0 = never"),
];

impl Faults {
    /// How many frames overtake a delayed one.
    pub const HELD_FRAMES: u32 = 4;
    /// Greatest [`Faults::latency`].
    pub const MOST_LATE: u32 = 32;

    /// Reads `drop=0.1,swap=0.05`.
    ///
    /// # Errors
    /// A sentence that says what is valid.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut faults = Self::default();
        for (key, value) in address::pairs(text, ',', &KNOWN)? {
            let chance = || address::number(key, value, 0.0..=1.0);
            match key {
                "seed" => faults.seed = address::number(key, value, 0..=u64::MAX)?,
                "drop" => faults.drop = chance()?,
                "delay" => faults.delay = chance()?,
                "duplicate" => faults.duplicate = chance()?,
                "swap" => faults.swap = chance()?,
                "mislabel" => faults.mislabel = chance()?,
                "latency" => faults.latency = address::number(key, value, 0..=Self::MOST_LATE)?,
                "jitter" => faults.jitter = address::number(key, value, 0.0..=1.0)?,
                // With 1 no frame would ever come.
                "timeout" => faults.timeout = address::number(key, value, 0.0..=0.99)?,
                _ => faults.unplug = address::number(key, value, 0..=u64::MAX)?,
            }
        }
        Ok(faults)
    }
}

/// A device with [`Faults`].
pub struct Flaky {
    inner: Box<dyn Device>,
    faults: Faults,
    address: String,
}

impl Flaky {
    /// Wraps `inner`; the same faults and frames give the same schedule.
    pub fn new(inner: Box<dyn Device>, faults: Faults) -> Self {
        let Faults {
            seed,
            drop,
            delay,
            duplicate,
            swap,
            mislabel,
            latency,
            jitter,
            timeout,
            unplug,
        } = faults;
        let address = format!(
            "flaky:seed={seed},drop={drop},delay={delay},duplicate={duplicate},swap={swap},\
             mislabel={mislabel},latency={latency},jitter={jitter},timeout={timeout},\
             unplug={unplug}:{}",
            inner.info().address
        );
        Self {
            inner,
            faults,
            address,
        }
    }
}

impl Device for Flaky {
    fn info(&self) -> DeviceInfo {
        let inner = self.inner.info();
        DeviceInfo {
            address: self.address.clone(),
            driver: "flaky".into(),
            ..inner
        }
    }

    fn rig(&self) -> Rig {
        self.inner.rig()
    }

    fn rig_file(&self) -> Option<&Path> {
        self.inner.rig_file()
    }

    fn presence(&mut self) -> Result<(), DriverError> {
        self.inner.presence()
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        Ok(Box::new(Failing {
            inner: self.inner.start(settings)?,
            faults: self.faults,
            device: self.address.clone(),
            chance: Chance::new(self.faults.seed),
            asked: 0,
            taken: 0,
            given: 0,
            lights: VecDeque::new(),
            late: 0,
            held: Vec::new(),
            ready: VecDeque::new(),
        }))
    }
}

struct Failing<'a> {
    inner: Box<dyn Stream + 'a>,
    faults: Faults,
    device: String,
    chance: Chance,
    /// Calls of `next_frame`, frames taken from the device, frames given out.
    asked: u64,
    taken: u64,
    given: u64,
    /// Light of the latest color frames, the newest in front, and how many of them commands of this
    /// bracket are late by.
    lights: VecDeque<Illumination>,
    late: u32,
    /// Frames waiting, each until so many others have passed.
    held: Vec<(u32, Frame)>,
    ready: VecDeque<Frame>,
}

impl Failing<'_> {
    fn happens(&self, kind: u64, probability: f64, counter: u64) -> bool {
        probability > 0.0 && self.chance.of(kind).unit(counter) < probability
    }

    fn disturb(&mut self, mut frame: Frame) {
        let n = self.taken;
        self.taken += 1;
        if let Frame::Color(color) = &mut frame {
            color.light = self.claimed(color.light, n);
        }
        if self.faults.jitter > 0.0 {
            self.shake(&mut frame, n);
        }
        if self.happens(1, self.faults.drop, n) {
            return;
        }
        if let Frame::Color(color) = &mut frame
            && self.happens(2, self.faults.mislabel, n)
        {
            color.light = match color.light {
                Illumination::Ambient => Illumination::Flash,
                Illumination::Flash => Illumination::Ambient,
            };
        }
        let late = if self.happens(3, self.faults.delay, n) {
            Faults::HELD_FRAMES
        } else if self.happens(4, self.faults.swap, n) {
            1
        } else {
            0
        };
        let copy = self
            .happens(5, self.faults.duplicate, n)
            .then(|| frame.clone());
        if late > 0 {
            self.held.push((late, frame));
        } else {
            self.pass(frame);
        }
        if let Some(copy) = copy {
            self.pass(copy);
        }
    }

    /// The light asked for when a frame of this light came: what lands late by so many frames was asked
    /// for so many frames ago, and the pattern repeats.
    fn claimed(&mut self, light: Illumination, n: u64) -> Illumination {
        if self.faults.latency == 0 {
            return light;
        }
        self.lights.push_front(light);
        self.lights.truncate(self.faults.latency as usize + 1);
        if light == Illumination::Flash {
            let among = f64::from(self.faults.latency + 1);
            self.late = (self.chance.of(7).unit(n) * among) as u32;
        }
        let asked = self.lights.get(self.late as usize);
        asked.copied().unwrap_or(Illumination::Ambient)
    }

    fn shake(&self, frame: &mut Frame, n: u64) {
        let by = self.faults.jitter * f64::from(self.chance.of(8).normal(n).clamp(-3.0, 3.0));
        let at = match frame {
            Frame::Color(frame) => &mut frame.at,
            Frame::Depth(frame) => &mut frame.at,
        };
        let moved = at.as_nanos().saturating_add_signed((by * 1e9) as i64);
        *at = Timestamp::from_nanos(moved);
    }

    /// Lets a frame through, and with it those that waited for it.
    fn pass(&mut self, frame: Frame) {
        self.ready.push_back(frame);
        for (wait, _) in &mut self.held {
            *wait -= 1;
        }
        let ready = &mut self.ready;
        self.held.retain_mut(|(wait, frame)| {
            if *wait == 0 {
                ready.push_back(frame.clone());
            }
            *wait > 0
        });
    }
}

impl Stream for Failing<'_> {
    fn settings(&self) -> &Settings {
        self.inner.settings()
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        if self.faults.unplug > 0 && self.given >= self.faults.unplug {
            return Err(DriverError::Unplugged {
                device: self.device.clone(),
            });
        }
        self.asked += 1;
        if self.happens(6, self.faults.timeout, self.asked) {
            return Err(DriverError::Timeout {
                device: self.device.clone(),
                patience,
            });
        }
        while self.ready.is_empty() {
            match self.inner.next_frame(patience) {
                Ok(frame) => self.disturb(frame),
                Err(DriverError::Ended { .. }) if !self.held.is_empty() => {
                    let held = std::mem::take(&mut self.held);
                    self.ready.extend(held.into_iter().map(|(_, frame)| frame));
                }
                Err(error) => return Err(error),
            }
        }
        self.given += 1;
        self.ready.pop_front().ok_or_else(|| DriverError::Timeout {
            device: self.device.clone(),
            patience,
        })
    }
}
