//! Time as the daemon knows it: that of the machine, or of a rehearsal in which months pass in minutes.

use super::worker::Job;
use std::{
    sync::mpsc::{Receiver, RecvTimeoutError},
    time::{Duration, Instant, SystemTime},
};

/// What is asked of a clock.
pub(super) trait Clock: Send + Sync {
    /// Now; never goes back.
    fn now(&self) -> Instant;

    /// The date, which somebody may set at any time.
    fn date(&self) -> SystemTime;

    /// Lets so much time pass.
    fn sleep(&self, time: Duration);

    /// Waits for a job.
    ///
    /// # Errors
    /// When none came in so much time, and when none can come any more.
    fn hear(&self, jobs: &Receiver<Job>, patience: Duration) -> Result<Job, RecvTimeoutError>;
}

/// The machine's own.
pub(super) struct Machine;

impl Clock for Machine {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn date(&self) -> SystemTime {
        SystemTime::now()
    }

    fn sleep(&self, time: Duration) {
        std::thread::sleep(time);
    }

    fn hear(&self, jobs: &Receiver<Job>, patience: Duration) -> Result<Job, RecvTimeoutError> {
        jobs.recv_timeout(patience)
    }
}
