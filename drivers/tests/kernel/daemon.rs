//! A whole daemon on two virtual cameras and a flash LED. What the LED does is seen in the color
//! camera's pictures, so that a wrong label would show in their pixels.

use crate::machine::{is_long, lumas, number, set_control, wait_for, write};
use drivers::{Frame, Settings, open};
use std::{
    fs,
    io::{Read, Write},
    os::unix::{net::UnixStream, process::ExitStatusExt},
    path::Path,
    process::{Child, Command, ExitStatus, Output, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

const COLOR: &str = "/dev/video0";
const DEPTH: &str = "/dev/video1";
const LED: &str = "/sys/module/fakeflash/parameters";
pub const FOLDER: &str = "/tmp/daemon";
const SOCKET: &str = "/tmp/daemon/captured.sock";

/// `V4L2_CID_BRIGHTNESS`, and what plays the room alone and the room with the flash.
const BRIGHTNESS: u32 = 0x0098_0900;
const ROOM: i64 = 100;
const LIT: i64 = 200;

/// `longest_seconds`, 10 % for a timer that runs slowly, and the kernel's ticks.
const BOUND: Duration = Duration::from_millis(150 + 15 + 12);

pub const CAMERA: &str = r#"
model = "two virtual cameras"

[color]
node = "bus:platform:vivid-000"
format = "YUYV"
width = 320
height = 180
frames_per_second = 25.0
# Without the text that counts frames.
controls = { osd_text_mode = 2 }

[depth]
node = "bus:platform:vivid-001"
format = "Y16"
width = 320
height = 180
frames_per_second = 25.0
# Gray of 16 to 235 of 255 becomes 0.12 to 1.8 m.
unit_metres = 3e-5
controls = { osd_text_mode = 2 }

[flash]
kind = "subdevice"
longest_seconds = 0.15
"#;

pub fn lit() -> bool {
    number(&format!("{LED}/strobing")) == 1
}

/// The scene before the color camera: brighter while the LED shines.
pub struct Scene {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Scene {
    pub fn begin() -> Self {
        set_control(COLOR, BRIGHTNESS, ROOM);
        let over = Arc::new(AtomicBool::new(false));
        let watched = Arc::clone(&over);
        let thread = std::thread::spawn(move || {
            let mut shining = false;
            while !watched.load(Ordering::Relaxed) {
                // The camera may be unplugged meanwhile; it comes back as dark as the room.
                if lit() != shining && Path::new(COLOR).exists() {
                    shining = !shining;
                    set_control(COLOR, BRIGHTNESS, if shining { LIT } else { ROOM });
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        Self {
            over,
            thread: Some(thread),
        }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

/// A running daemon; killed when dropped.
pub struct Daemon(Child);

impl Daemon {
    pub fn start() -> Self {
        fs::create_dir_all(FOLDER).unwrap();
        fs::write(format!("{FOLDER}/camera.toml"), CAMERA).unwrap();
        let config = format!(
            "devices = [\"v4l:{FOLDER}/camera.toml\"]\nsocket = \"{SOCKET}\"\nstate = \"{FOLDER}/state\"\n\
             [capture]\ndeadline_seconds = 60.0\n"
        );
        fs::write(format!("{FOLDER}/captured.toml"), config).unwrap();
        let log = fs::File::options()
            .append(true)
            .create(true)
            .open(format!("{FOLDER}/log"))
            .unwrap();
        let mut daemon = Self(
            Command::new("captured")
                .arg("--config")
                .arg(format!("{FOLDER}/captured.toml"))
                .stderr(log)
                .spawn()
                .unwrap(),
        );
        let since = Instant::now();
        while UnixStream::connect(SOCKET).is_err() {
            let ended = daemon.0.try_wait().unwrap();
            assert!(
                ended.is_none() && since.elapsed() < Duration::from_secs(30),
                "the daemon does not listen ({ended:?}): {}",
                log_text()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
        daemon
    }

    /// Its process.
    pub fn process(&self) -> u32 {
        self.0.id()
    }

    /// Asks it to stop, and answers how it ended.
    pub fn stop(mut self) -> ExitStatus {
        let asked = Command::new("kill").arg(self.0.id().to_string()).status();
        assert!(asked.unwrap().success());
        self.0.wait().unwrap()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

pub fn log_text() -> String {
    fs::read_to_string(format!("{FOLDER}/log")).unwrap_or_default()
}

pub fn capturectl(arguments: &[&str]) -> Command {
    let mut command = Command::new("capturectl");
    command
        .arg("--config")
        .arg(format!("{FOLDER}/captured.toml"))
        .args(arguments);
    command
}

/// Runs it to its end; what it said is shown where it failed and should not have.
pub fn succeeds(arguments: &[&str]) -> String {
    let output = capturectl(arguments).output().unwrap();
    let said = said(&output);
    assert!(
        output.status.success(),
        "{arguments:?}: {said}\n{}",
        log_text()
    );
    said
}

pub fn said(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).trim().to_owned()
}

/// Frames of a shot that was kept.
fn frames(folder: &str) -> Vec<Frame> {
    let mut device = open(&format!("{folder}/shot.mcap")).unwrap();
    let mut stream = device.start(&Settings::default()).unwrap();
    std::iter::from_fn(|| stream.next_frame(Duration::ZERO).ok()).collect()
}

/// Every file of a shot is as it was written, and its pixels say what its labels do.
pub fn is_whole_and_labelled_right(folder: &str) {
    succeeds(&["info", folder]);
    let (flash, ambient) = is_labelled_right(folder);
    eprintln!("{folder}: luma of the flash frame {flash:.1?}, of the ambient frames {ambient:.1?}");
}

/// [`labels`] that must be right.
fn is_labelled_right(folder: &str) -> (Vec<f64>, Vec<f64>) {
    labels(folder).unwrap_or_else(|problem| panic!("{problem}"))
}

/// The luma of a shot's flash frame and of its ambient frames; or in words what its pixels say against its
/// labels.
pub fn labels(folder: &str) -> Result<(Vec<f64>, Vec<f64>), String> {
    let frames = frames(folder);
    let depths = frames
        .iter()
        .filter(|frame| matches!(frame, Frame::Depth(_)));
    let depths = depths.count();
    let (flash, ambient) = lumas(&frames);
    // The flash adds 100 of 255; half of that tells the two apart whatever the pattern clips.
    let apart = flash
        .iter()
        .all(|flash| ambient.iter().all(|ambient| *flash > ambient + 50.0));
    if depths > 0 && flash.len() == 1 && !ambient.is_empty() && apart {
        Ok((flash, ambient))
    } else {
        Err(format!(
            "{folder}: luma of flash frames {flash:.1?}, of ambient frames {ambient:.1?}; {depths} depth frames"
        ))
    }
}

/// Shots of which every byte is as it was written.
pub fn whole() -> Vec<String> {
    let output = capturectl(&["--json", "fsck"]).output().unwrap();
    let found: serde_json::Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", said(&output)));
    let found = found["found"].as_array().unwrap().iter();
    let whole = found.filter(|shot| shot["condition"] == "whole");
    whole
        .map(|shot| shot["name"].as_str().unwrap().to_owned())
        .collect()
}

/// What the daemon answers, and whether it did what it was asked for.
pub fn ask(method: &str, path: &str, body: &str) -> (bool, serde_json::Value) {
    let mut stream = UnixStream::connect(SOCKET).unwrap();
    let request = format!(
        "{method} {path} HTTP/1.1\r\nHost: daemon\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    let done = head.starts_with("HTTP/1.1 2");
    (done, serde_json::from_str(body).unwrap_or_default())
}

/// What the daemon says its device is doing.
fn phase() -> String {
    let (_, status) = ask("GET", "/v1/status", "");
    status["devices"][0]["phase"].as_str().unwrap().to_owned()
}

/// How long the daemon takes to say so.
fn until(wanted: &str) -> Duration {
    let since = Instant::now();
    while phase() != wanted {
        assert!(since.elapsed() < Duration::from_secs(5), "never {wanted}");
        std::thread::sleep(Duration::from_millis(2));
    }
    since.elapsed()
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Nobody asks for a shot while the camera goes and comes.
fn idle_loss_is_told_and_mended() {
    let cycles = if is_long() { 50 } else { 5 };
    let (mut losses, mut returns) = (Vec::new(), Vec::new());
    for _ in 0..cycles {
        until("idle");
        write("/sys/bus/platform/drivers/vivid/unbind", "vivid.0");
        losses.push(until("degraded"));
        write("/sys/bus/platform/drivers/vivid/bind", "vivid.0");
        wait_for(COLOR);
        returns.push(until("idle"));
    }
    set_control(COLOR, BRIGHTNESS, ROOM);
    losses.sort();
    returns.sort();
    let worst = |times: &[Duration]| times[times.len() - 1];
    eprintln!(
        "figure | a real kernel's camera unplugged while the daemon is idle | {cycles} times; told within {:.0} ms (median {:.0}), ready again within \
         {:.0} ms (median {:.0})",
        milliseconds(worst(&losses)),
        milliseconds(losses[cycles / 2]),
        milliseconds(worst(&returns)),
        milliseconds(returns[cycles / 2])
    );
    // A look every 250 ms, and one answer of the daemon.
    assert!(worst(&losses) <= Duration::from_millis(300));
    assert!(worst(&returns) <= Duration::from_secs(2));
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_shot_is_whole_its_pixels_prove_its_labels_and_a_camera_comes_and_goes() {
    drop(fs::remove_dir_all(FOLDER));
    let _scene = Scene::begin();
    let daemon = Daemon::start();
    let since = Instant::now();
    let relit = format!("{FOLDER}/relit");
    let said = succeeds(&[
        "shoot",
        "--relight",
        "--tier",
        "closed",
        "--light",
        "0.5,0.4,0.8",
        "--out",
        &relit,
    ]);
    eprintln!("{said}, {:?}", since.elapsed());
    is_whole_and_labelled_right(&relit);
    for file in ["relit_000.exr", "relit_000.png", "albedo.exr", "normal.exr"] {
        assert!(Path::new(&relit).join(file).exists(), "no {file}");
    }
    for shot in 0..if is_long() { 40 } else { 3 } {
        let folder = format!("{FOLDER}/shot{shot}");
        succeeds(&["shoot", "--out", &folder]);
        is_whole_and_labelled_right(&folder);
    }
    idle_loss_is_told_and_mended();
    // Without its color camera there is no shot, and a reason; with it there is one again.
    write("/sys/bus/platform/drivers/vivid/unbind", "vivid.0");
    let none = format!("{FOLDER}/none");
    let refused = capturectl(&["shoot", "--out", &none]).output().unwrap();
    assert!(!refused.status.success() && !Path::new(&none).exists());
    eprintln!("unplugged: {}", self::said(&refused));
    write("/sys/bus/platform/drivers/vivid/bind", "vivid.0");
    wait_for(COLOR);
    wait_for(DEPTH);
    set_control(COLOR, BRIGHTNESS, ROOM);
    let since = Instant::now();
    let again = format!("{FOLDER}/again");
    loop {
        let output = capturectl(&["shoot", "--out", &again]).output().unwrap();
        if output.status.success() {
            break;
        }
        assert!(
            since.elapsed() < Duration::from_secs(10),
            "{}",
            self::said(&output)
        );
        std::thread::sleep(Duration::from_millis(50));
    }
    eprintln!(
        "plugged in: a shot {:?} later, as its last client saw it",
        since.elapsed()
    );
    is_whole_and_labelled_right(&again);
    let ended = daemon.stop();
    assert!(ended.success(), "{ended:?}: {}", log_text());
    assert!(!Path::new(SOCKET).exists());
    succeeds(&["fsck"]);
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_daemon_killed_while_its_flash_burns_leaves_it_dark_and_its_shots_whole() {
    drop(fs::remove_dir_all(FOLDER));
    let _scene = Scene::begin();
    let mut longest = Duration::ZERO;
    let times = if is_long() { 20 } else { 3 };
    for _ in 0..times {
        let mut daemon = Daemon::start();
        let mut client = capturectl(&["shoot", "--out", "/tmp/daemon/never"])
            .stderr(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let since = Instant::now();
        while !lit() {
            assert!(
                since.elapsed() < Duration::from_secs(30),
                "no flash: {}",
                log_text()
            );
            std::thread::sleep(Duration::from_millis(1));
        }
        let burning = Instant::now();
        daemon.0.kill().unwrap();
        let ended = daemon.0.wait().unwrap();
        assert_eq!(ended.signal(), Some(9));
        while lit() {
            assert!(burning.elapsed() < Duration::from_secs(2), "left burning");
            std::thread::sleep(Duration::from_millis(1));
        }
        longest = longest.max(burning.elapsed());
        assert!(!client.wait().unwrap().success(), "a shot of a dead daemon");
    }
    eprintln!(
        "figure | SIGKILL in the middle of a flash, a real kernel's LED | {times} times; the last light was {:.0} ms after its beginning",
        milliseconds(longest)
    );
    assert!(longest <= BOUND, "{longest:?}");
    // Another one takes over what is left, and photographs.
    let daemon = Daemon::start();
    let after = format!("{FOLDER}/after");
    succeeds(&["shoot", "--out", &after]);
    is_whole_and_labelled_right(&after);
    assert!(daemon.stop().success());
    succeeds(&["fsck"]);
}
