//! A shot from request to acknowledgement, whether or not whoever asked for it stays.

use super::{
    State as Daemon, access::Caller, counted::Counted, devices::Committing, networks::Networks,
};
use crate::{
    api::{
        CheckedLights, EnvironmentLight, Event, Fault, FaultKind, Light, LightError,
        RelightRequest, ShotReply, ShotRequest, Tier,
    },
    config::Config,
    darkroom::{Answering, Asked},
    inference::{self, InferenceError},
    output::{Destination, Existing, FRAMES},
    relight::networks::Variant,
    session::{self, Kept, SessionError, Taken},
};
use drivers::replay::Replay;
use std::{
    sync::{Arc, Weak},
    time::{Duration, Instant},
};
use tokio::sync::{OwnedSemaphorePermit, oneshot, watch};

/// What is known of a shot while it comes about: the newest step, and at last what became of it.
pub(super) struct Underway {
    /// The newest step, in words.
    pub step: watch::Receiver<String>,
    /// What became of it.
    pub done: oneshot::Receiver<Result<ShotReply, Fault>>,
}

/// Lights and what answers for them, checked.
struct Wanted {
    lights: Option<CheckedLights>,
    asked: Asked,
}

/// One shot to develop and commit, on the thread that does it.
pub(super) struct Commit {
    taken: Taken,
    wanted: Wanted,
    config: Arc<Config>,
    step: watch::Sender<String>,
    done: oneshot::Sender<Result<ShotReply, Fault>>,
    asked_at: Instant,
    _place: OwnedSemaphorePermit,
    _committing: Option<Committing>,
    _begun: Begun,
}

/// Counts a shot that has begun, until it is dropped.
struct Begun(Arc<Daemon>);

impl Begun {
    fn new(daemon: &Arc<Daemon>) -> Self {
        daemon.underway.send_modify(|shots| *shots += 1);
        Self(Arc::clone(daemon))
    }
}

impl Drop for Begun {
    fn drop(&mut self) {
        self.0.underway.send_modify(|shots| *shots -= 1);
    }
}

/// Begins a shot. Everything that can be checked is checked before the flash fires.
///
/// # Errors
/// [`Fault`] for a request that makes no sense, and where there is no room for a shot.
pub(super) async fn begin(
    daemon: &Arc<Daemon>,
    caller: Caller,
    request: ShotRequest,
) -> Result<Underway, Fault> {
    let config = daemon.config.borrow().clone();
    let none = !request.relight && (!request.lights.is_empty() || request.environment.is_some());
    if none {
        return Err(refused(
            "lights: given, but relight is false; set relight to true",
        ));
    }
    let unusual = request.tier != Tier::default() || request.budget_ms.is_some();
    if unusual && !request.relight {
        return Err(refused(
            "tier: given, but relight is false; set relight to true",
        ));
    }
    request.check_burst(config.limits.burst).map_err(refused)?;
    let environment = request.environment.as_ref();
    let (lights, relight) = (&request.lights, request.relight);
    let answers = (request.tier, request.variant, request.budget_ms);
    let wanted = wanted(&config, lights, environment, relight, answers).await?;
    let (address, burst) = (request.device.clone(), request.burst);
    daemon.devices.find(address.as_deref())?;
    let reserve = || {
        daemon
            .store
            .reserve(&config.shots)
            .map_err(|error| error.fault())
    };
    reserve()?;
    let (step, steps) = watch::channel("waiting for the camera".to_owned());
    let (done, became) = oneshot::channel();
    let daemon = Arc::clone(daemon);
    let begun = Begun::new(&daemon);
    tokio::spawn(async move {
        let asked_at = daemon.clock.now();
        let taken = async {
            let handle = daemon.devices.find(address.as_deref())?;
            // A device that hangs keeps nobody waiting but those who wait for it.
            let turn = handle.turn(&config).await?;
            // Those before this one may have filled the disk meanwhile.
            daemon
                .store
                .reserve(&config.shots)
                .map_err(|error| error.fault())?;
            if step.is_closed() {
                return Err(refused("whoever asked has gone away"));
            }
            tracing::info!(device = %handle.address, by = %caller, "shot");
            step.send_replace("taking the shot".to_owned());
            let taken = handle.shoot(&config, burst).await?;
            let committing = daemon.devices.committing(handle);
            let place = daemon.place().await?;
            drop(turn);
            Ok((place, taken, committing))
        };
        match taken.await {
            Ok((place, taken, committing)) => daemon.commit(Commit {
                taken,
                wanted,
                config,
                step,
                done,
                asked_at,
                _place: place,
                _committing: Some(committing),
                _begun: begun,
            }),
            Err(fault) => daemon.failed(done, fault),
        }
    });
    Ok(Underway {
        step: steps,
        done: became,
    })
}

