//! Months of shots in which cameras are pulled out, disks fill up, clocks are set and the daemon is
//! reloaded and started again; and a camera that is pulled out ten thousand times.

use super::{
    Piece, Stage, alone,
    camera::{Camera, Strings},
    disk::Filling,
    time::World,
};
use crate::{
    api::FaultKind,
    config::Config,
    store::{Condition, check},
};
use drivers::{
    Device, DeviceInfo, DriverError, Rig, Settings, Stream,
    chance::Chance,
    flaky::{Faults, Flaky},
};
use std::{
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering::SeqCst},
    },
    time::Duration,
};

/// How many shots are kept.
const KEPT: usize = 20;
const DAY: Duration = Duration::from_secs(86_400);

/// A camera on strings whose frames are lost, late, doubled, exchanged and mislabelled by another
/// schedule in every session.
struct Worn {
    camera: Camera,
    sessions: Arc<AtomicU64>,
    flaky: Flaky,
}

impl Worn {
    fn new(camera: Camera, sessions: &Arc<AtomicU64>) -> Self {
        let sessions = Arc::clone(sessions);
        let flaky = Self::session(&camera, &sessions);
        Self {
            camera,
            sessions,
            flaky,
        }
    }

    fn session(camera: &Camera, sessions: &AtomicU64) -> Flaky {
        let seed = sessions.fetch_add(1, SeqCst);
        let faults = Faults {
            seed,
            drop: 0.03,
            delay: 0.02,
            duplicate: 0.03,
            swap: 0.03,
            mislabel: 0.01,
            latency: 0,
            jitter: 0.001,
            timeout: 0.02,
            unplug: if seed % 97 == 96 { 3 } else { 0 },
        };
        Flaky::new(Box::new(camera.clone()), faults)
    }
}

impl Device for Worn {
    fn info(&self) -> DeviceInfo {
        self.flaky.info()
    }

    fn rig(&self) -> Rig {
        self.flaky.rig()
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        self.flaky = Self::session(&self.camera, &self.sessions);
        self.flaky.start(settings)
    }
}

/// Numbers by which the world goes on.
struct Dice(Chance, u64);

impl Dice {
    fn unit(&mut self) -> f64 {
        self.1 += 1;
        self.0.unit(self.1)
    }

    fn happens(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    fn time(&mut self, most: Duration) -> Duration {
        most.mul_f64(self.unit())
    }
}

/// What the process holds.
#[derive(Debug, Clone, Copy)]
struct Held {
    kibibytes: u64,
    files: usize,
    threads: u64,
}

impl Held {
    fn now() -> Self {
        // A thread that was told to end may need a moment to.
        std::thread::sleep(Duration::from_millis(200));
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let number = |name: &str| -> u64 {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            let digits = line.unwrap().trim().trim_end_matches(" kB");
            digits.parse().unwrap()
        };
        Self {
            kibibytes: number("VmRSS:"),
            files: std::fs::read_dir("/proc/self/fd").unwrap().count(),
            threads: number("Threads:"),
        }
    }

