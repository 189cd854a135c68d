//! What puts a lamp out that neither hardware nor kernel do, when this process cannot any more: a process
//! of its own that listens to it, and makes the lamp dark when it falls silent, whatever ended it.

use crate::{
    device::DriverError,
    frame::Timestamp,
    lamp::{Lamp, Lit, Moment, Reach},
};
use std::{
    io::{self, Write},
    os::fd::{AsRawFd, RawFd},
    time::Duration,
};
use v4l::{sys::v4l2_control, v4l2::vidioc::VIDIOC_S_CTRL};

/// How a lamp is made dark through a file that is open: one request, which takes no memory.
#[derive(Debug, Clone, Copy)]
pub(super) enum Darkness {
    /// `0` written to a file of sysfs.
    Written(RawFd),
    /// A V4L2 control set to a value.
    Control { node: RawFd, id: u32, value: i32 },
    /// The only line of a GPIO request set inactive.
    Line(RawFd),
}

/// `GPIO_V2_LINE_SET_VALUES_IOCTL` and its argument (`linux/gpio.h`): one bit for each line of a request.
const SET_LINES: u32 = 0xc010_b40f;

#[repr(C)]
struct LineValues {
    bits: u64,
    mask: u64,
}

/// How much longer than the longest flash the guard waits before it acts by itself: the thread that
/// bounds the lamp comes first.
const GRACE: Duration = Duration::from_millis(50);
/// How often a lamp that refuses to go dark is told again, milliseconds, and how often at most when
/// nobody is left.
const INSIST_MS: i32 = 20;
const MOST_INSISTENCE: usize = 250;
/// Longest wait for the guard to leave after its lamp.
const LEAVING: Duration = Duration::from_millis(200);

impl Darkness {
    fn file(self) -> RawFd {
        match self {
            Self::Written(file) | Self::Control { node: file, .. } | Self::Line(file) => file,
        }
    }

    /// Makes the lamp dark; true where that is done, or the lamp is gone.
    fn bring(self) -> bool {
        let done = match self {
            Self::Written(file) => {
                // SAFETY: the file is open, and the text is one byte long.
                unsafe { libc::pwrite(file, c"0".as_ptr().cast(), 1, 0) == 1 }
            }
            Self::Control { node, id, value } => {
                let mut control = v4l2_control { id, value };
                // SAFETY: the node is open, and the request's argument is a `v4l2_control`.
                unsafe { libc::ioctl(node, VIDIOC_S_CTRL as _, &raw mut control) == 0 }
            }
            Self::Line(file) => {
                let mut values = LineValues { bits: 0, mask: 1 };
                // SAFETY: the file is a line request, and the argument is the one of its request.
                unsafe { libc::ioctl(file, SET_LINES as _, &raw mut values) == 0 }
            }
        };
        done || io::Error::last_os_error().raw_os_error() == Some(libc::ENODEV)
    }
}

/// A lamp with its guard. The guard ends with this value.
pub(super) struct Guarded {
    // Goes dark by itself before its guard hears that nobody is left.
    lamp: Box<dyn Lamp>,
    guard: Guard,
}

impl Guarded {
    /// Sets a guard over a lamp that stays lit for `longest` at most.
    pub fn new(
        lamp: Box<dyn Lamp>,
        darkness: Darkness,
        longest: Duration,
    ) -> Result<Self, DriverError> {
        let guard = Guard::new(darkness, longest + GRACE).map_err(failed)?;
        Ok(Self { lamp, guard })
    }
}

impl Lamp for Guarded {
    fn reach(&self) -> Reach {
        self.lamp.reach()
    }

    fn ready_at(&self, flash: Duration) -> Timestamp {
        self.lamp.ready_at(flash)
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        self.guard.say(LIT).map_err(failed)?;
        self.lamp.fire(flash)
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        let out = self.lamp.put_out()?;
        self.guard.say(DARK).map_err(failed)?;
        Ok(out)
    }
}