/// Develops a kept shot once more; what comes of it is a new one.
///
/// # Errors
/// As [`begin`].
pub(super) async fn begin_again(
    daemon: &Arc<Daemon>,
    id: &str,
    request: RelightRequest,
) -> Result<Underway, Fault> {
    let config = daemon.config.borrow().clone();
    let environment = request.environment.as_ref();
    let answers = (request.tier, request.variant, request.budget_ms);
    let wanted = wanted(&config, &request.lights, environment, true, answers).await?;
    let path = daemon
        .store
        .file(id, FRAMES)
        .map_err(|error| error.fault())?;
    daemon
        .store
        .reserve(&config.shots)
        .map_err(|error| error.fault())?;
    let (step, steps) = watch::channel("reading its frames".to_owned());
    let (done, became) = oneshot::channel();
    let daemon = Arc::clone(daemon);
    let id = id.to_owned();
    let begun = Begun::new(&daemon);
    tokio::spawn(async move {
        let asked_at = daemon.clock.now();
        let taken = async {
            let waiting = Counted::new(&daemon.waiting);
            if waiting.count() > config.limits.queue {
                return Err(busy());
            }
            let place = daemon.place().await?;
            drop(waiting);
            let capture = config.capture.clone();
            let read = tokio::task::spawn_blocking(move || {
                let mut replay = Replay::open(&path).map_err(SessionError::from)?;
                session::take(&mut replay, &capture, None)
            });
            let mut taken = read.await.map_err(broken)?.map_err(|error| error.fault())?;
            taken.info.address = id;
            Ok((place, taken))
        };
        match taken.await {
            Ok((place, taken)) => daemon.commit(Commit {
                taken,
                wanted,
                config,
                step,
                done,
                asked_at,
                _place: place,
                _committing: None,
                _begun: begun,
            }),
            Err(fault) => daemon.failed(done, fault),
        }
    });
    Ok(Underway {
        step: steps,
        done: became,
    })
}

impl Daemon {
    /// Waits until another shot can be developed.
    async fn place(&self) -> Result<OwnedSemaphorePermit, Fault> {
        let place = Arc::clone(&self.places).acquire_owned().await;
        place.map_err(|_| busy())
    }

    /// Hands a shot to the thread that develops.
    fn commit(&self, commit: Commit) {
        // As many places as there are permits, so it is never full.
        if let Err(refused) = self.commits.try_send(commit) {
            let (std::sync::mpsc::TrySendError::Full(commit)
            | std::sync::mpsc::TrySendError::Disconnected(commit)) = refused;
            let fault = Fault {
                kind: FaultKind::Daemon,
                message: "the thread that develops has ended".to_owned(),
                remedy: Some("restart the daemon".to_owned()),
            };
            self.failed(commit.done, fault);
        }
    }

    fn failed(&self, done: oneshot::Sender<Result<ShotReply, Fault>>, fault: Fault) {
        tracing::warn!("shot failed: {}", fault.message);
        self.metrics.failures.inc();
        // Whoever asked may have gone away.
        drop(done.send(Err(fault)));
    }
}

/// Develops and commits one shot after the other, until nobody can ask any more.
pub(super) fn develop(daemon: &Weak<Daemon>, commits: &std::sync::mpsc::Receiver<Commit>) {
    let mut networks = Networks::default();
    while let Ok(commit) = commits.recv() {
        // Whoever asked is a task of the daemon, and holds it.
        let Some(daemon) = daemon.upgrade() else {
            return;
        };
        develop_one(&daemon, &mut networks, commit);
    }
}

/// Develops and commits one shot, and tells whoever asked and everybody else.
pub(super) fn develop_one(daemon: &Daemon, networks: &mut Networks, commit: Commit) {
    let begun = std::panic::AssertUnwindSafe(|| keep(daemon, networks, &commit));
    let kept = std::panic::catch_unwind(begun).unwrap_or_else(|_| {
        *networks = Networks::default();
        Err(Fault {
            kind: FaultKind::Daemon,
            message: "the shot failed in the daemon".to_owned(),
            remedy: Some("report this as a bug, with the daemon's log".to_owned()),
        })
    });
    let Commit {
        done,
        asked_at,
        taken,
        _committing: committing,
        ..
    } = commit;
    match kept {
        Ok((id, kept)) => {
            let took = daemon.clock.now().saturating_duration_since(asked_at);
            daemon.metrics.shots.inc();
            daemon.metrics.shot_seconds.observe(took.as_secs_f64());
            daemon.latest.send_replace(Some(id.clone()));
            // Nobody may be listening.
            let _ = daemon.events.send(Event::Committed { id: id.clone() });
            tracing::info!(id, "committed");
            // Whoever hears that the shot is done finds the device idle.
            drop(committing);
            drop(done.send(Ok(ShotReply {
                id,
                device: taken.info.address,
                files: kept.files,
                warnings: kept.warnings,
                shot: kept.manifest,
            })));
        }
        Err(fault) => {
            drop(committing);
            daemon.failed(done, fault);
        }
    }
}

