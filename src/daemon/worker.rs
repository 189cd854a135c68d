//! The thread that owns one device: it opens it, takes shots, lets people look through it, and opens
//! it again when it was lost.

use super::{
    clock::Clock,
    preview::{Preview, Previews},
};
use crate::{
    api::{Fault, FaultKind, Phase},
    config::Config,
    session::{self, SessionError, Taken},
};
use drivers::{Device, DeviceInfo, DriverError, Frame, Settings};
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    sync::{
        Arc,
        mpsc::{Receiver, RecvTimeoutError},
    },
    time::{Duration, Instant},
};
use tokio::sync::{oneshot, watch};

/// Longest wait without a sign of life, and without a look whether an idle device is still there.
const BREATH: Duration = Duration::from_millis(250);
/// First and longest wait before a lost device is opened again: frames are to come within two seconds of
/// its return.
const RETRY: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(1)];
/// Least time between two previews: 25 a second are enough for anybody.
const PREVIEW_PERIOD: Duration = Duration::from_millis(40);

/// A shot that is asked for.
pub(super) struct Job {
    /// Of how many color frames; `None` = of one bracket.
    pub burst: Option<u32>,
    /// Hears of the shot, or why there is none.
    pub reply: oneshot::Sender<Result<Taken, Fault>>,
}

/// How a device is, as its thread last said.
#[derive(Debug, Clone)]
pub(super) struct Pulse {
    pub info: DeviceInfo,
    pub phase: Phase,
    pub in_use: bool,
    pub problem: Option<String>,
    pub reconnects: u64,
    /// When it was said.
    pub at: Instant,
}

impl Pulse {
    /// Before the device was opened.
    pub fn first(address: &str, at: Instant) -> Self {
        let driver = address.split(':').next().unwrap_or_default();
        Self {
            info: DeviceInfo {
                address: address.to_owned(),
                driver: driver.to_owned(),
                model: "not opened yet".to_owned(),
                finite: false,
            },
            phase: Phase::Degraded,
            in_use: false,
            problem: Some("not opened yet".to_owned()),
            reconnects: 0,
            at,
        }
    }
}

/// Everything the thread works with.
pub(super) struct Worker {
    pub address: String,
    pub config: watch::Receiver<Arc<Config>>,
    pub jobs: Receiver<Job>,
    pub pulse: watch::Sender<Pulse>,
    pub previews: Previews,
    pub clock: Arc<dyn Clock>,
    pub open: Open,
}

/// What opens the device at an address, with its measured rig where there is one.
pub(super) type Open =
    Arc<dyn Fn(&str, Option<&Path>) -> Result<Box<dyn Device>, SessionError> + Send + Sync>;

impl Worker {
    /// Runs until nobody can ask for shots any more.
    pub fn run(self) {
        let mut wait = RETRY[0];
        loop {
            match self.open() {
                Ok((mut device, info)) => {
                    wait = RETRY[0];
                    tracing::info!(device = %info.address, model = %info.model, "opened");
                    self.pulse.send_modify(|pulse| pulse.info = info);
                    let ended = self.serve(device.as_mut());
                    // One that panics while it is closed is closed enough.
                    let closed = catch_unwind(AssertUnwindSafe(|| drop(device)));
                    let Some(problem) = ended else {
                        return;
                    };
                    if closed.is_err() {
                        tracing::warn!("{}: its driver failed while it was closed", self.address);
                    }
                    self.lost(problem);
                }
                Err(problem) => {
                    if self.pulse.borrow().problem.as_deref() != Some(&problem) {
                        tracing::warn!("{problem}");
                    }
                    self.lost(problem);
                }
            }
            if !self.refuse_for(wait) {
                return;
            }
            wait = (wait * 2).min(RETRY[1]);
        }
    }

    fn open(&self) -> Result<(Box<dyn Device>, DeviceInfo), String> {
        let config = Arc::clone(&self.config.borrow());
        let rig = config.rig_of(&self.address);
        let opened = catch_unwind(AssertUnwindSafe(|| {
            let device = (self.open)(&self.address, rig)?;
            let info = device.info();
            Ok::<_, SessionError>((device, info))
        }));
        match opened {
            Ok(opened) => opened.map_err(|error| error.to_string()),
            Err(_) => Err(self.failed()),
        }
    }

    /// In words, after a panic.
    fn failed(&self) -> String {
        format!("{}: its driver failed", self.address)
    }

    /// Does what is asked for until the device is lost, and says how; `None` when all is over.
    fn serve(&self, device: &mut dyn Device) -> Option<String> {
        loop {
            self.say(Phase::Idle, false);
            let job = match self.clock.hear(&self.jobs, BREATH) {
                Ok(job) => Some(job),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return None,
            };
            // A driver that panics fails its own shot and nothing else.
            let done = catch_unwind(AssertUnwindSafe(|| match job {
                Some(job) => self.shoot(device, job),
                None if self.previews.wanted() => self.preview(device),
                None => device.presence().err().map(|gone| gone.to_string()),
            }));
            match done {
                Ok(None) => {}
                Ok(Some(problem)) => return Some(problem),
                Err(_) => return Some(self.failed()),
            }
        }
    }