fn failed(error: io::Error) -> DriverError {
    DriverError::Hardware {
        device: "flash".into(),
        problem: format!("no process can watch over the lamp: {error}"),
        remedy: "raise the limit of processes for this service",
    }
}

/// What is said to the guard.
const LIT: u8 = 1;
const DARK: u8 = 0;

struct Guard {
    /// `None` only while being dropped.
    mouth: Option<io::PipeWriter>,
    child: libc::pid_t,
}

impl Guard {
    fn new(darkness: Darkness, bound: Duration) -> io::Result<Self> {
        let (ear, mouth) = io::pipe()?;
        let milliseconds = i32::try_from(bound.as_millis()).unwrap_or(i32::MAX);
        // SAFETY: the child calls nothing but what is safe after a fork in a process of many threads
        // (`watch`), and never returns.
        match unsafe { libc::fork() } {
            -1 => Err(io::Error::last_os_error()),
            0 => watch(ear.as_raw_fd(), darkness, milliseconds),
            child => Ok(Self {
                mouth: Some(mouth),
                child,
            }),
        }
    }

    fn say(&mut self, word: u8) -> io::Result<()> {
        match &mut self.mouth {
            Some(mouth) => mouth.write_all(&[word]),
            None => Ok(()),
        }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.mouth = None;
        let deadline = Timestamp::now().after(LEAVING);
        // SAFETY: waits for our own child, whose status nobody asks for.
        while unsafe { libc::waitpid(self.child, std::ptr::null_mut(), libc::WNOHANG) } == 0
            && Timestamp::now() < deadline
        {
            std::thread::sleep(Duration::from_micros(200));
        }
    }
}

/// The guard's whole life. It shares memory with nobody, hears no signal but SIGKILL, and holds no file but
/// the lamp's and `ear`: above all no other guard's pipe, which would never fall silent then.
fn watch(ear: RawFd, darkness: Darkness, bound_ms: i32) -> ! {
    // SAFETY: the set is filled before it is used.
    unsafe {
        let mut all = std::mem::zeroed();
        libc::sigfillset(&raw mut all);
        libc::sigprocmask(libc::SIG_BLOCK, &raw const all, std::ptr::null_mut());
        libc::prctl(libc::PR_SET_NAME, c"lamp guard".as_ptr());
    }
    close_all_but(ear, darkness.file());
    let mut patience = -1;
    loop {
        let mut heard = libc::pollfd {
            fd: ear,
            events: libc::POLLIN,
            revents: 0,
        };
        // SAFETY: one descriptor.
        let ready = unsafe { libc::poll(&raw mut heard, 1, patience) };
        if ready == 0 {
            patience = if darkness.bring() { -1 } else { INSIST_MS };
            continue;
        }
        let mut word = DARK;
        // SAFETY: one byte is read into one byte.
        let read = unsafe { libc::read(ear, (&raw mut word).cast(), 1) };
        if ready < 0 || read != 1 {
            break;
        }
        patience = if word == LIT { bound_ms } else { -1 };
    }
    for _ in 0..MOST_INSISTENCE {
        if darkness.bring() {
            break;
        }
        // SAFETY: no descriptor: a pause.
        unsafe { libc::poll(std::ptr::null_mut(), 0, INSIST_MS) };
    }
    // SAFETY: ends the process and nothing of its parent's.
    unsafe { libc::_exit(0) }
}

fn close_all_but(one: RawFd, other: RawFd) {
    let (low, high) = (one.min(other), one.max(other));
    for (first, last) in [(0, low - 1), (low + 1, high - 1), (high + 1, RawFd::MAX)] {
        if first > last {
            continue;
        }
        // SAFETY: closes files that this process does not use any more.
        let closed = unsafe { libc::syscall(libc::SYS_close_range, first, last, 0) };
        if closed != 0 {
            // A kernel before 5.9, or a filter of calls.
            for file in first..=last.min(MOST_FILES) {
                // SAFETY: as above.
                unsafe { libc::close(file) };
            }
        }
    }
}

