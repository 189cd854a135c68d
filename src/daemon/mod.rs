//! The daemon: owns devices and answers requests over a Unix socket, and over loopback TCP for the
//! viewer's page where that is switched on.
//!
//! A camera streams only while a shot is taken or somebody looks through it, and its flash fires only
//! for a shot. Each device has a thread, and so has developing; requests reach them through bounded
//! queues. Nothing here decides what a picture looks like: that is [`crate::develop`]'s.

mod access;
mod clock;
mod counted;
mod devices;
mod light_table;
mod metrics;
mod networks;
mod picture;
mod preview;
mod routes;
mod server;
mod shooting;
mod viewer;
mod worker;

pub use server::{DaemonError, bind};

use crate::{api::Event, config::Config, session, store::Store};
use clock::Clock;
use devices::Devices;
use metrics::Metrics;
use std::{
    sync::{
        Arc,
        atomic::AtomicUsize,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    time::Duration,
};
use tokio::{
    net::{TcpListener, UnixListener},
    sync::{Semaphore, broadcast, watch},
};

/// Shots that are developed at once. Besides these, memory holds one of each device: the one it takes.
const DEVELOPING: usize = 1;
/// Views that wait for the light table.
const LOOKS: usize = 16;
/// Events that a slow listener may be behind before it misses some.
const EVENTS: usize = 64;

/// What every request may look at.
struct State {
    config: watch::Receiver<Arc<Config>>,
    devices: Devices,
    store: Store,
    metrics: Metrics,
    events: broadcast::Sender<Event>,
    latest: watch::Sender<Option<String>>,
    places: Arc<Semaphore>,
    /// Shots of kept frames that wait for a place.
    waiting: Arc<AtomicUsize>,
    /// How many shots have begun and not ended.
    underway: watch::Sender<usize>,
    commits: SyncSender<shooting::Commit>,
    looks: SyncSender<light_table::Look>,
    viewer: Option<viewer::Guard>,
    clock: Arc<dyn Clock>,
}

/// What waits for the threads that work on shots.
struct Waiting {
    commits: Receiver<shooting::Commit>,
    looks: Receiver<light_table::Look>,
}

impl State {
    /// Starts the devices; nothing else runs yet.
    fn start(
        config: watch::Receiver<Arc<Config>>,
        store: Store,
        viewer: Option<viewer::Guard>,
        clock: Arc<dyn Clock>,
        open: &worker::Open,
    ) -> Result<(Arc<Self>, Waiting), DaemonError> {
        store.retain(&config.borrow().shots)?;
        let latest = store.ids()?.into_iter().next();
        let events = broadcast::Sender::new(EVENTS);
        let devices = Devices::start(&config, &events, &clock, open)?;
        let (commits, waiting_commits) = sync_channel(DEVELOPING);
        let (looks, waiting_looks) = sync_channel(LOOKS);
        let state = Arc::new(Self {
            devices,
            store,
            metrics: Metrics::new(),
            events,
            latest: watch::Sender::new(latest),
            places: Arc::new(Semaphore::new(DEVELOPING)),
            waiting: Arc::default(),
            underway: watch::Sender::new(0),
            commits,
            looks,
            viewer,
            config,
            clock,
        });
        let waiting = Waiting {
            commits: waiting_commits,
            looks: waiting_looks,
        };
        Ok((state, waiting))
    }
}

/// Where the daemon listens.
pub struct Listeners {
    /// For programs.
    pub socket: UnixListener,
    /// For the viewer's page; `None` where it is switched off.
    pub viewer: Option<TcpListener>,
}

/// What the daemon says to whoever started it.
pub struct Signs<'a> {
    /// Called once the first request can be answered; gets the address of the viewer's page.
    pub ready: &'a mut dyn FnMut(Option<&str>),
    /// Called while all is well, at least once a period.
    pub alive: &'a mut dyn FnMut(),
    /// The period.
    pub period: Duration,
}

/// Serves the devices of a configuration until `stop` resolves, then lets open requests finish.
///
/// A new configuration that comes through `config` counts from the next request on; its devices,
/// sockets and folders from the next start on.
///
/// # Errors
/// [`DaemonError`] when the store cannot be opened or a thread cannot start.
pub async fn serve(
    config: watch::Receiver<Arc<Config>>,
    listeners: Listeners,
    signs: Signs<'_>,
    stop: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    let now = config.borrow().clone();
    let (store, recovered) = Store::open(&now.state_path())?;
    for found in recovered {
        tracing::warn!("left by an earlier daemon: {found:?}");
    }
    let viewer = match &listeners.viewer {
        Some(listener) => Some(viewer::Guard::new(
            listener.local_addr().map_err(DaemonError::Viewer)?,
        )?),
        None => None,
    };
    let open: worker::Open = Arc::new(session::open);
    let (state, waiting) = State::start(config, store, viewer, Arc::new(clock::Machine), &open)?;
    let Waiting { commits, looks } = waiting;
    // Neither thread keeps the state, whose end is theirs.
    let developing = Arc::downgrade(&state);
    start_thread("darkroom", move || {
        shooting::develop(&developing, &commits);
    })?;
    start_thread("light table", move || light_table::run(&looks))?;
    state.devices.opened().await;
    let page = state.viewer.as_ref().map(viewer::Guard::page);
    (signs.ready)(page.as_deref());
    let watching = async {
        let mut ticks = tokio::time::interval(signs.period);
        loop {
            ticks.tick().await;
            // A device's thread that hangs is seen by the service manager, which starts all anew.
            if state.devices.are_alive() {
                (signs.alive)();
            }
        }
    };
    tokio::select! {
        () = server::serve(&state, listeners, stop) => {}
        () = watching => {}
    }
    Ok(())
}

fn start_thread(name: &str, run: impl FnOnce() + Send + 'static) -> Result<(), DaemonError> {
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn(run)
        .map(drop)
        .map_err(DaemonError::Thread)
}

#[cfg(test)]
mod rehearsal;
