//! Every fault of a camera in every state of the daemon.

use super::{
    Asked, Piece, STEP, Stage, alone,
    camera::{Camera, Fault, Moment, Strings},
    faults::FAULTS,
    time::{World, nanos},
};
use crate::{
    api::{FaultKind, Phase},
    config::{Capture, Config},
};
use std::{
    path::Path,
    sync::{Arc, atomic::Ordering::SeqCst},
    time::Duration,
};

/// Longest silence of a camera, and longest wait for a shot.
pub(super) const PATIENCE: Duration = Duration::from_millis(500);
const DEADLINE: Duration = Duration::from_secs(2);
/// How long a fault lasts.
const LASTS: Duration = Duration::from_secs(3);
/// Silence of a driver from which the service manager no longer hears that all is well, and a little.
const WATCHDOG: Duration = Duration::from_secs(11);
/// A shot takes three pictures, and is looked for at every step.
const SHOT: Duration = Duration::from_millis(250);
/// From the end of a fault to the first whole shot.
const BACK: Duration = Duration::from_secs(2).saturating_add(SHOT);

const FAULTY: usize = 0;
const OTHER: usize = 1;

/// Where the daemon stands when the fault strikes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    Idle,
    /// Somebody looks through the camera.
    Looking,
    /// A shot is asked for, and no frame has come.
    Armed,
    /// The frame with flash has come.
    Bracketing,
    /// The shot is taken and waits to be developed and written.
    Committing,
    /// The camera is away, and comes back with the fault.
    Degraded,
}

const STATES: [State; 6] = [
    State::Idle,
    State::Looking,
    State::Armed,
    State::Bracketing,
    State::Committing,
    State::Degraded,
];

/// What became of the shot that was underway, or of the first asked for while the fault lasted.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outcome {
    /// Right all the same.
    Right,
    /// Failed, and said how.
    Told,
    /// The driver hung until the service manager would have started the daemon anew.
    Watchdog,
}

struct Trial<'a> {
    stage: &'a mut Stage,
    name: &'static str,
    fault: Fault,
    /// How long it lasts.
    lasts: Duration,
    /// Whether the watchdog was left hungry.
    hung: bool,
}

impl Trial<'_> {
    fn camera(&self) -> Arc<Strings> {
        Arc::clone(&self.stage.cameras[FAULTY])
    }

    /// How long one call of the driver may take, whatever patience it was given.
    fn blocks(&self) -> Duration {
        match self.fault {
            Fault::Blocks(time) => time,
            _ => Duration::ZERO,
        }
    }

    /// Brings the daemon into a state and lets the fault strike; returns the shot that is underway.
    fn strike(&mut self, place: usize, state: State) -> Option<Asked> {
        let camera = self.camera();
        let mut underway = None;
        match state {
            State::Idle => camera.strike(place, Moment::Now),
            State::Looking => {
                self.stage.run(Duration::from_millis(500));
                assert!(camera.streams.load(SeqCst));
                camera.strike(place, Moment::Now);
            }
            State::Armed => {
                underway = Some(self.stage.ask(FAULTY));
                camera.strike(place, Moment::Now);
            }
            State::Bracketing => {
                underway = Some(self.stage.ask(FAULTY));
                camera.strike(place, Moment::AfterFlash);
            }
            State::Committing => {
                self.stage.holds_commits = true;
                underway = Some(self.stage.ask(FAULTY));
                self.stage.run(SHOT * 2);
                assert_eq!(self.stage.phase(FAULTY), Phase::Committing);
                camera.strike(place, Moment::Now);
                self.stage.run(STEP);
                self.stage.holds_commits = false;
            }
            State::Degraded => {
                camera.pull();
                let mut lost = self.stage.ask(FAULTY);
                let told = self.stage.wait(&mut lost, DEADLINE).expect("an answer");
                assert!(told.is_err());
                self.stage.run(Duration::from_secs(5));
                assert_eq!(self.stage.phase(FAULTY), Phase::Degraded);
                camera.strike(place, Moment::Now);
                camera.put_back();
                // Long enough to be opened again, where the fault allows that.
                self.stage.run(BACK);
                underway = Some(self.stage.ask(FAULTY));
            }
        }
        underway
    }

    /// Lets the fault last; meanwhile the other camera takes one right shot after the other.
    fn endure(&mut self) {
        let end = self.stage.world.time.nanos() + nanos(self.lasts);
        while self.stage.world.time.nanos() < end {
            let mut asked = self.stage.ask(OTHER);
            let told = self.stage.wait(&mut asked, SHOT * 2);
            let told = told.unwrap_or_else(|| panic!("{}: the other camera waits", self.name));
            told.unwrap_or_else(|error| panic!("{}: the other camera: {error:?}", self.name));
            self.hung |= !self.stage.daemon().devices.are_alive();
            self.stage.run(Duration::from_millis(700));
        }
    }

    /// What became of a shot; whoever asked is told by the deadline, one silence later at most.
    fn outcome(&mut self, mut asked: Asked) -> Outcome {
        let due = asked.at + nanos(DEADLINE + PATIENCE + SHOT + self.blocks() * 2);
        let left = due.saturating_sub(self.stage.world.time.nanos());
        let told = match self.stage.answer(&mut asked) {
            Some(told) => Some(told),
            None => self.stage.wait(&mut asked, Duration::from_nanos(left)),
        };
        match told.unwrap_or_else(|| panic!("{}: no answer", self.name)) {
            Ok(_) => Outcome::Right,
            Err(fault) => {
                let typed = [FaultKind::Device, FaultKind::Input].contains(&fault.kind);
                assert!(
                    typed && !fault.message.is_empty(),
                    "{}: {fault:?}",
                    self.name
                );
                Outcome::Told
            }
        }
    }

    /// How long after now the first right shot is there.
    fn recovery(&mut self) -> Duration {
        let mended = self.stage.world.time.nanos();
        loop {
            let mut asked = self.stage.ask(FAULTY);
            let told = self.stage.wait(&mut asked, DEADLINE + self.blocks() * 2);
            let took = Duration::from_nanos(self.stage.world.time.nanos() - mended);
            match told {
                Some(Ok(_)) => return took,
                Some(Err(_)) if took < BACK + self.blocks() => {}
                told => panic!("{}: not back after {took:.1?}: {told:?}", self.name),
            }
        }
    }
}