/// Files that are closed one by one where the kernel cannot close a range.
const MOST_FILES: RawFd = 65_536;

#[cfg(test)]
mod tests {
    use super::*;
    use std::{fs, io::Read, os::fd::AsFd, process, thread::sleep, time::Instant};

    fn lit_file(folder: &std::path::Path) -> fs::File {
        let path = folder.join("brightness");
        fs::write(&path, "5").unwrap();
        fs::File::options().write(true).open(path).unwrap()
    }

    fn is_lit(folder: &std::path::Path) -> bool {
        fs::read_to_string(folder.join("brightness")).unwrap() != "0"
    }

    fn dark_after(folder: &std::path::Path) -> Duration {
        let since = Instant::now();
        while is_lit(folder) {
            assert!(since.elapsed() < Duration::from_secs(10), "left lit");
            sleep(Duration::from_millis(1));
        }
        since.elapsed()
    }

    #[test]
    fn a_lamp_whose_owner_falls_silent_goes_dark_at_its_bound() {
        let folder = tempfile::tempdir().unwrap();
        let file = lit_file(folder.path());
        let darkness = Darkness::Written(file.as_fd().as_raw_fd());
        let mut guard = Guard::new(darkness, Duration::from_millis(60)).unwrap();
        sleep(Duration::from_millis(100));
        assert!(is_lit(folder.path()), "nobody said that it burns");
        guard.say(LIT).unwrap();
        // Nothing more is said: a process that is stopped, or hangs.
        let took = dark_after(folder.path());
        assert!(took >= Duration::from_millis(50), "{took:?}");
        fs::write(folder.path().join("brightness"), "5").unwrap();
        guard.say(LIT).unwrap();
        guard.say(DARK).unwrap();
        sleep(Duration::from_millis(100));
        assert!(is_lit(folder.path()), "the bound ended with the flash");
        drop(guard);
        assert!(!is_lit(folder.path()), "dark when its owner leaves");
    }

    #[test]
    fn no_guard_hears_another_ones_silence() {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let files = folders.each_ref().map(|folder| lit_file(folder.path()));
        let [first, second] = files.each_ref().map(|file| {
            let darkness = Darkness::Written(file.as_fd().as_raw_fd());
            Guard::new(darkness, Duration::from_secs(100)).unwrap()
        });
        // The second was made while the first's pipe was open.
        drop(first);
        assert!(!is_lit(folders[0].path()) && is_lit(folders[1].path()));
        drop(second);
        assert!(!is_lit(folders[1].path()));
    }

    /// Set in the process that is to be killed.
    const VICTIM: &str = "LAMP_VICTIM";

    #[test]
    fn a_killed_process_leaves_no_lamp_lit() {
        if let Some(folder) = std::env::var_os(VICTIM) {
            let file = lit_file(folder.as_ref());
            let darkness = Darkness::Written(file.as_raw_fd());
            let mut guard = Guard::new(darkness, Duration::from_secs(100)).unwrap();
            guard.say(LIT).unwrap();
            io::stdout().write_all(b"burning\n").unwrap();
            sleep(Duration::from_secs(100));
        }
        let folder = tempfile::tempdir().unwrap();
        let test = "flash::guard::tests::a_killed_process_leaves_no_lamp_lit";
        let mut victim = process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", test, "--nocapture"])
            .env(VICTIM, folder.path())
            .stdout(process::Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = victim.stdout.take().unwrap();
        let mut text = String::new();
        while !text.contains("burning") {
            let mut byte = [0];
            assert_eq!(said.read(&mut byte).unwrap(), 1, "ended early: {text}");
            text.push(char::from(byte[0]));
        }
        assert!(is_lit(folder.path()));
        victim.kill().unwrap();
        victim.wait().unwrap();
        dark_after(folder.path());
    }
}
