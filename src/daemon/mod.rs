//! The daemon: owns one device and answers requests over a Unix socket.
//!
//! The camera streams, and its flash fires, only while a shot is being taken. One thread owns the
//! device; requests reach it through a bounded queue. Nothing here decides what a picture looks
//! like: that is [`crate::develop`]'s.

mod camera;
mod router;
mod server;
mod store;

pub use camera::Camera;
pub use server::{DaemonError, bind};
pub use store::{Store, StoreError};

use crate::config::Config;
use drivers::Device;
use std::sync::{
    Arc, Mutex,
    atomic::{AtomicU64, Ordering},
};
use tokio::{net::UnixListener, sync::Semaphore};

/// What every request may look at.
struct State {
    config: Config,
    camera: Camera,
    store: Store,
    /// One shot is developed at a time, so that memory holds two shots at most: the one being
    /// developed and the one being taken.
    darkroom: Arc<Semaphore>,
    shots: AtomicU64,
    failures: AtomicU64,
    latest: Mutex<Option<String>>,
}

impl State {
    fn latest(&self) -> Option<String> {
        self.latest
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
            .clone()
    }

    fn count_shot(&self, id: &str) {
        self.shots.fetch_add(1, Ordering::Relaxed);
        *self
            .latest
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner) = Some(id.to_owned());
    }
}

/// Serves `device` on `listener` until `stop` resolves, then lets open requests finish.
///
/// `ready` is called once the first request can be answered.
///
/// # Errors
/// [`DaemonError`] when the store cannot be opened or the camera's thread cannot start.
pub async fn serve(
    config: Config,
    device: Box<dyn Device>,
    listener: UnixListener,
    ready: impl FnOnce(),
    stop: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    let store = Store::open(&config.state_path())?;
    let camera = Camera::start(device, &config)?;
    let state = Arc::new(State {
        camera,
        store,
        darkroom: Arc::new(Semaphore::new(1)),
        shots: AtomicU64::new(0),
        failures: AtomicU64::new(0),
        latest: Mutex::new(None),
        config,
    });
    let router = router::router(Arc::clone(&state));
    ready();
    server::serve(listener, router, &state.config.limits, stop).await;
    Ok(())
}
