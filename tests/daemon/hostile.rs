//! Clients that want the daemon to fail, while others want a shot.

use crate::{Daemon, api::events};
use std::{
    io::{Read, Write},
    os::unix::{fs::PermissionsExt, net::UnixStream},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// Clients at once, and how many of them belong to another user.
const CLIENTS: usize = 64;
const OTHERS: usize = 8;
/// Requests for the status, and shots, in peace and under attack.
const CALLS: usize = 300;
const SHOTS: usize = 100;

/// The socket of the daemon, for the process of another user.
const SOCKET: &str = "CAPTURED_HOSTILE_SOCKET";

/// What a client does, over and over.
#[derive(Debug, Clone, Copy)]
enum Attack {
    /// Half a head, one byte at a time.
    Slow,
    /// A head, and a body that does not come.
    HalfRequest,
    /// A body of a gibibyte, of which as much is sent as is taken.
    Enormous,
    /// Answers that nobody reads.
    Deaf,
    /// Bytes that mean nothing.
    Garbage,
    /// Whole requests that are none of its business.
    Uninvited,
}

const ATTACKS: [Attack; 5] = [
    Attack::Slow,
    Attack::HalfRequest,
    Attack::Enormous,
    Attack::Deaf,
    Attack::Garbage,
];

struct Client {
    attack: Attack,
    stream: Option<UnixStream>,
    sent: usize,
}

impl Client {
    fn new(attack: Attack) -> Self {
        Self {
            attack,
            stream: None,
            sent: 0,
        }
    }

    /// The next bit of its attack, on another connection where it was thrown out.
    fn go_on(&mut self, socket: &Path) {
        if self.stream.is_none() {
            let connected = UnixStream::connect(socket).ok();
            self.stream = connected.filter(|stream| stream.set_nonblocking(true).is_ok());
            self.sent = 0;
        }
        let Some(stream) = &mut self.stream else {
            return;
        };
        let head = b"POST /v1/shots HTTP/1.1\r\nhost: captured\r\ncontent-length: ";
        let bytes: &[u8] = match (self.attack, self.sent) {
            (Attack::Slow, sent) => &head[sent % 30..sent % 30 + 1],
            (Attack::HalfRequest, 0) => {
                b"POST /v1/shots HTTP/1.1\r\nhost: captured\r\ncontent-length: 500\r\n\r\n{"
            }
            (Attack::HalfRequest, _) => b"",
            (Attack::Enormous, 0) => {
                b"POST /v1/shots HTTP/1.1\r\nhost: captured\r\ncontent-length: 1073741824\r\n\r\n"
            }
            (Attack::Enormous, _) => &[b' '; 16384],
            (Attack::Deaf, _) => b"GET /v1/openapi.json HTTP/1.1\r\nhost: captured\r\n\r\n",
            (Attack::Garbage, _) => &[0xff; 256],
            (Attack::Uninvited, _) => {
                b"POST /v1/shots HTTP/1.1\r\nhost: captured\r\ncontent-length: 2\r\n\r\n{}"
            }
        };
        match stream.write(bytes) {
            Ok(sent) => self.sent += sent,
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(_) => self.stream = None,
        }
        if matches!(self.attack, Attack::Deaf | Attack::Slow) {
            return;
        }
        // What it is told, and whether it was thrown out.
        if let Some(stream) = &mut self.stream
            && matches!(stream.read(&mut [0; 4096]), Ok(0))
        {
            self.stream = None;
        }
    }
}

/// All clients a step each, every 20 ms and one after the other, until `over`.
fn attack(clients: &mut [Client], socket: &Path, over: &AtomicBool) {
    let breath = Duration::from_millis(20) / CLIENTS as u32;
    while !over.load(Ordering::Relaxed) {
        for client in &mut *clients {
            client.go_on(socket);
            std::thread::sleep(breath);
        }
    }
}

/// Not a test by itself: the clients of another user.
#[test]
#[ignore = "run by the others, as a process of its own"]
fn of_another_user() {
    let Some(socket) = std::env::var_os(SOCKET) else {
        return;
    };
    let mut clients: Vec<Client> = (0..OTHERS)
        .map(|_| Client::new(Attack::Uninvited))
        .collect();
    attack(
        &mut clients,
        &PathBuf::from(socket),
        &AtomicBool::new(false),
    );
}

/// Clients of another user, where this process may make some; killed when dropped.
struct Others(Option<Child>);

impl Others {
    fn begin(daemon: &Daemon) -> Self {
        // For everybody, as an owner might.
        for (path, mode) in [
            (daemon.socket(), 0o666),
            (daemon.folder.path().to_owned(), 0o755),
        ] {
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        }
        let program = daemon.folder.path().join("clients");
        let copied = std::fs::copy(std::env::current_exe().unwrap(), &program);
        let started = copied.and_then(|_| {
            Command::new("setpriv")
                .args(["--reuid=4242", "--regid=4242", "--clear-groups"])
                .arg(&program)
                .args(["hostile::of_another_user", "--exact", "--ignored"])
                .current_dir("/")
                .env(SOCKET, daemon.socket())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
        });
        let mut others = Self(started.ok());
        std::thread::sleep(Duration::from_millis(300));
        if let Some(child) = &mut others.0
            && !matches!(child.try_wait(), Ok(None))
        {
            others.0 = None;
        }
        if others.0.is_none() {
            eprintln!("SKIPPED: hostile clients of another user (needs root and setpriv)");
        }
        others
    }
}

impl Drop for Others {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            drop(child.kill());
            drop(child.wait());
        }
    }
}

