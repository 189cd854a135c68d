//! A bound for lamps that neither hardware nor kernel put out: a thread that owns the lamp.

use crate::{
    device::DriverError,
    frame::Timestamp,
    lamp::{Lamp, Lit, Moment, Reach},
};
use std::{
    sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    thread::JoinHandle,
    time::Duration,
};

enum Command {
    Fire(Duration),
    PutOut,
}

enum Answer {
    Fired(Result<Lit, DriverError>),
    Out(Result<Moment, DriverError>),
}

/// A lamp that goes dark at the end of its time though nobody asks for a frame.
///
/// The thread lives as long as this value. It does not survive SIGKILL, which is what the guard is for.
pub(super) struct Fuse {
    reach: Reach,
    /// `None` only while being dropped.
    commands: Option<Sender<Command>>,
    answers: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
}

/// How often a lamp that refuses to go dark is told again.
const INSIST: Duration = Duration::from_millis(20);

impl Fuse {
    /// Gives the lamp its thread.
    pub fn new(lamp: Box<dyn Lamp>) -> Result<Self, DriverError> {
        let reach = lamp.reach();
        let (commands, orders) = channel();
        let (replies, answers) = channel();
        let thread = std::thread::Builder::new()
            .name("flash".to_owned())
            .spawn(move || burn(lamp, &orders, &replies))
            .map_err(|error| DriverError::Hardware {
                device: "flash".into(),
                problem: format!("no thread to bound the lamp with: {error}"),
                remedy: "raise the limit of threads for this service",
            })?;
        Ok(Self {
            reach,
            commands: Some(commands),
            answers,
            thread: Some(thread),
        })
    }

    fn ask(&self, command: Command) -> Result<Answer, DriverError> {
        let ended = || DriverError::Hardware {
            device: "flash".into(),
            problem: "the thread that bounds the lamp has ended".into(),
            remedy: "start again; this is a bug",
        };
        let commands = self.commands.as_ref().ok_or_else(ended)?;
        commands.send(command).map_err(|_| ended())?;
        self.answers.recv().map_err(|_| ended())
    }
}

fn burn(mut lamp: Box<dyn Lamp>, orders: &Receiver<Command>, replies: &Sender<Answer>) {
    let mut bound: Option<Timestamp> = None;
    loop {
        let order = match bound {
            Some(bound) => orders.recv_timeout(bound.since(Timestamp::now())),
            None => orders.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        let answer = match order {
            Ok(Command::Fire(flash)) => {
                let fired = lamp.fire(flash);
                // Bounded from here: a lamp that failed half way may be lit all the same.
                bound = Some(Timestamp::now().after(flash));
                Answer::Fired(fired)
            }
            Ok(Command::PutOut) => {
                let out = lamp.put_out();
                if out.is_ok() {
                    bound = None;
                }
                Answer::Out(out)
            }
            Err(RecvTimeoutError::Timeout) => {
                bound = match lamp.put_out() {
                    Ok(_) | Err(DriverError::Unplugged { .. }) => None,
                    Err(_) => Some(Timestamp::now().after(INSIST)),
                };
                continue;
            }
            // The owner is gone; the lamp goes dark as it is dropped.
            Err(RecvTimeoutError::Disconnected) => return,
        };
        if replies.send(answer).is_err() {
            return;
        }
    }
}

impl Lamp for Fuse {
    fn reach(&self) -> Reach {
        self.reach
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        match self.ask(Command::Fire(flash))? {
            Answer::Fired(fired) => fired,
            Answer::Out(out) => Err(mixed(&out)),
        }
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        match self.ask(Command::PutOut)? {
            Answer::Out(out) => out,
            Answer::Fired(fired) => Err(mixed(&fired)),
        }
    }
}

fn mixed<T>(answer: &Result<T, DriverError>) -> DriverError {
    DriverError::Hardware {
        device: "flash".into(),
        problem: format!("answered another question (ok: {})", answer.is_ok()),
        remedy: "start again; this is a bug",
    }
}

impl Drop for Fuse {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has dropped the lamp, which is all that matters here.
            drop(thread.join());
        }
    }
}
