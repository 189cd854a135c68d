//! The bridge's process: started, spoken to, and gone when its owner is.

use super::message::{LONGEST, Order, Report};
use crate::device::DriverError;
use std::{
    ffi::OsStr,
    fs::File,
    io::{ErrorKind, Read, Write},
    os::{fd::OwnedFd, unix::fs::FileExt, unix::net::UnixStream},
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// The vendor's side.
const SCRIPT: &str = include_str!("bridge.py");
/// How long the process may take to end by itself; longer than the library needs to let go.
const GRACE: Duration = Duration::from_secs(2);

/// Memory that a bridge writes frames into; empty.
pub(super) fn shared_memory() -> std::io::Result<File> {
    let memory = rustix::fs::memfd_create("captured-depthai", rustix::fs::MemfdFlags::CLOEXEC)?;
    Ok(File::from(memory))
}

/// A running bridge.
pub(super) struct Bridge {
    device: String,
    /// `None` where only its words were kept.
    process: Option<Child>,
    line: UnixStream,
    memory: File,
    /// What came of a message that is not whole yet.
    heard: Vec<u8>,
}

impl Bridge {
    /// Starts it under the Python at `python`.
    pub fn start(device: &str, python: &OsStr) -> Result<Self, DriverError> {
        Self::run(device, Command::new(python).arg("-c").arg(SCRIPT))
    }

    /// Starts any program that speaks as the bridge does.
    pub(super) fn run(device: &str, command: &mut Command) -> Result<Self, DriverError> {
        let program = PathBuf::from(command.get_program());
        let failed = |source| DriverError::Io {
            path: program.clone(),
            source,
        };
        let (line, theirs) = UnixStream::pair().map_err(failed)?;
        let memory = shared_memory().map_err(failed)?;
        let shared = memory.try_clone().map_err(failed)?;
        let process = command
            .stdin(OwnedFd::from(theirs))
            .stdout(OwnedFd::from(shared))
            .spawn()
            .map_err(failed)?;
        // The command would hold their end of the line open, and its end would never be heard.
        command.stdin(Stdio::null()).stdout(Stdio::null());
        Ok(Self::new(device, Some(process), line, memory))
    }

    /// One whose process, if any, speaks at the other end of `line` and writes into `memory`.
    pub(super) fn new(
        device: &str,
        process: Option<Child>,
        line: UnixStream,
        memory: File,
    ) -> Self {
        Self {
            device: device.to_owned(),
            process,
            line,
            memory,
            heard: Vec::new(),
        }
    }

    /// Its process.
    #[cfg(test)]
    pub fn id(&self) -> Option<u32> {
        self.process.as_ref().map(Child::id)
    }

    /// Says something to the bridge.
    pub fn say(&mut self, order: &Order<'_>) -> Result<(), DriverError> {
        let body = serde_json::to_vec(order).map_err(|error| self.nonsense(error.to_string()))?;
        let mut message = (body.len() as u32).to_le_bytes().to_vec();
        message.extend(body);
        self.line
            .write_all(&message)
            .map_err(|_| self.gone("its bridge ended"))
    }

    /// Waits for the bridge to say something.
    ///
    /// # Errors
    /// [`DriverError::Timeout`] when it is silent for `patience`, and may be asked again;
    /// [`DriverError::Unplugged`] when it ended, [`DriverError::Malformed`] for what is no message.
    pub fn hear(&mut self, patience: Duration) -> Result<Report, DriverError> {
        let asked = Instant::now();
        loop {
            if let Some(report) = self.whole_message()? {
                return Ok(report);
            }
            let left = patience.saturating_sub(asked.elapsed());
            // Zero would mean for ever.
            let left = left.max(Duration::from_micros(1));
            self.line
                .set_read_timeout(Some(left))
                .map_err(|_| self.gone("its bridge cannot be read"))?;
            let mut part = [0; 4096];
            match self.line.read(&mut part) {
                Ok(0) => return Err(self.gone("its bridge ended; see the log above")),
                Ok(count) => self.heard.extend_from_slice(&part[..count]),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error)
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
                {
                    if asked.elapsed() >= patience {
                        return Err(DriverError::Timeout {
                            device: self.device.clone(),
                            patience,
                        });
                    }
                }
                Err(_) => return Err(self.gone("its bridge cannot be read")),
            }
        }
    }

    fn whole_message(&mut self) -> Result<Option<Report>, DriverError> {
        let Some(head) = self.heard.first_chunk::<4>() else {
            return Ok(None);
        };
        let length = u32::from_le_bytes(*head) as usize;
        if length > LONGEST {
            return Err(self.nonsense(format!("a message of {length} bytes; {LONGEST} at most")));
        }
        if self.heard.len() < 4 + length {
            return Ok(None);
        }
        let body: Vec<u8> = self.heard.drain(..4 + length).skip(4).collect();
        serde_json::from_slice(&body)
            .map(Some)
            .map_err(|error| self.nonsense(error.to_string()))
    }

    /// Copies a slot's bytes out of the shared memory. The bridge may have shortened it: what is read is
    /// then an error and no fault of memory, as it would be through a mapping.
    pub fn copy(&self, offset: usize, bytes: &mut [u8]) -> Result<(), DriverError> {
        self.memory
            .read_exact_at(bytes, offset as u64)
            .map_err(|error| self.nonsense(format!("{} bytes at {offset}: {error}", bytes.len())))
    }

    pub fn gone(&self, why: &str) -> DriverError {
        DriverError::Unplugged {
            device: format!("{} ({why})", self.device),
        }
    }

    pub fn nonsense(&self, problem: String) -> DriverError {
        DriverError::Malformed {
            path: PathBuf::from(&self.device),
            problem: format!("its bridge: {problem}"),
            remedy: "install the depthai package named in the README, or report this as a bug",
        }
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        // The end of the line tells the bridge to put the strobe out and to go.
        drop(self.line.shutdown(std::net::Shutdown::Both));
        let Some(process) = &mut self.process else {
            return;
        };
        let asked = Instant::now();
        while asked.elapsed() < GRACE {
            if !matches!(process.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        drop(process.kill());
        drop(process.wait());
    }
}