/// Of sorted times, the one that 99 of 100 do not exceed, ms.
fn p99(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    times[(times.len() * 99).div_ceil(100) - 1].as_secs_f64() * 1e3
}

/// p99 of a status, and of a shot from the request to the word that it is being taken, ms.
fn waits(daemon: &Daemon) -> (f64, f64) {
    let calls = (0..CALLS).map(|_| {
        let began = Instant::now();
        assert_eq!(daemon.send("GET", "/v1/status", "").0, 200);
        began.elapsed()
    });
    let calls = p99(calls.collect());
    let shots = (0..SHOTS).map(|_| {
        let began = Instant::now();
        let mut said = events(daemon, "POST", "/v1/shots", "{}");
        let first = said.next().unwrap();
        let took = began.elapsed();
        assert_eq!(first, ("step".to_owned(), "taking the shot".to_owned()));
        assert_eq!(said.last().unwrap().0, "done");
        took
    });
    (calls, p99(shots.collect()))
}

#[test]
fn sixty_four_hostile_clients_keep_neither_a_status_nor_a_shot_waiting() {
    let daemon = Daemon::start("synthetic:desk?width=96&height=72");
    // The first ones pay for what is loaded once.
    waits(&daemon);
    let quiet = waits(&daemon);
    let before = daemon.resident_bytes();
    let others = Others::begin(&daemon);
    let over = AtomicBool::new(false);
    let socket = daemon.socket();
    let (busy, after) = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut clients: Vec<Client> = (0..CLIENTS - OTHERS)
                .map(|number| Client::new(ATTACKS[number % ATTACKS.len()]))
                .collect();
            attack(&mut clients, &socket, &over);
        });
        std::thread::sleep(Duration::from_millis(300));
        let found = (waits(&daemon), daemon.resident_bytes());
        over.store(true, Ordering::Relaxed);
        found
    });
    drop(others);
    let mebibytes = (after as f64 - before as f64) / f64::from(1 << 20);
    eprintln!(
        "figure | {CLIENTS} hostile clients at once: slow, half a request, a body of 1 GiB, deaf, garbage, another user | status p99 {:.1} ms (quiet {:.1}); a shot begins within p99 {:.1} ms (quiet {:.1}, {:.2} times); {mebibytes:+.1} MiB",
        busy.0,
        quiet.0,
        busy.1,
        quiet.1,
        busy.1 / quiet.1
    );
    // The figures to reach are 20 ms and 1.2 times; a machine that tests ten other things at once gets
    // some slack.
    assert!(busy.0 < 200.0, "{busy:?}");
    assert!(busy.1 < 4.0 * quiet.1 + 100.0, "{busy:?} {quiet:?}");
    assert!(mebibytes < 16.0, "{mebibytes} MiB");
    assert_eq!(daemon.send("POST", "/v1/shots", "{}").0, 200);
}

#[test]
fn a_service_manager_that_hears_nothing_holds_nobody_up() {
    // A sign of life every 10 ms, of which a socket holds a dozen.
    let watched = [("WATCHDOG_USEC", "20000")];
    let mut daemon = Daemon::start_among("", &["synthetic:desk?width=96&height=72"], &watched);
    std::thread::sleep(Duration::from_millis(500));
    for _ in 0..20 {
        assert_eq!(daemon.send("GET", "/v1/status", "").0, 200);
    }
    assert_eq!(daemon.send("POST", "/v1/shots", "{}").0, 200);
    assert_eq!(daemon.end_by("TERM"), Some(0));
}