    /// More memory than before, MiB; files and threads are as many.
    fn growth(before: Self) -> f64 {
        let now = Self::now();
        assert_eq!(
            (now.files, now.threads),
            (before.files, before.threads),
            "files and threads, now and before"
        );
        (now.kibibytes as f64 - before.kibibytes as f64) / 1024.0
    }
}

fn stage(folder: &Path) -> Stage {
    let cameras = vec![Strings::new(&[])];
    let world = World::new();
    let (time, strings) = (Arc::clone(&world.time), Arc::clone(&cameras[0]));
    let sessions = Arc::default();
    let open = Arc::new(move |_: &str, _: Option<&Path>| {
        let camera = Camera::open(0, &strings, &time)?;
        Ok(Box::new(Worn::new(camera, &sessions)) as Box<dyn Device>)
    });
    Stage::new(folder, cameras, configured(3), world, open)
}

/// The configuration as its file would say it.
fn configured(flash_every: u32) -> Config {
    let text = format!("[capture]\nflash_every = {flash_every}\n[shots]\nkeep_newest = {KEPT}\n");
    Config::parse(&text, Path::new("captured.toml")).unwrap()
}

/// Takes shots until so many were asked for, while everything happens that can.
pub(super) fn soak(folder: &Path, shots: usize) {
    let mut stage = stage(folder);
    let mut dice = Dice(Chance::new(6), 0);
    let (mut right, mut refused, mut unroomy, mut pulled, mut reloads, mut starts) =
        (0, 0, 0, 0, 0, 0);
    let mut kept: Vec<String> = Vec::new();
    let mut before = None;
    let camera = Arc::clone(&stage.cameras[0]);
    let began = stage.world.time.nanos();
    for number in 0..shots {
        let most = match dice.unit() {
            u if u < 0.7 => Duration::from_secs(20),
            u if u < 0.995 => Duration::from_secs(400),
            _ => DAY,
        };
        stage.run(dice.time(most));
        if dice.happens(0.02) {
            let handle = stage.daemon().devices.number(0).unwrap();
            let looking = handle.previews.look();
            stage.run(dice.time(Duration::from_secs(2)));
            drop(looking);
        }
        if dice.happens(0.005) {
            reloads += 1;
            let good = configured(2 + number as u32 % 3);
            let devices = stage.config.borrow().devices.clone();
            stage
                .config
                .send_replace(Arc::new(Config { devices, ..good }));
        }
        if dice.happens(0.01) {
            let days = (dice.unit() * 2000.0) as i64 - 1000;
            stage.world.time.set_date(days * 86_400_000_000_000);
        }
        if dice.happens(0.01) {
            camera
                .clock_ahead
                .store((dice.unit() * 6e13) as i64 - 30_000_000_000_000, SeqCst);
        }
        if dice.happens(0.0005) {
            starts += 1;
            stage.restart();
        }
        let (full, cut) = (dice.happens(0.004), dice.happens(0.004));
        if full {
            stage.disk.leave(0, 0);
        } else if cut {
            stage
                .disk
                .leave((dice.unit() * 6000.0) as u64, Filling::ROOMY);
        }
        let pull = dice.happens(0.01);
        if pull {
            pulled += 1;
            camera.pull();
        }
        let flashes = camera.flashes.load(SeqCst);
        let mut asked = stage.ask(0);
        if dice.happens(0.01) {
            // Somebody sets the camera's clock in the middle of a shot.
            stage.run(dice.time(Duration::from_millis(100)));
            camera.clock_ahead.fetch_add(3_600_000_000_000, SeqCst);
        }
        let told = stage.wait(&mut asked, Duration::from_secs(30));
        match told.unwrap_or_else(|| panic!("shot {number}: no answer")) {
            Ok(id) => {
                assert!(!full, "a shot was kept where there is no room");
                assert!(
                    kept.last().is_none_or(|last| later(&id, last)),
                    "{id} after {kept:?}"
                );
                right += 1;
                kept.push(id);
            }
            Err(fault) => {
                refused += 1;
                assert!(!fault.message.is_empty());
                if full {
                    assert_eq!(fault.kind, FaultKind::Output);
                    assert_eq!(
                        camera.flashes.load(SeqCst),
                        flashes,
                        "the flash fired for nothing"
                    );
                }
                unroomy += u32::from(fault.kind == FaultKind::Output);
            }
        }
        stage.disk.leave(Filling::ROOMY, Filling::ROOMY);
        if pull {
            stage.run(dice.time(Duration::from_secs(20)));
            camera.put_back();
        }
        kept.drain(..kept.len().saturating_sub(KEPT));
        let mut found = stage.daemon().store.ids().unwrap();
        found.reverse();
        assert_eq!(found, kept, "acknowledged and not deleted");
        if number == shots / 10 {
            before = Some(Held::now());
        }
    }
    let more = Held::growth(before.unwrap());
    let used = stage.daemon().store.used_bytes();
    let lying: u64 = walk(folder);
    assert_eq!(
        used, lying,
        "bytes that the store counts, and those that are there"
    );
    let found = check(stage.daemon().store.disk(), folder).unwrap();
    assert!(
        found.iter().all(|one| one.condition == Condition::Whole),
        "{found:?}"
    );
    let days = (stage.world.time.nanos() - began) as f64 / 86_400e9;
    eprintln!(
        "figure | soak: {shots} shots in {days:.0} days of virtual time | {right} right, {refused} refused in words ({unroomy} for want of room), 0 lost, 0 of wrong frames; {pulled} times unplugged, {reloads} reloads, {starts} starts; {more:+.1} MiB, files and threads +0"
    );
    // What is refused has its reason in what was done to the camera and the disk.
    assert!(right > shots * 9 / 10, "{right} of {shots}");
    assert!(more < 4.0, "{more} MiB more");
}

fn later(id: &str, than: &str) -> bool {
    let number = |id: &str| id.trim_start_matches("shot-").parse::<u64>().unwrap();
    number(id) > number(than)
}

/// Bytes of all files in the folders of a folder.
fn walk(folder: &Path) -> u64 {
    let mut sum = 0;
    for shot in std::fs::read_dir(folder).unwrap() {
        for file in std::fs::read_dir(shot.unwrap().path()).unwrap() {
            sum += file.unwrap().metadata().unwrap().len();
        }
    }
    sum
}

/// Pulls the camera out and puts it back so many times; a shot fails, and one is right again.
pub(super) fn reconnect(folder: &Path, cycles: usize) {
    let mut stage = stage(folder);
    let camera = Arc::clone(&stage.cameras[0]);
    let mut before = None;
    let mut slowest = 0;
    for cycle in 0..cycles {
        camera.pull();
        let mut asked = stage.ask(0);
        let told = stage.wait(&mut asked, Duration::from_secs(30));
        assert!(told.expect("an answer").is_err());
        stage.run(Duration::from_millis(37 * (cycle as u64 % 50)));
        camera.put_back();
        let back = stage.world.time.nanos();
        loop {
            let mut asked = stage.ask(0);
            let told = stage.wait(&mut asked, Duration::from_secs(30));
            let took = stage.world.time.nanos() - back;
            match told.expect("an answer") {
                Ok(_) => break,
                Err(fault) => assert!(took < 60_000_000_000, "cycle {cycle}: {fault:?}"),
            }
        }
        slowest = slowest.max(stage.world.time.nanos() - back);
        if cycle == cycles / 10 {
            before = Some(Held::now());
        }
    }
    let more = Held::growth(before.unwrap());
    let each = more * 1000.0 / (cycles as f64 * 0.9);
    eprintln!(
        "figure | a camera unplugged and put back {cycles} times, virtual time | a right shot again within {:.1} s; {each:+.2} MiB each 1000, files and threads +0",
        slowest as f64 / 1e9
    );
    assert!(each < 1.0 || more < 2.0, "{each} MiB each 1000");
}

#[test]
fn a_thousand_shots_among_faults_are_right_or_refused_in_words_and_nothing_grows() {
    alone(Piece::Soak, 1000);
}

#[test]
#[ignore = "the long form"]
fn a_hundred_thousand_shots_in_months_are_right_or_refused_in_words_and_nothing_grows() {
    alone(Piece::Soak, 100_000);
}

#[test]
fn a_camera_pulled_out_three_hundred_times_is_back_each_time_and_nothing_grows() {
    alone(Piece::Reconnect, 300);
}

#[test]
#[ignore = "the long form"]
fn a_camera_pulled_out_ten_thousand_times_is_back_each_time_and_nothing_grows() {
    alone(Piece::Reconnect, 10_000);
}
