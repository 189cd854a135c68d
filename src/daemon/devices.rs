//! All devices of the daemon, one thread each, and the eye on them.

use super::{
    DaemonError,
    clock::Clock,
    counted::Counted,
    preview::Previews,
    shooting::busy,
    worker::{Job, Open, Pulse, Worker},
};
use crate::{
    api::{DeviceStatus, Event, Fault, FaultKind, Phase},
    config::Config,
    session::Taken,
};
use std::{
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
        mpsc::{SyncSender, TrySendError, sync_channel},
    },
    time::Duration,
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, broadcast, oneshot, watch};

/// Silence of a device's thread from which it hangs: its driver does not keep its patience.
const HANGS_AFTER: Duration = Duration::from_secs(10);
/// What a shot may take beyond its deadline before whoever asked is told that it does not come.
const GRACE: Duration = Duration::from_secs(5);

/// One device, seen from outside its thread.
pub(super) struct Handle {
    /// As it is configured.
    pub address: String,
    /// Looking through it.
    pub previews: Previews,
    jobs: SyncSender<Job>,
    pulse: watch::Receiver<Pulse>,
    committing: Arc<AtomicUsize>,
    /// One shot is taken at a time; so many wait for it.
    turn: Arc<Semaphore>,
    waiting: Arc<AtomicUsize>,
    clock: Arc<dyn Clock>,
}

/// A shot of a device that is being developed and written, until it is dropped.
pub(super) struct Committing(Arc<AtomicUsize>, broadcast::Sender<Event>, String);

impl Drop for Committing {
    fn drop(&mut self) {
        if self.0.fetch_sub(1, Ordering::SeqCst) == 1 {
            tell(&self.1, &self.2, Phase::Idle, None);
        }
    }
}

/// All of them.
pub(super) struct Devices {
    handles: Vec<Handle>,
    events: broadcast::Sender<Event>,
}

impl Devices {
    /// Gives each device of the configuration a thread of its own, which opens it by `open`.
    ///
    /// # Errors
    /// [`DaemonError::Thread`] when the system has none left.
    pub fn start(
        config: &watch::Receiver<Arc<Config>>,
        events: &broadcast::Sender<Event>,
        clock: &Arc<dyn Clock>,
        open: &Open,
    ) -> Result<Self, DaemonError> {
        let mut handles = Vec::new();
        for address in &config.borrow().devices {
            let (jobs, waiting) = sync_channel(config.borrow().limits.queue);
            let (pulse, felt) = watch::channel(Pulse::first(address, clock.now()));
            let previews = Previews::new();
            let worker = Worker {
                address: address.clone(),
                config: config.clone(),
                jobs: waiting,
                pulse,
                previews: previews.clone(),
                clock: Arc::clone(clock),
                open: Arc::clone(open),
            };
            std::thread::Builder::new()
                .name(format!("device {}", handles.len()))
                .spawn(move || worker.run())
                .map_err(DaemonError::Thread)?;
            tokio::spawn(announce(felt.clone(), events.clone()));
            handles.push(Handle {
                address: address.clone(),
                previews,
                jobs,
                pulse: felt,
                committing: Arc::default(),
                turn: Arc::new(Semaphore::new(1)),
                waiting: Arc::default(),
                clock: Arc::clone(clock),
            });
        }
        let events = events.clone();
        Ok(Self { handles, events })
    }

    /// The device at an address, the first without one.
    ///
    /// # Errors
    /// [`Fault`] of kind request for an address that is not configured.
    pub fn find(&self, address: Option<&str>) -> Result<&Handle, Fault> {
        let known = |handle: &&Handle| match address {
            None => true,
            Some(wanted) => {
                handle.address == wanted || handle.pulse.borrow().info.address == wanted
            }
        };
        self.handles.iter().find(known).ok_or_else(|| Fault {
            kind: FaultKind::Request,
            message: format!(
                "device {:?} is not one of this daemon's",
                address.unwrap_or("")
            ),
            remedy: Some(
                "GET /v1/status lists them; `devices` in the configuration sets them".to_owned(),
            ),
        })
    }

    /// The device of that number in the configuration, from 0.
    pub fn number(&self, number: usize) -> Option<&Handle> {
        self.handles.get(number)
    }

    /// How each is, and how many previews it showed.
    pub fn statuses(&self) -> impl Iterator<Item = (DeviceStatus, u64)> {
        self.handles
            .iter()
            .map(|handle| (handle.status(), handle.previews.shown()))
    }

    /// True when every thread was heard of lately: when not, the service manager should know.
    pub fn are_alive(&self) -> bool {
        self.handles.iter().all(|handle| !handle.hangs())
    }

