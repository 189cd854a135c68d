//! A process killed with SIGKILL at every call of the file system, on the real one; recovery too.

use crate::scenario::{self, Acknowledged};
use captured::output::{Disk, FileSystem, NewFile};
use std::{
    io::{self, BufRead, BufReader, Read, Write},
    os::unix::process::ExitStatusExt as _,
    path::Path,
    process::{Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

/// Which call the child dies at; without it the child test has nothing to do.
const DIE_AT: &str = "CAPTURED_DIE_AT";
const FOLDER: &str = "CAPTURED_DIE_IN";
const REACHED: &str = "the point is reached";

/// The real disk under a process that is killed before a call, in the middle of a write, or right after
/// a call.
struct Dying {
    left: AtomicUsize,
}

/// Says that the point is reached and does nothing more, until whoever started this process kills it.
fn die() -> ! {
    let words = format!("{REACHED}\n");
    io::stdout().write_all(words.as_bytes()).unwrap();
    loop {
        std::thread::park();
    }
}

impl Dying {
    /// True when the next thing to happen is the end.
    fn over(&self) -> bool {
        self.left.fetch_sub(1, Ordering::Relaxed) == 1
    }

    fn around<T>(&self, call: impl FnOnce() -> T) -> T {
        if self.over() {
            die();
        }
        let done = call();
        if self.over() {
            die();
        }
        done
    }
}

struct Writing<'a>(&'a Dying, Box<dyn NewFile + 'a>);

impl Write for Writing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.0.over() {
            drop(self.1.write(&bytes[..bytes.len() / 2]));
            die();
        }
        self.1.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.1.flush()
    }
}

impl NewFile for Writing<'_> {
    fn sync(&mut self) -> io::Result<()> {
        self.0.around(|| self.1.sync())
    }
}

impl FileSystem for Dying {
    fn create_dir(&self, dir: &Path) -> io::Result<()> {
        self.around(|| Disk.create_dir(dir))
    }
    fn create_file<'a>(&'a self, file: &Path) -> io::Result<Box<dyn NewFile + 'a>> {
        let made = self.around(|| Disk.create_file(file))?;
        Ok(Box::new(Writing(self, made)))
    }
    fn open<'a>(&'a self, file: &Path) -> io::Result<(u64, Box<dyn Read + 'a>)> {
        Disk.open(file)
    }
    fn sync_file(&self, file: &Path) -> io::Result<()> {
        self.around(|| Disk.sync_file(file))
    }
    fn sync_dir(&self, dir: &Path) -> io::Result<()> {
        self.around(|| Disk.sync_dir(dir))
    }
    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.around(|| Disk.rename_new(from, to))
    }
    fn rename_over_empty(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.around(|| Disk.rename_over_empty(from, to))
    }
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        self.around(|| Disk.exchange(one, other))
    }
    fn remove(&self, dir: &Path) -> io::Result<()> {
        for name in Disk.list(dir)?.unwrap_or_default() {
            self.remove_file(&dir.join(name))?;
        }
        self.around(|| std::fs::remove_dir(dir))
    }
    fn remove_file(&self, file: &Path) -> io::Result<()> {
        self.around(|| Disk.remove_file(file))
    }
    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>> {
        Disk.list(dir)
    }
    fn free_bytes(&self, dir: &Path) -> io::Result<u64> {
        Disk.free_bytes(dir)
    }
}

/// Not a test by itself: what the killed process does.
#[test]
#[ignore = "run by the others, as a process of its own"]
fn child() {
    let Ok(at) = std::env::var(DIE_AT) else {
        return;
    };
    let folder = std::env::var(FOLDER).unwrap();
    let disk: Arc<dyn FileSystem> = Arc::new(Dying {
        left: AtomicUsize::new(at.parse().unwrap()),
    });
    let mut said = std::fs::File::options()
        .append(true)
        .create(true)
        .open(Path::new(&folder).join("said"))
        .unwrap();
    scenario::run(&disk, &Path::new(&folder).join("shots"), &mut |words| {
        said.write_all(format!("{words}\n").as_bytes()).unwrap();
    });
}

/// Runs a process and kills it at the given point; false when it ended by itself.
fn killed(folder: &Path, at: usize) -> bool {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args([
            "kill::child",
            "--exact",
            "--ignored",
            "--quiet",
            "--nocapture",
        ])
        .env(DIE_AT, at.to_string())
        .env(FOLDER, folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let said = BufReader::new(child.stdout.take().unwrap());
    let reached = said
        .lines()
        .map_while(Result::ok)
        .any(|line| line.ends_with(REACHED));
    if reached {
        child.kill().unwrap();
    }
    let status = child.wait().unwrap();
    assert_eq!(status.signal() == Some(9), reached);
    assert!(reached || status.success(), "the child failed: {status}");
    reached
}

/// Kills at every `stride`-th point, once and again while the next process recovers and goes on.
fn sweep(stride: usize, rounds: usize) -> usize {
    let mut points = 0;
    for round in 0..rounds {
        for at in (1 + round % stride..).step_by(stride) {
            let folder = tempfile::tempdir().unwrap();
            std::fs::create_dir(folder.path().join("shots")).unwrap();
            let first = killed(folder.path(), at);
            // What comes after it dies too, at a point that wanders.
            for again in 0..2 {
                points += usize::from(killed(
                    folder.path(),
                    1 + (at * 7 + again * 13 + round) % 40,
                ));
            }
            let mut told = Acknowledged::default();
            let said = std::fs::read_to_string(folder.path().join("said")).unwrap_or_default();
            said.lines().for_each(|line| told.hear(line));
            let disk: Arc<dyn FileSystem> = Arc::new(Disk);
            if let Err(violation) = scenario::violations(&disk, &folder.path().join("shots"), &told)
            {
                panic!("killed at {at}: {violation}");
            }
            if !first {
                break;
            }
            points += 1;
        }
    }
    points
}

#[test]
fn a_process_killed_at_any_call_loses_no_shot_it_acknowledged() {
    let points = sweep(3, 1);
    eprintln!("figure | kill -9 at every third call, recovery too | {points} points, 0 violations");
    assert!(points > 60, "{points} points");
}

#[test]
#[ignore = "the long form"]
fn ten_thousand_kills_lose_no_shot() {
    let points = sweep(1, 36);
    eprintln!(
        "figure | kill -9 at every call, recovery too (long) | {points} points, 0 violations"
    );
    assert!(points >= 10_000, "{points} points");
}
