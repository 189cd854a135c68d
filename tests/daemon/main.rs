//! The daemon as its clients meet it: a process behind a Unix socket.

mod requests;
mod shots;

use std::{
    io::{Read, Write},
    os::unix::net::{UnixDatagram, UnixStream},
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// Longest wait for anything a daemon should do at once. Reached only by a broken one.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running daemon with folders of its own; stopped when dropped.
pub struct Daemon {
    /// Holds the socket, the state and whatever a test writes.
    pub folder: tempfile::TempDir,
    notifications: UnixDatagram,
    process: Child,
}

impl Daemon {
    /// Starts a daemon on `device` and waits until it says that it is ready.
    pub fn start(device: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let notifications = UnixDatagram::bind(folder.path().join("notify")).unwrap();
        notifications.set_read_timeout(Some(PATIENCE)).unwrap();
        let process = Self::command(&folder, device)
            .spawn()
            .expect("captured is built");
        let daemon = Self {
            folder,
            notifications,
            process,
        };
        assert_eq!(daemon.notification(), "READY=1");
        daemon
    }

    fn command(folder: &tempfile::TempDir, device: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_captured"));
        command.env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
        command
            .args([
                "--device",
                device,
                "--socket",
                "captured/captured.sock",
                "--state",
                "state",
            ])
            .current_dir(folder.path())
            .env("NOTIFY_SOCKET", folder.path().join("notify"))
            .env_remove("RUNTIME_DIRECTORY")
            .env_remove("STATE_DIRECTORY")
            .stderr(Stdio::null());
        command
    }

    /// What the daemon tells the service manager next.
    pub fn notification(&self) -> String {
        let mut bytes = [0; 200];
        let length = self
            .notifications
            .recv(&mut bytes)
            .expect("the daemon notifies in time");
        String::from_utf8_lossy(&bytes[..length])
            .trim_end()
            .to_owned()
    }

    /// Tries to start a second daemon in the same folders; returns its exit code and message.
    pub fn start_another(&self) -> (Option<i32>, String) {
        let mut command = Self::command(&self.folder, "synthetic:desk");
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

    /// Sends a signal by name and waits for the end; returns the exit code.
    pub fn end_by(&mut self, signal: &str) -> Option<i32> {
        let script = format!("kill -{signal} {}", self.process.id());
        assert!(
            Command::new("sh")
                .args(["-c", &script])
                .status()
                .unwrap()
                .success()
        );
        self.process.wait().unwrap().code()
    }

    /// Sends bytes as they are and returns the status and body of the answer.
    pub fn ask(&self, request: &[u8]) -> (u16, String) {
        let mut stream = UnixStream::connect(self.socket()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // A daemon that has heard enough may close before everything is sent.
        drop(stream.write_all(request));
        let mut answer = Vec::new();
        drop(stream.read_to_end(&mut answer));
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer
            .split(' ')
            .nth(1)
            .and_then(|code| code.parse().ok())
            .unwrap_or(0);
        let body = answer.split_once("\r\n\r\n").map_or("", |(_, body)| body);
        (status, body.to_owned())
    }

    /// A whole request with a body.
    pub fn send(&self, method: &str, path: &str, body: &str) -> (u16, serde_json::Value) {
        let request = format!(
            "{method} {path} HTTP/1.1\r\nhost: captured\r\nconnection: close\r\n\
             content-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
            body.len()
        );
        let (status, body) = self.ask(request.as_bytes());
        (
            status,
            serde_json::from_str(&body).unwrap_or(serde_json::Value::Null),
        )
    }

    /// Runs `capturectl` where it finds this daemon; returns exit code, output and messages.
    pub fn capturectl(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_capturectl"))
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
