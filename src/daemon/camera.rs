//! The thread that owns the device.

use super::DaemonError;
use crate::{
    api::{Fault, FaultKind},
    config::Config,
    session::{self, Taken},
};
use drivers::{Device, DeviceInfo};
use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};
use tokio::sync::{mpsc, oneshot};

type Reply = oneshot::Sender<Result<Taken, Fault>>;

/// A handle on the camera's thread; dropping it ends the thread after the shot it is taking.
pub struct Camera {
    info: DeviceInfo,
    in_use: Arc<AtomicBool>,
    requests: mpsc::Sender<Reply>,
}

impl Camera {
    /// Gives the device a thread of its own.
    ///
    /// # Errors
    /// [`DaemonError::Thread`] when the system has none left.
    pub fn start(mut device: Box<dyn Device>, config: &Config) -> Result<Self, DaemonError> {
        let (requests, mut waiting) = mpsc::channel::<Reply>(config.limits.queue);
        let in_use = Arc::new(AtomicBool::new(false));
        let info = device.info();
        let capture = config.capture.clone();
        let shown = Arc::clone(&in_use);
        std::thread::Builder::new()
            .name("camera".to_owned())
            .spawn(move || {
                while let Some(reply) = waiting.blocking_recv() {
                    // A client that has gone away does not need the flash to fire.
                    if reply.is_closed() {
                        continue;
                    }
                    shown.store(true, Ordering::SeqCst);
                    // A driver that panics fails its own shot and nothing else.
                    let taken = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                        session::take(device.as_mut(), &capture)
                    }));
                    shown.store(false, Ordering::SeqCst);
                    let answer = match taken {
                        Ok(Ok(taken)) => Ok(taken),
                        Ok(Err(error)) => Err(error.fault()),
                        Err(_) => Err(Fault {
                            kind: FaultKind::Device,
                            message: format!("{}: its driver failed", device.info().address),
                            remedy: Some("restart the daemon and report this as a bug".to_owned()),
                        }),
                    };
                    // The client may have left meanwhile; the shot is then nobody's.
                    drop(reply.send(answer));
                }
            })
            .map_err(DaemonError::Thread)?;
        Ok(Self {
            info,
            in_use,
            requests,
        })
    }

    /// The device.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// True from before the device streams until after it has stopped.
    pub fn in_use(&self) -> bool {
        self.in_use.load(Ordering::SeqCst)
    }

    /// Takes a shot after those already waiting.
    ///
    /// # Errors
    /// [`Fault`] of kind daemon when too many wait already, else what the device said.
    pub async fn shoot(&self) -> Result<Taken, Fault> {
        let (reply, answer) = oneshot::channel();
        let fault = |message: &str, remedy: &str| Fault {
            kind: FaultKind::Daemon,
            message: message.to_owned(),
            remedy: Some(remedy.to_owned()),
        };
        self.requests
            .try_send(reply)
            .map_err(|refused| match refused {
                mpsc::error::TrySendError::Full(_) => fault(
                    "busy: limits.queue shots wait for the camera already",
                    "ask again in a few seconds",
                ),
                mpsc::error::TrySendError::Closed(_) => {
                    fault("the camera's thread has ended", "restart the daemon")
                }
            })?;
        answer
            .await
            .map_err(|_| fault("the camera's thread has ended", "restart the daemon"))?
    }
}
