//! The daemon in a world of its own, in which months pass in minutes and everything goes wrong that can.
//!
//! What takes, pairs, queues, develops and keeps shots is the daemon's own code on its own threads. Only
//! the clock, the cameras and the room on the disk are staged, so that each rehearsal is the same.
//!
//! Each runs in a process of its own, so that its memory and files can be counted.

mod camera;
mod disk;
mod faults;
mod matrix;
mod soak;
mod time;

use super::{State, Waiting, access::Caller, networks::Networks, shooting, worker};
use crate::{
    api::{Fault, Phase, ShotRequest},
    config::Config,
    store::Store,
};
use camera::Strings;
use disk::Filling;
use std::{
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{Arc, atomic::Ordering::SeqCst},
    time::Duration,
};
use time::World;
use tokio::sync::{oneshot, watch};

/// Which rehearsal, and how long, for the process that runs it.
const PIECE: &str = "CAPTURED_REHEARSAL";
const LENGTH: &str = "CAPTURED_REHEARSAL_LENGTH";

/// What can be rehearsed.
#[derive(Debug, Clone, Copy)]
enum Piece {
    Matrix,
    Soak,
    Reconnect,
}

/// Not a test by itself: the process that the others start and count.
#[test]
#[ignore = "run by the others, as a process of its own"]
fn child() {
    let (Ok(piece), Ok(length)) = (std::env::var(PIECE), std::env::var(LENGTH)) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (folder, length) = (folder.path(), length.parse().unwrap());
    match piece.as_str() {
        "Matrix" => matrix::matrix(folder, length),
        "Soak" => soak::soak(folder, length),
        _ => soak::reconnect(folder, length),
    }
}

/// Runs a piece in a process of its own.
fn alone(piece: Piece, length: usize) {
    // Months of shots would wear out a disk; memory will do.
    let memory = Path::new("/dev/shm");
    let folder = match memory.is_dir() {
        true => memory.to_owned(),
        false => std::env::temp_dir(),
    };
    let status = Command::new(std::env::current_exe().unwrap())
        .args([
            "daemon::rehearsal::child",
            "--exact",
            "--ignored",
            "--nocapture",
        ])
        .env(PIECE, format!("{piece:?}"))
        .env(LENGTH, length.to_string())
        .env("TMPDIR", folder)
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(status.success());
}

/// How finely the rehearsal looks.
const STEP: Duration = Duration::from_millis(50);

/// A shot that was asked for.
struct Asked {
    camera: usize,
    /// When, nanoseconds.
    at: u64,
    answer: Result<shooting::Underway, Fault>,
}

/// The daemon and its world.
struct Stage {
    world: World,
    runtime: tokio::runtime::Runtime,
    config: watch::Sender<Arc<Config>>,
    daemon: Option<(Arc<State>, Waiting)>,
    networks: Networks,
    cameras: Vec<Arc<Strings>>,
    open: worker::Open,
    disk: Arc<Filling>,
    folder: PathBuf,
    /// While true, shots that were taken wait for the darkroom.
    holds_commits: bool,
}

impl Stage {
    /// Starts a daemon that keeps its shots in `folder` and opens its cameras by `open`.
    fn new(
        folder: &Path,
        cameras: Vec<Arc<Strings>>,
        config: Config,
        world: World,
        open: worker::Open,
    ) -> Self {
        let devices = (0..cameras.len()).map(|number| format!("staged:{number}"));
        let config = Config {
            devices: devices.collect(),
            ..config
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .build();
        let mut stage = Self {
            world,
            runtime: runtime.unwrap(),
            config: watch::Sender::new(Arc::new(config)),
            daemon: None,
            networks: Networks::default(),
            cameras,
            open,
            disk: Arc::new(Filling::new()),
            folder: folder.to_owned(),
            holds_commits: false,
        };
        stage.restart();
        stage
    }

    /// Ends the daemon, where there is one, and starts it again.
    fn restart(&mut self) {
        if let Some((daemon, waiting)) = self.daemon.take() {
            drop((daemon, waiting));
            self.pass();
            // Its threads see that nobody can ask any more.
            self.world.stir();
            self.world.run(Duration::from_secs(5));
        }
        let (store, _) = Store::on(self.disk.clone(), self.folder.clone()).unwrap();
        let _inside = self.runtime.enter();
        let config = self.config.subscribe();
        let time = self.world.time.clone();
        let started = State::start(config, store, None, time, &self.open).unwrap();
        self.daemon = Some(started);
        self.world.gather(self.cameras.len());
        self.run(Duration::from_millis(1));
    }

    fn daemon(&self) -> &Arc<State> {
        &self.daemon.as_ref().unwrap().0
    }

    /// Lets the daemon's tasks go on as far as they can.
    fn pass(&mut self) {
        self.runtime.block_on(async {
            for _ in 0..8 {
                tokio::task::yield_now().await;
            }
        });
    }

    /// Lets time pass, and has shots developed that were taken.
    fn run(&mut self, time: Duration) {
        self.pass();
        self.world.stir();
        self.world.run(time);
        self.pass();
        let (daemon, waiting) = self.daemon.as_ref().unwrap();
        if !self.holds_commits {
            while let Ok(commit) = waiting.commits.try_recv() {
                shooting::develop_one(daemon, &mut self.networks, commit);
            }
        }
        // The lamp beside the lens must never be off while it looks.
        for (number, camera) in self.cameras.iter().enumerate() {
            let said = daemon.devices.number(number).unwrap().status();
            assert!(
                said.in_use || !camera.streams.load(SeqCst),
                "camera {number} streams unsaid: {said:?}"
            );
        }
    }

    /// Asks for a shot.
    fn ask(&mut self, camera: usize) -> Asked {
        let request = ShotRequest {
            device: Some(format!("staged:{camera}")),
            ..ShotRequest::default()
        };
        let daemon = self.daemon.as_ref().unwrap().0.clone();
        let begun = shooting::begin(&daemon, Caller::Browser, request);
        let begun = self.runtime.block_on(begun);
        Asked {
            camera,
            at: self.world.time.nanos(),
            answer: begun,
        }
    }

    /// The answer, if it is there; a shot is judged by its pixels.
    fn answer(&self, asked: &mut Asked) -> Option<Result<String, Fault>> {
        let told = match &mut asked.answer {
            Err(fault) => Err(fault.clone()),
            Ok(underway) => match underway.done.try_recv() {
                Err(oneshot::error::TryRecvError::Empty) => return None,
                Err(oneshot::error::TryRecvError::Closed) => panic!("a shot without an answer"),
                Ok(told) => told,
            },
        };
        Some(told.map(|reply| {
            let kept = self.folder.join(&reply.id);
            if let Err(wrong) = camera::judge(&kept, asked.camera as u64) {
                panic!("{}, acknowledged, is no shot: {wrong}", reply.id);
            }
            reply.id
        }))
    }

    /// Waits for the answer; `None` when none came in so much time.
    fn wait(&mut self, asked: &mut Asked, most: Duration) -> Option<Result<String, Fault>> {
        let end = self.world.time.nanos() + time::nanos(most);
        loop {
            self.run(STEP);
            let answer = self.answer(asked);
            if answer.is_some() || self.world.time.nanos() >= end {
                return answer;
            }
        }
    }

    fn phase(&self, camera: usize) -> Phase {
        self.daemon().devices.number(camera).unwrap().status().phase
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        // The threads see it once their turns have ended with the world.
        self.daemon = None;
    }
}
