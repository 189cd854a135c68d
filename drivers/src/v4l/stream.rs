//! A running session: both cameras and the lamp, in the caller's thread.

use super::{
    Cameras,
    bracket::Bracket,
    exposure::{Locked, set_controls},
    flow::{Flow, Taken},
    pairs::Pairs,
    plan::{CameraPlan, Plan},
    unpack::Scale,
};
use crate::{
    device::{DriverError, Losses, Settings, Stream},
    flash,
    frame::{ColorFrame, DepthFrame, Frame, Illumination, Timestamp, Transfer},
    node::{Node, refused, wait},
    witness::Witness,
};
use std::{collections::VecDeque, time::Duration};

/// Frame time of a camera that tells none, until it has been measured.
const UNTOLD_SECONDS: f64 = 1.0 / 30.0;
/// A camera that delivers nothing for this long, or for eight of its frames, while the other one
/// does, stalls.
const STALL: Duration = Duration::from_secs(2);
/// Frames after which a camera's controls have taken effect.
const SETTLING_FRAMES: u32 = 4;
/// Frame times without a picture after which the lamp is not fired any more.
const ALIVE_FRAMES: u32 = 4;
/// Looks that metering takes at most, and how long each may take.
const MOST_LOOKS: usize = 10;
const LOOK: Duration = Duration::from_secs(5);

/// The session. Dropping it stops both cameras and puts the lamp out.
pub(super) struct Running<'a> {
    plan: &'a Plan,
    settings: Settings,
    device: String,
    color: Flow,
    depth: Option<Flow>,
    amplitude: Option<Flow>,
    pairs: Pairs,
    locked: Locked,
    bracket: Bracket,
    /// Tells the light where nobody commands a flash that is wanted.
    witness: Option<Witness>,
    transfer: Transfer,
    levels: (f32, f32),
    /// What the depth camera says too much, as its rig file tells.
    offset_metres: f32,
    /// Frame time of the color camera before it has been measured.
    told: f64,
    unlit: u64,
    /// Frames exposed before this moment may have an exposure other than the one granted now.
    settled: Timestamp,
    ready: VecDeque<Frame>,
}

impl<'a> Running<'a> {
    /// Locks the color camera's exposure, opens the lamp, and starts both cameras.
    pub fn start(
        plan: &'a Plan,
        device: &str,
        settings: &Settings,
        cameras: Cameras,
    ) -> Result<Self, DriverError> {
        let Cameras {
            color,
            depth,
            amplitude,
        } = cameras;
        let told = color.frame_seconds.unwrap_or(UNTOLD_SECONDS);
        set_controls(&color.node, &plan.color)?;
        for (camera, plan) in [(&depth, &plan.depth), (&amplitude, &plan.amplitude)] {
            if let (Some(camera), Some(plan)) = (camera, plan) {
                set_controls(&camera.node, plan)?;
            }
        }
        let locked = Locked::lock(&color.node, &plan.color, settings, told)?;
        let lamp = flash::open(&plan.flash, color.node.path())?;
        let meaning = &color.unpacker.meaning;
        let transfer = plan.color.transfer.clone();
        let transfer = transfer.unwrap_or_else(|| meaning.transfer.clone());
        // Narrow red, green, blue: white at 235 and black at 16 of 255.
        let narrow = !meaning.full_range
            && matches!(
                color.unpacker.format.layout,
                super::format::Layout::Rgb { .. }
            );
        let levels = if narrow && (plan.color.black_level, plan.color.white_level) == (0.0, 1.0) {
            (16.0 / 255.0, 235.0 / 255.0)
        } else {
            (plan.color.black_level, plan.color.white_level)
        };
        let watched = plan.flash.kind == flash::Kind::None && settings.flash_every > 0;
        let longest = Duration::from_secs_f64(plan.flash.longest_seconds);
        let witness = watched.then(|| Witness::new(longest));
        let pattern = (settings.flash_run, settings.flash_every);
        let bracket = Bracket::new(lamp, pattern, device.to_owned());
        let color = Flow::start(color, &plan.color)?;
        let begin = |camera: Option<_>, plan: &Option<CameraPlan>| {
            let both = camera.zip(plan.as_ref());
            both.map(|(camera, plan)| Flow::start(camera, plan))
                .transpose()
        };
        let depth = begin(depth, &plan.depth)?;
        let amplitude = begin(amplitude, &plan.amplitude)?;
        let mut running = Self {
            plan,
            settings: settings.clone(),
            device: device.to_owned(),
            color,
            depth,
            amplitude,
            pairs: Pairs::default(),
            locked,
            bracket,
            witness,
            transfer,
            levels,
            offset_metres: plan
                .geometry
                .as_ref()
                .map_or(0.0, |known| known.depth_offset_metres as f32),
            told,
            unlit: 0,
            settled: Timestamp::from_nanos(0),
            ready: VecDeque::new(),
        };
        running.bracket.check(running.length(), running.period())?;
        if plan.metering && settings.exposure_seconds.is_none() {
            running.meter()?;
        }
        Ok(running)
    }

