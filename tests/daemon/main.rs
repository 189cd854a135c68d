//! The daemon as its clients meet it: a process behind a Unix socket.

mod api;
mod hostile;
mod measured;
mod reliability;
mod requests;
mod shots;
mod web;

use std::{
    io::{Read, Write},
    os::unix::net::{UnixDatagram, UnixStream},
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// Longest wait for anything a daemon should do at once. Reached only by a broken one.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A program under test: as the tests were built, or, for measurements, of the folder that
/// `CAPTURED_PROGRAMS` names.
fn program(name: &str) -> PathBuf {
    match (std::env::var_os("CAPTURED_PROGRAMS"), name) {
        (Some(folder), _) => PathBuf::from(folder).join(name),
        (None, "captured") => env!("CARGO_BIN_EXE_captured").into(),
        (None, _) => env!("CARGO_BIN_EXE_capturectl").into(),
    }
}

/// A running daemon with folders of its own; stopped when dropped.
pub struct Daemon {
    /// Holds the socket, the state and whatever a test writes.
    pub folder: tempfile::TempDir,
    notifications: UnixDatagram,
    process: Child,
    devices: Vec<String>,
}

impl Daemon {
    /// Starts a daemon on `device` and waits until it says that it is ready.
    pub fn start(device: &str) -> Self {
        Self::start_with("", &[device])
    }

    /// Starts a daemon on devices, with a configuration file, and waits until it says that it is ready.
    pub fn start_with(config: &str, devices: &[&str]) -> Self {
        Self::start_among(config, devices, &[])
    }

    /// [`Self::start_with`] more of an environment.
    pub fn start_among(config: &str, devices: &[&str], environment: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("captured.toml"), config).unwrap();
        let notifications = UnixDatagram::bind(folder.path().join("notify")).unwrap();
        notifications.set_read_timeout(Some(PATIENCE)).unwrap();
        let devices: Vec<String> = devices.iter().map(|device| (*device).to_owned()).collect();
        let process = Self::spawn(&folder, &devices, environment);
        let daemon = Self {
            folder,
            notifications,
            process,
            devices,
        };
        assert_eq!(daemon.notification(), "READY=1");
        daemon
    }

    /// Starts it again in the same folders, once it has ended.
    pub fn restart(&mut self) {
        self.process = Self::spawn(&self.folder, &self.devices, &[]);
        while self.notification() != "READY=1" {}
    }

    fn spawn(
        folder: &tempfile::TempDir,
        devices: &[String],
        environment: &[(&str, &str)],
    ) -> Child {
        let log = std::fs::File::options()
            .append(true)
            .create(true)
            .open(folder.path().join("log"))
            .unwrap();
        Self::command(folder, devices)
            .envs(environment.iter().copied())
            .stderr(log)
            .spawn()
            .expect("captured is built")
    }

    fn command(folder: &tempfile::TempDir, devices: &[String]) -> Command {
        let mut command = Command::new(program("captured"));
        command.env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
        command
            .args(devices.iter().flat_map(|device| ["--device", device]))
            .args(["--config", "captured.toml"])
            .args(["--socket", "captured/captured.sock"])
            .args(["--state", "state"])
            .current_dir(folder.path())
            .env("NOTIFY_SOCKET", folder.path().join("notify"))
            .env("NO_COLOR", "1")
            .env_remove("RUNTIME_DIRECTORY")
            .env_remove("STATE_DIRECTORY")
            .env_remove("JOURNAL_STREAM");
        command
    }

    /// What it has said so far.
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).unwrap()
    }

    /// Memory that it holds.
    pub fn resident_bytes(&self) -> u64 {
        self.bytes_of("VmRSS:")
    }

    /// The most memory that it ever held.
    pub fn peak_bytes(&self) -> u64 {
        self.bytes_of("VmHWM:")
    }

    fn bytes_of(&self, name: &str) -> u64 {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let kibibytes = line.unwrap().trim().trim_end_matches(" kB").parse::<u64>();
        kibibytes.unwrap() << 10
    }

    /// What the daemon tells the service manager next, its signs of life left out.
    pub fn notification(&self) -> String {
        loop {
            let mut bytes = [0; 200];
            let length = self
                .notifications
                .recv(&mut bytes)
                .expect("the daemon notifies in time");
            let said = String::from_utf8_lossy(&bytes[..length]);
            if said.trim_end() != "WATCHDOG=1" {
                return said.trim_end().to_owned();
            }
        }
    }

    /// Tries to start a second daemon in the same folders; returns its exit code and message.
    pub fn start_another(&self) -> (Option<i32>, String) {
        let mut command = Self::command(&self.folder, &self.devices);
        let output = command.stderr(Stdio::piped()).output().unwrap();
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    }

    /// Where it listens.
    pub fn socket(&self) -> PathBuf {
        self.folder.path().join("captured/captured.sock")
    }

    /// Sends a signal by name.
    pub fn signal(&self, signal: &str) {
        let script = format!("kill -{signal} {}", self.process.id());
        let sent = Command::new("sh").args(["-c", &script]).status().unwrap();
        assert!(sent.success());
    }

    /// Sends a signal by name and waits for the end; returns the exit code.
    pub fn end_by(&mut self, signal: &str) -> Option<i32> {
        self.signal(signal);
        self.process.wait().unwrap().code()
    }

    /// A connection.
    pub fn connect(&self) -> UnixStream {
        let stream = UnixStream::connect(self.socket()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends bytes as they are and returns the status and body of the answer.
    pub fn ask(&self, request: &[u8]) -> (u16, String) {
        let (status, _, body) = self.ask_bytes(request);
        (status, String::from_utf8_lossy(&body).into_owned())
    }

    /// Sends bytes as they are and returns the status, head and body of the answer.
    pub fn ask_bytes(&self, request: &[u8]) -> (u16, String, Vec<u8>) {
        Self::exchange(self.connect(), request)
    }

    fn exchange(mut stream: UnixStream, request: &[u8]) -> (u16, String, Vec<u8>) {
        // A daemon that has heard enough may close before everything is sent.
        drop(stream.write_all(request));
        let mut answer = Vec::new();
        drop(stream.read_to_end(&mut answer));
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n");
        let body = end.map_or(Vec::new(), |end| answer.split_off(end + 4));
        let head = String::from_utf8_lossy(&answer).into_owned();
        let status = head.split(' ').nth(1).and_then(|code| code.parse().ok());
        (status.unwrap_or(0), head, body)
    }

    /// A whole request with a body.
    pub fn request(method: &str, path: &str, body: &str) -> String {
        format!(
            "{method} {path} HTTP/1.1\r\nhost: captured\r\nconnection: close\r\n\
             content-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
            body.len()
        )
    }

    /// Sends a whole request and reads a JSON answer.
    pub fn send(&self, method: &str, path: &str, body: &str) -> (u16, serde_json::Value) {
        let (status, body) = self.ask(Self::request(method, path, body).as_bytes());
        (
            status,
            serde_json::from_str(&body).unwrap_or(serde_json::Value::Null),
        )
    }

    /// [`Self::send`] for what takes long: an answer is waited for so many seconds.
    pub fn send_for(
        &self,
        seconds: u64,
        method: &str,
        path: &str,
        body: &str,
    ) -> (u16, serde_json::Value) {
        let stream = self.connect();
        stream
            .set_read_timeout(Some(Duration::from_secs(seconds)))
            .unwrap();
        let (status, _, body) =
            Self::exchange(stream, Self::request(method, path, body).as_bytes());
        let json = serde_json::from_slice(&body);
        (status, json.unwrap_or(serde_json::Value::Null))
    }

    /// Runs `capturectl` where it finds this daemon; returns exit code, output and messages.
    pub fn capturectl(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        let output = Command::new(program("capturectl"))
            .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
            .args(arguments)
            .current_dir(self.folder.path())
            .env("XDG_RUNTIME_DIR", self.folder.path())
            .env_remove("RUNTIME_DIRECTORY")
            .output()
            .expect("capturectl is built");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (
            output.status.code(),
            text(&output.stdout),
            text(&output.stderr),
        )
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        drop(self.process.kill());
        drop(self.process.wait());
    }
}
