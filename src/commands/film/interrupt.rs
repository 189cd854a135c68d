//! Ctrl-C, noticed between two frames, so that no unfinished file is left.

use std::{future::poll_fn, task::Poll};
use tokio::{
    runtime::Runtime,
    signal::unix::{Signal, SignalKind, signal},
};

/// What listens, where the system lets it; else an interrupt ends the process as usual.
pub(super) struct Interrupt(Option<(Runtime, [Signal; 2])>);

impl Interrupt {
    /// From now on interrupts and requests to terminate are only noticed.
    pub fn listen() -> Self {
        let begun = || {
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_io()
                .build()?;
            let signals = {
                let _entered = runtime.enter();
                [
                    signal(SignalKind::interrupt())?,
                    signal(SignalKind::terminate())?,
                ]
            };
            Ok::<_, std::io::Error>((runtime, signals))
        };
        Self(begun().ok())
    }

    /// True once one came.
    pub fn came(&mut self) -> bool {
        let Some((runtime, signals)) = &mut self.0 else {
            return false;
        };
        runtime.block_on(async {
            // Lets the runtime look for signals.
            tokio::task::yield_now().await;
            poll_fn(|context| {
                let came = signals
                    .iter_mut()
                    .any(|one| one.poll_recv(context).is_ready());
                Poll::Ready(came)
            })
            .await
        })
    }
}