/// Tries one fault in one state; what became of the shot, and how long after the fault's end the next was there.
fn attempt(stage: &mut Stage, place: usize, state: State) -> (Outcome, Duration) {
    let (name, fault) = FAULTS[place];
    let mut trial = Trial {
        stage,
        name,
        fault,
        lasts: LASTS,
        hung: false,
    };
    trial.lasts = LASTS.max(trial.blocks());
    let looking = (state == State::Looking).then(|| {
        let handle = trial.stage.daemon().devices.number(FAULTY).unwrap();
        handle.previews.look().0
    });
    let underway = trial.strike(place, state);
    trial.endure();
    let outcome = match underway {
        Some(asked) => trial.outcome(asked),
        None => Outcome::Right,
    };
    trial.camera().mend();
    drop(looking);
    let back = trial.recovery();
    let hangs = trial.blocks() > WATCHDOG && !matches!(state, State::Idle | State::Committing);
    assert_eq!(trial.hung, hangs, "{name}: what the watchdog heard");
    match hangs {
        true => (Outcome::Watchdog, back),
        false => (outcome, back),
    }
}

#[test]
fn whatever_a_camera_does_in_whatever_state_shots_are_right_or_refused_in_words_and_others_go_on() {
    alone(Piece::Matrix, FAULTS.len());
}

/// Tries the first so many faults in every state.
pub(super) fn matrix(folder: &Path, faults: usize) {
    let cameras = vec![Strings::new(FAULTS), Strings::new(FAULTS)];
    let world = World::new();
    let (time, strings) = (Arc::clone(&world.time), cameras.clone());
    let open = Arc::new(move |address: &str, _: Option<&Path>| {
        let number: usize = address.trim_start_matches("staged:").parse().unwrap();
        let camera = Camera::open(number as u64, &strings[number], &time)?;
        Ok(Box::new(camera) as Box<dyn drivers::Device>)
    });
    let config = Config {
        capture: Capture {
            patience_seconds: PATIENCE.as_secs_f64(),
            deadline_seconds: DEADLINE.as_secs_f64(),
            ..Capture::default()
        },
        ..Config::default()
    };
    let mut stage = Stage::new(folder, cameras, config, world, open);
    let (mut unseen, mut right, mut told, mut watchdog) = (0, 0, 0, 0);
    let mut times = Vec::new();
    for (place, (name, fault)) in FAULTS.iter().enumerate().take(faults) {
        let mut cells = Vec::new();
        for state in STATES {
            let (outcome, back) = attempt(&mut stage, place, state);
            // How long a driver blocks that does not keep its patience is its own affair.
            if !matches!(fault, Fault::Blocks(time) if *time > PATIENCE) {
                times.push(back);
            }
            let (word, count) = match outcome {
                Outcome::Right if matches!(state, State::Idle | State::Looking) => {
                    ("unseen", &mut unseen)
                }
                Outcome::Right => ("right", &mut right),
                Outcome::Told => ("told", &mut told),
                Outcome::Watchdog => ("watchdog", &mut watchdog),
            };
            *count += 1;
            cells.push(format!("{word}, {:.1} s", back.as_secs_f64()));
        }
        eprintln!("matrix | {name} | {}", cells.join(" | "));
    }
    times.sort_unstable();
    eprintln!(
        "figure | fault matrix: {} faults in {} states | {right} shots right, {told} refused in words, {unseen} times no shot to be hit, {watchdog} left to the watchdog, 0 forbidden; from the end of a fault to the next right shot, where drivers keep their patience, {:.1} s in 95 of 100 and {:.1} s at most",
        faults,
        STATES.len(),
        times[times.len() * 95 / 100].as_secs_f64(),
        times[times.len() - 1].as_secs_f64(),
    );
    assert!(faults >= 52);
    // Faults that nothing notices would prove nothing.
    assert!(told > faults, "{told}");
}