fn keep(
    daemon: &Daemon,
    networks: &mut Networks,
    commit: &Commit,
) -> Result<(String, Kept), Fault> {
    let Commit {
        taken,
        wanted,
        config,
        step,
        ..
    } = commit;
    let (id, folder) = daemon.store.next(daemon.clock.date());
    let mut lights = wanted.lights.clone();
    let closed = Answering::Closed;
    let answering = match &mut lights {
        None => &closed,
        Some(lights) => {
            let ready = networks.ready(wanted.asked, &config.inference);
            let (answering, said) = ready.map_err(|error| SessionError::from(error).fault())?;
            lights.warnings.extend(said);
            answering
        }
    };
    let mut observe = |words: &str| {
        step.send_replace(words.to_owned());
    };
    let to = Destination {
        disk: daemon.store.disk(),
        folder: &folder,
        existing: Existing::Refuse,
    };
    let kept = session::keep(taken, lights.as_ref(), answering, &to, &mut observe);
    let kept = kept.map_err(|error| error.fault())?;
    match daemon.store.count(&id, &config.shots) {
        Ok(gone) => {
            for id in gone {
                tracing::info!(id, "deleted, beyond shots.keep_newest");
                let _ = daemon.events.send(Event::Deleted { id });
            }
        }
        Err(error) => tracing::warn!("{error}"),
    }
    Ok((id, kept))
}

/// Checks lights and what answers.
async fn wanted(
    config: &Arc<Config>,
    lights: &[Light],
    environment: Option<&EnvironmentLight>,
    relight: bool,
    (tier, variant, budget_ms): (Tier, Variant, Option<f64>),
) -> Result<Wanted, Fault> {
    let lights = CheckedLights::new(lights, config.limits.lights, environment)
        .map_err(|error| refused(error.to_string()))?;
    if relight && lights.is_empty() {
        return Err(refused(LightError::None.to_string()));
    }
    let budget = match budget_ms {
        None => None,
        Some(_) if tier != Tier::Auto => {
            return Err(refused(
                "budget_ms: given with another tier than auto; leave one out",
            ));
        }
        Some(ms) if ms > 0.0 && ms <= 3.6e6 => Some(Duration::from_secs_f64(ms / 1e3)),
        Some(ms) => {
            let words = format!("budget_ms is {ms}; it must be above 0 and at most 3600000");
            return Err(refused(words));
        }
    };
    if matches!(tier, Tier::Compact | Tier::Paper) {
        let settings = config.inference.clone();
        let check = move || match tier {
            Tier::Compact => inference::check_compact(&settings),
            _ => inference::check_paper(variant, &settings),
        };
        let checked = tokio::task::spawn_blocking(check).await.map_err(broken)?;
        checked.map_err(unusable)?;
    }
    Ok(Wanted {
        lights: relight.then_some(lights),
        asked: Asked {
            tier,
            variant,
            budget,
        },
    })
}

/// Too many wait already.
pub(super) fn busy() -> Fault {
    Fault {
        kind: FaultKind::Daemon,
        message: "busy: limits.queue shots wait already".to_owned(),
        remedy: Some("ask again in a few seconds".to_owned()),
    }
}

/// A request that makes no sense.
pub(super) fn refused(message: impl Into<String>) -> Fault {
    Fault {
        kind: FaultKind::Request,
        message: message.into(),
        remedy: None,
    }
}

/// A network that cannot be had.
fn unusable(error: InferenceError) -> Fault {
    Fault {
        kind: FaultKind::Input,
        message: error.to_string(),
        remedy: None,
    }
}

/// A task that panicked: our bug, and the request's end, but not the daemon's.
pub(super) fn broken(error: tokio::task::JoinError) -> Fault {
    tracing::error!("a request failed: {error}");
    Fault {
        kind: FaultKind::Daemon,
        message: "the request failed in the daemon".to_owned(),
        remedy: Some("report this as a bug, with the daemon's log".to_owned()),
    }
}