    /// Chooses an exposure at which neither flash nor ambient frames clip.
    fn meter(&mut self) -> Result<(), DriverError> {
        let refuse = |device: &str, reason: &str| DriverError::Setting {
            device: device.to_owned(),
            setting: "metering",
            reason: reason.to_owned(),
        };
        let (Some((least, most)), Some(lit)) = (
            self.locked.range(),
            self.bracket.longest_exposure(self.period()),
        ) else {
            let reason = "it needs an exposure control in known units and a flash; set metering = \
                          false";
            return Err(refuse(&self.device, reason));
        };
        let most = most.min(lit.as_secs_f32()).min(self.period().as_secs_f32());
        let range = (least, most.max(least));
        for _ in 0..MOST_LOOKS {
            let (mut flash, mut ambient) = (None, None);
            let deadline = Timestamp::now().after(LOOK);
            while flash.is_none() || ambient.is_none() {
                let left = deadline.since(Timestamp::now());
                let Frame::Color(frame) = self.next(left)? else {
                    continue;
                };
                // A picture that cannot be read says nothing; another comes, or the time is up.
                let Some(seen) = flash::metering::highlight(&frame) else {
                    continue;
                };
                match frame.light {
                    Illumination::Flash => flash = Some(seen),
                    Illumination::Ambient => ambient = Some(seen),
                }
            }
            let seen = (flash.unwrap_or(0.0), ambient.unwrap_or(0.0));
            let now = self.locked.granted.seconds;
            let flicker = self.plan.flicker_seconds;
            let Some(next) = flash::metering::next_seconds(now, seen, range, flicker) else {
                break;
            };
            self.locked
                .set(self.color.buffers.node(), Some(next), None)?;
            self.unsettle();
        }
        self.ready.clear();
        Ok(())
    }

    /// Frames on their way were exposed with the old values.
    fn unsettle(&mut self) {
        self.settled = Timestamp::now().after(SETTLING_FRAMES * self.period());
        self.ready.clear();
    }

    /// Exposure of a whole picture, from the first row's start to the last row's end.
    fn length(&self) -> Duration {
        let exposure = f64::from(self.locked.granted.seconds);
        Duration::from_secs_f64(exposure + self.plan.color.readout_seconds)
    }

    fn period(&self) -> Duration {
        let seconds = self.color.clock.period().unwrap_or(self.told);
        Duration::from_secs_f64(seconds.clamp(1e-4, 10.0))
    }

    /// Color, then depth, then amplitude, as far as they are there.
    fn flows(&self) -> impl Iterator<Item = &Flow> {
        std::iter::once(&self.color)
            .chain(&self.depth)
            .chain(&self.amplitude)
    }

    /// Waits for any camera until `until`, then takes what has arrived.
    fn pump(&mut self, until: Timestamp) -> Result<(), DriverError> {
        let nodes: Vec<&Node> = self.flows().map(|flow| flow.buffers.node()).collect();
        let ready = wait(&nodes, until.since(Timestamp::now()))
            .map_err(|error| refused(nodes[0].path(), "waiting for a picture", error))?;
        if ready[0].event && self.color.events()? {
            self.relock()?;
        }
        for (flow, ready) in self.flows().zip(&ready).skip(1) {
            if ready.event {
                flow.events()?;
            }
        }
        let has_picture = |index: usize| ready.get(index).is_some_and(|ready| ready.picture);
        if has_picture(0) {
            self.take_color()?;
        }
        if has_picture(1) {
            self.take_depth()?;
        }
        if has_picture(2) {
            self.take_amplitude()?;
        }
        self.look_for_stalls()
    }

    /// Somebody turned a knob: what is granted now is read again, and set back if it was asked for.
    fn relock(&mut self) -> Result<(), DriverError> {
        let node = self.color.buffers.node();
        let Settings {
            exposure_seconds,
            gain,
            ..
        } = self.settings;
        self.locked.set(node, exposure_seconds, gain)?;
        self.unsettle();
        Ok(())
    }

