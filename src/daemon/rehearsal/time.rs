//! Virtual time: threads take turns, and whoever waits longest waits no time at all.

use super::super::{clock::Clock, worker::Job};
use std::{
    sync::{
        Arc,
        atomic::{AtomicI64, AtomicU64, Ordering},
        mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel},
    },
    time::{Duration, Instant, SystemTime},
};

/// Real time after which a thread that has its turn counts as dead or hanging.
const PATIENCE: Duration = Duration::from_secs(60);

pub(super) fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap()
}

/// The clock of all threads of a rehearsal. Only one of them runs at a time, so what they do depends on
/// nothing but the order of their deadlines.
pub(super) struct Time {
    began: (Instant, SystemTime),
    /// Since it began.
    nanos: AtomicU64,
    /// Until then whoever has its turn may go on without asking.
    horizon: AtomicU64,
    /// How far off the date was set.
    date_ahead: AtomicI64,
    calls: Sender<Call>,
}

enum Call {
    Parked(Parked),
    Left,
}

struct Parked {
    until: u64,
    /// Whether a job may end its wait.
    listens: bool,
    go: Sender<()>,
}

impl Time {
    pub fn nanos(&self) -> u64 {
        self.nanos.load(Ordering::SeqCst)
    }

    /// Sets the date forward or back.
    pub fn set_date(&self, ahead: i64) {
        self.date_ahead.store(ahead, Ordering::SeqCst);
    }

    fn pass(&self, until: u64, listens: bool) {
        if until <= self.horizon.load(Ordering::SeqCst) {
            self.nanos.fetch_max(until, Ordering::SeqCst);
            return;
        }
        let (go, going) = channel();
        let parked = Parked { until, listens, go };
        // Where the world has ended nobody gives turns any more.
        if self.calls.send(Call::Parked(parked)).is_ok() {
            let _ = going.recv();
        }
    }
}

impl Clock for Time {
    fn now(&self) -> Instant {
        self.began.0 + Duration::from_nanos(self.nanos())
    }

    fn date(&self) -> SystemTime {
        let date = self.began.1 + Duration::from_nanos(self.nanos());
        let ahead = self.date_ahead.load(Ordering::SeqCst);
        let by = Duration::from_nanos(ahead.unsigned_abs());
        if ahead < 0 { date - by } else { date + by }
    }

    fn sleep(&self, time: Duration) {
        self.pass(self.nanos() + nanos(time), false);
    }

    fn hear(&self, jobs: &Receiver<Job>, patience: Duration) -> Result<Job, RecvTimeoutError> {
        let until = self.nanos() + nanos(patience);
        loop {
            match jobs.try_recv() {
                Ok(job) => return Ok(job),
                Err(TryRecvError::Disconnected) => {
                    let _ = self.calls.send(Call::Left);
                    return Err(RecvTimeoutError::Disconnected);
                }
                Err(TryRecvError::Empty) if self.nanos() >= until => {
                    return Err(RecvTimeoutError::Timeout);
                }
                Err(TryRecvError::Empty) => self.pass(until, true),
            }
        }
    }
}

/// Gives the turns.
pub(super) struct World {
    pub time: Arc<Time>,
    calls: Receiver<Call>,
    parked: Vec<Parked>,
}

impl World {
    pub fn new() -> Self {
        let (calls, called) = channel();
        let time = Time {
            began: (Instant::now(), SystemTime::now()),
            // Nothing lies before the zero of a clock.
            nanos: AtomicU64::new(nanos(Duration::from_secs(86_400))),
            horizon: AtomicU64::new(0),
            date_ahead: AtomicI64::new(0),
            calls,
        };
        Self {
            time: Arc::new(time),
            calls: called,
            parked: Vec::new(),
        }
    }

    /// Waits until so many threads that have just been started wait for their first turn.
    pub fn gather(&mut self, threads: usize) {
        while self.parked.len() < threads {
            self.hear();
        }
    }

    fn hear(&mut self) {
        match self.calls.recv_timeout(PATIENCE) {
            Ok(Call::Parked(parked)) => self.parked.push(parked),
            Ok(Call::Left) => {}
            Err(_) => panic!("a device's thread has died, or hangs"),
        }
    }

    /// Lets time pass.
    pub fn run(&mut self, time: Duration) {
        let end = self.time.nanos() + nanos(time);
        loop {
            let first = (0..self.parked.len()).min_by_key(|place| self.parked[*place].until);
            let Some(place) = first.filter(|place| self.parked[*place].until <= end) else {
                break;
            };
            let next = self.parked.remove(place);
            let others = self.parked.iter().map(|parked| parked.until);
            let horizon = others.min().unwrap_or(end).min(end);
            self.time.nanos.fetch_max(next.until, Ordering::SeqCst);
            self.time.horizon.store(horizon, Ordering::SeqCst);
            next.go.send(()).unwrap();
            self.hear();
        }
        self.time.horizon.store(0, Ordering::SeqCst);
        self.time.nanos.fetch_max(end, Ordering::SeqCst);
    }

    /// Has everybody who waits for a job look for one.
    pub fn stir(&mut self) {
        let now = self.time.nanos();
        for parked in self.parked.iter_mut().filter(|parked| parked.listens) {
            parked.until = parked.until.min(now);
        }
    }
}
