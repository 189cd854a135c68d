//! The daemon: owns devices and answers requests over a Unix socket, and over loopback TCP for the
//! viewer's page where that is switched on.
//!
//! A camera streams only while a shot is taken or somebody looks through it, and its flash fires only
//! for a shot. Each device has a thread, and so has developing; requests reach them through bounded
//! queues. Nothing here decides what a picture looks like: that is [`crate::develop`]'s.

mod access;
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

use crate::{api::Event, config::Config, store::Store};
use devices::Devices;
use metrics::Metrics;
use std::{
    sync::{
        Arc,
        atomic::AtomicUsize,
        mpsc::{SyncSender, sync_channel},
    },
    time::Duration,
};
use tokio::{
    net::{TcpListener, UnixListener},
    sync::{Semaphore, broadcast, watch},
};

/// Shots that memory holds at once: one that is developed, one that is taken.
const SHOTS_IN_MEMORY: usize = 2;
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
    waiting: Arc<AtomicUsize>,
    commits: SyncSender<shooting::Commit>,
    looks: SyncSender<light_table::Look>,
    viewer: Option<viewer::Guard>,
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
    store.retain(&now.shots)?;
    let latest = store.ids()?.into_iter().next();
    let events = broadcast::Sender::new(EVENTS);
    let devices = Devices::start(&config, &events)?;
    let (commits, waiting_commits) = sync_channel(SHOTS_IN_MEMORY);
    let (looks, waiting_looks) = sync_channel(LOOKS);
    let viewer = match &listeners.viewer {
        Some(listener) => Some(viewer::Guard::new(
            listener.local_addr().map_err(DaemonError::Viewer)?,
        )?),
        None => None,
    };
    let state = Arc::new(State {
        devices,
        store,
        metrics: Metrics::new(),
        events,
        latest: watch::Sender::new(latest),
        places: Arc::new(Semaphore::new(SHOTS_IN_MEMORY)),
        waiting: Arc::default(),
        commits,
        looks,
        viewer,
        config,
    });
    // Neither thread keeps the state, whose end is theirs.
    let developing = Arc::downgrade(&state);
    start_thread("darkroom", move || {
        shooting::develop(&developing, &waiting_commits);
    })?;
    start_thread("light table", move || light_table::run(&waiting_looks))?;
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