    fn take_color(&mut self) -> Result<(), DriverError> {
        let length = self.length();
        let exposure = Duration::from_secs_f32(self.locked.granted.seconds);
        let (bracket, unlit, settled) = (&self.bracket, &mut self.unlit, self.settled);
        let taken = self.color.take(exposure, |unpacker, at, planes| {
            let known = bracket.light(at, length).filter(|_| at >= settled);
            let Some(light) = known else {
                *unlit += 1;
                return Ok(None);
            };
            Ok(Some((light, unpacker.picture(planes)?)))
        })?;
        if let Taken::Picture(at, sequence, (light, pixels)) = taken {
            let frame = ColorFrame {
                at,
                sequence,
                light,
                exposure: self.locked.granted,
                pixels,
                transfer: self.transfer.clone(),
                black_level: self.levels.0,
                white_level: self.levels.1,
            };
            match &mut self.witness {
                None => self.ready.push_back(Frame::Color(frame)),
                Some(witness) => {
                    let told = witness.tell(frame);
                    self.ready.extend(told.into_iter().map(Frame::Color));
                }
            }
            self.bracket.delivered(light)?;
        }
        Ok(())
    }

    fn take_depth(&mut self) -> Result<(), DriverError> {
        let (Some(depth), Some(plan)) = (&mut self.depth, &self.plan.depth) else {
            return Ok(());
        };
        // A depth camera's own exposure is not told; its pictures count as taken at their time.
        let scale = Scale {
            unit_metres: plan.unit_metres as f32,
            offset_metres: self.offset_metres,
            nearest_metres: plan.nearest_metres as f32,
            farthest_metres: plan.farthest_metres as f32,
        };
        let taken = depth.take(Duration::ZERO, |unpacker, _, planes| {
            unpacker.depth(planes, &scale).map(Some)
        })?;
        if let Taken::Picture(at, sequence, metres) = taken {
            let frame = DepthFrame {
                at,
                sequence,
                metres,
                amplitude: None,
                sigma: None,
            };
            if self.amplitude.is_some() {
                self.pairs.add_depth(frame);
                self.pair();
            } else {
                self.ready.push_back(Frame::Depth(frame));
            }
        }
        Ok(())
    }

    fn take_amplitude(&mut self) -> Result<(), DriverError> {
        let Some(amplitude) = &mut self.amplitude else {
            return Ok(());
        };
        let taken = amplitude.take(Duration::ZERO, |unpacker, _, planes| {
            unpacker.amplitude(planes).map(Some)
        })?;
        if let Taken::Picture(at, _, amplitude) = taken {
            self.pairs.add_amplitude(at, amplitude);
            self.pair();
        }
        Ok(())
    }

    /// Delivers the depth pictures that have their amplitude, or will never have it.
    fn pair(&mut self) {
        let depth = self.depth.as_ref().and_then(|depth| depth.clock.period());
        let apart = Duration::from_secs_f64(depth.unwrap_or(self.told).clamp(1e-4, 10.0) / 2.0);
        while let Some(frame) = self.pairs.next(apart) {
            self.ready.push_back(Frame::Depth(frame));
        }
    }

    /// A stall gives no error: one camera just stays silent while the other one goes on.
    fn look_for_stalls(&self) -> Result<(), DriverError> {
        let latest = self.flows().map(|flow| flow.heard).max();
        let patience = STALL.max(8 * self.period());
        let silent = self
            .flows()
            .find(|flow| latest.is_some_and(|latest| latest.since(flow.heard) > patience));
        match silent {
            None => Ok(()),
            Some(silent) => Err(DriverError::Hardware {
                device: silent.buffers.node().path().display().to_string(),
                problem: format!("it delivers nothing for {patience:?}, while another camera does"),
                remedy: "start again; if it comes back, check its cable and its bandwidth",
            }),
        }
    }

    fn next(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let asked = Timestamp::now();
        let deadline = asked.after(patience);
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Ok(frame);
            }
            let now = Timestamp::now();
            let (length, period) = (self.length(), self.period());
            // Nothing is lit for a camera that has fallen silent.
            let alive = now.since(self.color.heard) <= length + ALIVE_FRAMES * period;
            let due = if alive {
                self.bracket.act(now, &self.color.clock, length, period)?
            } else {
                None
            };
            let until = due.map_or(deadline, |due| due.min(deadline));
            self.pump(until)?;
            if self.ready.is_empty() && Timestamp::now() >= deadline {
                return Err(DriverError::Timeout {
                    device: self.device.clone(),
                    patience,
                });
            }
        }
    }
}

impl Stream for Running<'_> {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let answer = self.next(patience);
        if matches!(&answer, Err(error) if !matches!(error, DriverError::Timeout { .. })) {
            // The lamp's own bound holds should this fail, and the first error is the one to tell.
            drop(self.bracket.darken());
        }
        answer
    }

    fn losses(&self) -> Losses {
        let flows = || self.flows();
        Losses {
            missed: flows().map(|flow| flow.clock.missed).sum(),
            broken: flows().map(|flow| flow.broken).sum(),
            unlit: self.unlit + self.witness.as_ref().map_or(0, |witness| witness.unlit),
            misdated: flows().map(|flow| flow.clock.misdated).sum(),
        }
    }
}