    /// Says that a shot of a device is being committed, until what is returned is dropped.
    pub fn committing(&self, handle: &Handle) -> Committing {
        handle.committing.fetch_add(1, Ordering::SeqCst);
        let address = handle.status().device.address;
        tell(&self.events, &address, Phase::Committing, None);
        Committing(Arc::clone(&handle.committing), self.events.clone(), address)
    }

    /// Waits until every device was opened once or could not be.
    pub async fn opened(&self) {
        for handle in &self.handles {
            let mut pulse = handle.pulse.clone();
            // A thread that has ended says nothing more.
            let _ = pulse
                .wait_for(|pulse| pulse.problem.as_deref() != Some("not opened yet"))
                .await;
        }
    }
}

impl Handle {
    /// True when its thread was not heard of for long.
    fn hangs(&self) -> bool {
        let at = self.pulse.borrow().at;
        self.clock.now().saturating_duration_since(at) >= HANGS_AFTER
    }

    /// How it is.
    pub fn status(&self) -> DeviceStatus {
        let hangs = self.hangs();
        let pulse = self.pulse.borrow();
        let problem = if hangs {
            Some(format!(
                "{}: its driver does not answer; unplug it, or restart the daemon",
                self.address
            ))
        } else {
            pulse.problem.clone()
        };
        let phase = match pulse.phase {
            _ if hangs => Phase::Degraded,
            Phase::Idle if self.committing.load(Ordering::SeqCst) > 0 => Phase::Committing,
            other => other,
        };
        DeviceStatus {
            address: self.address.clone(),
            device: pulse.info.clone(),
            phase,
            in_use: pulse.in_use,
            problem,
            reconnects: pulse.reconnects,
        }
    }

    /// Waits until nobody else takes a shot with it.
    ///
    /// # Errors
    /// [`Fault`] of kind daemon when too many wait already.
    pub async fn turn(&self, config: &Config) -> Result<OwnedSemaphorePermit, Fault> {
        let waiting = Counted::new(&self.waiting);
        if waiting.count() > config.limits.queue {
            return Err(busy());
        }
        let turn = Arc::clone(&self.turn).acquire_owned().await;
        turn.map_err(|_| busy())
    }

    /// Takes a shot, of a burst of so many frames where one is given; whoever asks has its turn.
    ///
    /// # Errors
    /// [`Fault`] of kind daemon when the device's thread has not come back from earlier shots, else what
    /// the device said.
    pub async fn shoot(&self, config: &Config, burst: Option<u32>) -> Result<Taken, Fault> {
        let _claim = self.previews.claim();
        let (reply, answer) = oneshot::channel();
        let fault = |kind, message: String, remedy: &str| Fault {
            kind,
            message,
            remedy: Some(remedy.to_owned()),
        };
        let ended = || {
            let message = format!("{}: its thread has ended", self.address);
            fault(FaultKind::Daemon, message, "restart the daemon")
        };
        self.jobs
            .try_send(Job { burst, reply })
            .map_err(|refused| match refused {
                TrySendError::Full(_) => busy(),
                TrySendError::Disconnected(_) => ended(),
            })?;
        let most = config.capture.deadline_of(burst) + GRACE;
        let asked = self.clock.now();
        match tokio::time::timeout(most, answer).await {
            Ok(answer) => answer.map_err(|_| ended())?,
            Err(_) => Err(fault(
                FaultKind::Device,
                format!(
                    "{}: no shot within {:.0?}",
                    self.address,
                    self.clock.now().saturating_duration_since(asked)
                ),
                "unplug the device, or restart the daemon",
            )),
        }
    }
}

/// Tells everybody what a device does, whenever that is something else.
async fn announce(mut pulse: watch::Receiver<Pulse>, events: broadcast::Sender<Event>) {
    let mut before = (Phase::Degraded, None, false);
    while pulse.changed().await.is_ok() {
        let Pulse {
            info,
            phase,
            problem,
            in_use,
            ..
        } = pulse.borrow_and_update().clone();
        if before.2 != in_use {
            tracing::info!(device = %info.address, in_use, "camera");
        }
        if before.0 != phase || before.1 != problem {
            tell(&events, &info.address, phase, problem.clone());
        }
        before = (phase, problem, in_use);
    }
}

fn tell(events: &broadcast::Sender<Event>, address: &str, phase: Phase, problem: Option<String>) {
    // Nobody may be listening.
    let _ = events.send(Event::Device {
        address: address.to_owned(),
        phase,
        problem,
    });
}