    /// Takes a shot; says how the device was lost over it, if it was.
    fn shoot(&self, device: &mut dyn Device, job: Job) -> Option<String> {
        // A client that has gone away does not need the flash to fire.
        if job.reply.is_closed() {
            return None;
        }
        let capture = self.config.borrow().capture.clone();
        self.say(Phase::Armed, true);
        let now = || self.clock.now();
        let mut alive = |frames| {
            let phase = match frames {
                0 => Phase::Armed,
                _ => Phase::Bracketing,
            };
            self.say(phase, true);
        };
        let taken = catch_unwind(AssertUnwindSafe(|| {
            session::take_watched(device, &capture, job.burst, &now, &mut alive)
        }));
        let Ok(taken) = taken else {
            drop(job.reply.send(Err(away(self.failed()))));
            return Some(self.failed());
        };
        self.say(Phase::Idle, false);
        let lost = match &taken {
            Err(SessionError::Device(error)) if is_loss(error) => Some(error.to_string()),
            _ => None,
        };
        // The client may have left meanwhile; the shot is then nobody's.
        drop(job.reply.send(taken.map_err(|error| error.fault())));
        lost
    }

    /// Streams without flash while somebody looks and nobody wants a shot.
    fn preview(&self, device: &mut dyn Device) -> Option<String> {
        let capture = self.config.borrow().capture.clone();
        let settings = Settings {
            flash_every: 0,
            ..capture.settings()
        };
        let refused = |error: DriverError| {
            self.previews.refuse(error.to_string());
            is_loss(&error).then(|| error.to_string())
        };
        self.say(Phase::Armed, true);
        let mut heard = self.clock.now();
        let elapsed = |since: Instant| self.clock.now().saturating_duration_since(since);
        let mut stream = match device.start(&settings) {
            Ok(stream) => stream,
            Err(error) => {
                self.say(Phase::Idle, false);
                return refused(error);
            }
        };
        let ended = loop {
            if !self.previews.wanted() || self.previews.shot_waits() {
                break None;
            }
            self.say(Phase::Armed, true);
            match stream.next_frame(BREATH) {
                Ok(Frame::Color(frame)) => {
                    let early = PREVIEW_PERIOD.saturating_sub(elapsed(heard));
                    if !early.is_zero() && early < PREVIEW_PERIOD {
                        self.clock.sleep(early);
                    }
                    heard = self.clock.now();
                    self.previews.show(Preview::of(frame));
                }
                Ok(Frame::Depth(_)) => {}
                Err(DriverError::Timeout { .. }) if elapsed(heard) < capture.patience() => {}
                // A recording begins again.
                Err(DriverError::Ended { .. }) => break None,
                Err(error) => break refused(error),
            }
        };
        drop(stream);
        self.say(Phase::Idle, false);
        ended
    }

    /// Refuses shots while the device is away, for so long; false when all is over.
    fn refuse_for(&self, wait: Duration) -> bool {
        let until = self.clock.now() + wait;
        loop {
            self.pulse.send_if_modified(|pulse| {
                pulse.at = self.clock.now();
                false
            });
            let left = until.saturating_duration_since(self.clock.now());
            match self.clock.hear(&self.jobs, left.min(BREATH)) {
                Ok(job) => {
                    let problem = self.pulse.borrow().problem.clone();
                    let problem = problem.unwrap_or_else(|| format!("{}: lost", self.address));
                    drop(job.reply.send(Err(away(problem))));
                }
                Err(RecvTimeoutError::Disconnected) => return false,
                Err(RecvTimeoutError::Timeout) if left <= BREATH => break,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        self.pulse.send_modify(|pulse| pulse.reconnects += 1);
        true
    }

    /// Says what the device does; watchers wake only when that is something else.
    fn say(&self, phase: Phase, in_use: bool) {
        self.pulse.send_if_modified(|pulse| {
            pulse.at = self.clock.now();
            let news = pulse.phase != phase || pulse.in_use != in_use || pulse.problem.is_some();
            (pulse.phase, pulse.in_use, pulse.problem) = (phase, in_use, None);
            news
        });
    }

    fn lost(&self, problem: String) {
        self.previews.refuse(problem.clone());
        self.pulse.send_modify(|pulse| {
            (pulse.at, pulse.phase, pulse.in_use) = (self.clock.now(), Phase::Degraded, false);
            pulse.problem = Some(problem);
        });
    }
}

/// What a client hears of a device that is lost.
fn away(problem: String) -> Fault {
    Fault {
        kind: FaultKind::Device,
        message: problem,
        remedy: Some("it is opened again as soon as it is back".to_owned()),
    }
}

/// Whether a device must be opened again after this: it is gone, silent, or does not do what it should.
fn is_loss(error: &DriverError) -> bool {
    match error {
        DriverError::Unplugged { .. }
        | DriverError::Io { .. }
        | DriverError::Timeout { .. }
        | DriverError::NoDevice { .. }
        | DriverError::Hardware { .. }
        | DriverError::Malformed { .. } => true,
        DriverError::Ended { .. } | DriverError::Setting { .. } => false,
    }
}
