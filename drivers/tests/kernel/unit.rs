//! The daemon as systemd runs it: `captured.service` and its sockets, put in place by `capturectl
//! install`, on two virtual cameras and a flash LED.

use crate::{
    daemon::{CAMERA, FOLDER, Scene, capturectl, is_whole_and_labelled_right, lit, said, succeeds},
    machine::{number, wait_for, write},
};
use std::{
    collections::BTreeMap,
    fs,
    io::{Read, Write},
    net::TcpStream,
    os::unix::{fs::PermissionsExt, net::UnixStream},
    path::Path,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

const LAMP: &str = "/sys/class/leds/white:flash";
const UNITS: &str = "/usr/lib/systemd/system";

/// Longest wait for the service manager. Reached only where something is broken.
const PATIENCE: Duration = Duration::from_secs(60);

/// From the end of the daemon to the end of a light that only `ExecStopPost` puts out, which sets up the
/// sandbox and starts a program. The guest does 125 million instructions a second, on one processor.
const DARK: Duration = Duration::from_secs(10);

fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().unwrap();
    let said = said(&output);
    assert!(output.status.success(), "{program} {arguments:?}: {said}");
    said
}

fn systemctl(arguments: &[&str]) -> String {
    run("systemctl", arguments)
}

fn property(name: &str) -> String {
    systemctl(&["show", "--value", "--property", name, "captured.service"])
}

fn daemon_id() -> u32 {
    property("MainPID").parse().unwrap()
}

fn signal(name: &str, process: u32) {
    // The shell's own, as there is no other program of that name.
    run("sh", &["-c", &format!("kill -{name} {process}")]);
}

/// Waits until the service is active under another process than `before`.
fn active_again(before: u32) -> u32 {
    let since = Instant::now();
    loop {
        let now = daemon_id();
        if now != 0 && now != before && property("ActiveState") == "active" {
            return now;
        }
        assert!(
            since.elapsed() < 3 * PATIENCE,
            "not active again: {}",
            property("Result")
        );
        // Asking costs more than waiting, which a guest without work skips.
        std::thread::sleep(Duration::from_millis(500));
    }
}

fn holds_within(most: Duration, what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let since = Instant::now();
    while !holds() {
        assert!(since.elapsed() < most, "{what}: not within {most:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
    since.elapsed()
}

/// What the daemon said since the boot.
fn journal() -> String {
    run(
        "journalctl",
        &["--no-pager", "-o", "cat", "-u", "captured.service"],
    )
}

/// The configuration that counts now.
fn configuration() -> String {
    let mut stream = UnixStream::connect("/run/captured/captured.sock").unwrap();
    let request = "GET /v1/config HTTP/1.1\r\nHost: daemon\r\nConnection: close\r\n\r\n";
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

/// Puts a configuration in place, as the owner of the machine would.
fn configure(more: &str) {
    fs::create_dir_all(FOLDER).unwrap();
    fs::create_dir_all("/etc/captured").unwrap();
    let camera = CAMERA.replace(
        "kind = \"subdevice\"",
        "kind = \"led\"\nnode = \"white:flash\"",
    );
    fs::write("/etc/captured/camera.toml", camera).unwrap();
    let config = format!(
        "devices = [\"v4l:/etc/captured/camera.toml\"]\n[capture]\ndeadline_seconds = 60.0\n{more}"
    );
    // The one the daemon reads, and the one that the tests' `capturectl` is given.
    for path in [
        "/etc/captured/captured.toml".to_owned(),
        format!("{FOLDER}/captured.toml"),
    ] {
        fs::write(path, &config).unwrap();
    }
}

/// What `capturectl install` says comes after it; then the sockets alone, so that the first client starts
/// the daemon.
fn begin() -> Scene {
    configure("");
    systemctl(&[
        "stop",
        "captured.socket",
        "captured-viewer.socket",
        "captured.service",
    ]);
    systemctl(&["reset-failed"]);
    run("systemd-sysusers", &[]);
    run("systemd-tmpfiles", &["--create"]);
    run("udevadm", &["control", "--reload"]);
    run("udevadm", &["trigger", "--action=add", "--settle"]);
    systemctl(&["daemon-reload"]);
    wait_for("/dev/video0");
    systemctl(&["start", "captured.socket", "captured-viewer.socket"]);
    Scene::begin()
}

fn shoots(name: &str) {
    let out = format!("{FOLDER}/{name}");
    drop(fs::remove_dir_all(&out));
    let answer = succeeds(&["--json", "shoot", "--out", &out]);
    // What it says besides follows the document.
    let mut documents = serde_json::Deserializer::from_str(&answer).into_iter();
    let answer: serde_json::Value = documents.next().unwrap().unwrap();
    assert_eq!(answer["by"], "daemon", "{answer}");
    is_whole_and_labelled_right(&out);
}

#[test]
#[ignore = "needs the systemd of tests/guest/run"]
fn the_first_client_starts_the_service_and_a_viewer_is_let_in_from_outside_its_network() {
    let _scene = begin();
    assert_eq!(property("ActiveState"), "inactive");
    let kept = || {
        let shots = fs::read_dir("/var/lib/private/captured/shots").into_iter();
        let names = shots.flatten().map(|entry| entry.unwrap().file_name());
        names
            .filter(|name| name.to_string_lossy().starts_with("shot-"))
            .count()
    };
    let before = kept();
    let since = Instant::now();
    shoots("first");
    let took = since.elapsed();
    assert_eq!(property("ActiveState"), "active");
    assert_eq!(property("StatusErrno"), "0");
    let id = daemon_id();
    let status = fs::read_to_string(format!("/proc/{id}/status")).unwrap();
    let field = |name: &str| -> Vec<&str> {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap_or_else(|| panic!("{name} in {status}"))
            .split_whitespace()
            .collect()
    };
    // Of the range in which systemd makes up users.
    let uid: u32 = field("Uid:")[0].parse().unwrap();
    assert!((61_184..=65_519).contains(&uid), "uid {uid}");
    assert_eq!(field("CapEff:"), ["0000000000000000"]);
    assert_eq!(field("CapBnd:"), ["0000000000000000"]);
    assert_eq!(field("NoNewPrivs:"), ["1"]);
    assert_eq!(field("Seccomp:"), ["2"]);
    let network = |id: &str| fs::read_link(format!("/proc/{id}/ns/net")).unwrap();
    assert_ne!(network(&id.to_string()), network("1"));
    // The shot lies where only the daemon and root can read it.
    let state = fs::metadata("/var/lib/private/captured").unwrap();
    assert_eq!(state.permissions().mode() & 0o777, 0o700);
    assert_eq!(kept(), before + 1);

    let address = capturectl(&["viewer"]).output().unwrap();
    let page = said(&address);
    let (_, token) = page
        .split_once("http://127.0.0.1:8377/#token=")
        .unwrap_or_else(|| panic!("{page}"));
    let answer = |bearer: &str| {
        let mut stream = TcpStream::connect("127.0.0.1:8377").unwrap();
        let request = format!(
            "GET /v1/status HTTP/1.1\r\nHost: 127.0.0.1:8377\r\nAuthorization: Bearer {bearer}\r\nConnection: close\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let told = answer(token.split_whitespace().next().unwrap());
    assert!(
        told.starts_with("HTTP/1.1 200") && told.contains("\"in_use\""),
        "{told}"
    );
    let refused = answer("0123");
    assert!(refused.starts_with("HTTP/1.1 401"), "{refused}");

    let memory: u64 = property("MemoryCurrent").parse().unwrap();
    eprintln!(
        "figure | captured.service under a real systemd, two virtual cameras and an LED | the first client starts it and has a shot {:.1} s later; uid {uid}, no capability, a network of its own, {} MiB",
        took.as_secs_f64(),
        memory >> 20
    );
}

#[test]
#[ignore = "needs the systemd of tests/guest/run"]
fn who_is_in_the_group_looks_who_is_not_is_kept_out_and_a_bad_configuration_changes_nothing() {
    let _scene = begin();
    shoots("of-root");
    let as_other = |group: &str, arguments: &[&str]| {
        let output = Command::new("setpriv")
            .args(["--reuid=4242", "--clear-groups"])
            .arg(format!("--regid={group}"))
            .args(["capturectl", "--config", "/tmp/daemon/captured.toml"])
            .args(arguments)
            .output()
            .unwrap();
        (output.status.success(), said(&output))
    };
    let (looks, list) = as_other("captured", &["shots"]);
    assert!(looks && list.contains("shot-"), "{list}");
    let (shoots_too, refused) = as_other("captured", &["shots", "--delete", "shot-1"]);
    assert!(!shoots_too && refused.contains("may look"), "{refused}");
    let (outside, refused) = as_other("nogroup", &["shots"]);
    assert!(!outside, "{refused}");

    let before = daemon_id();
    configure("[limits]\nlights = 7\n");
    systemctl(&["reload", "captured.service"]);
    holds_within(PATIENCE, "the configuration counts", || {
        configuration().contains("\"lights\":7")
    });
    configure("[limits]\nlihgts = 7\n");
    systemctl(&["reload", "captured.service"]);
    holds_within(PATIENCE, "the unknown key is named", || {
        journal().contains("lihgts")
    });
    configure("");
    assert_eq!(daemon_id(), before);
    shoots("after-reload");

    systemctl(&["stop", "captured.service"]);
    assert_eq!(property("Result"), "success");
    // Its socket stays, and brings it back.
    shoots("after-stop");
    assert_ne!(daemon_id(), before);
}

#[test]
#[ignore = "needs the systemd of tests/guest/run"]
fn the_watchdog_starts_a_daemon_anew_that_stands_still() {
    let scene = begin();
    shoots("before-stop");
    let before = daemon_id();
    let restarts = || property("NRestarts").parse::<u32>().unwrap();
    let restarted = restarts();
    // Nothing is to be seen meanwhile, and who looks for it keeps the guest awake.
    drop(scene);
    let since = Instant::now();
    signal("STOP", before);
    let after = active_again(before);
    let took = since.elapsed();
    assert_eq!(restarts(), restarted + 1);
    let _scene = Scene::begin();
    shoots("after-watchdog");
    eprintln!(
        "figure | captured.service whose daemon stands still (SIGSTOP), WatchdogSec=30s | another is active {:.0} s later ({before} became {after}) and photographs",
        took.as_secs_f64()
    );
}

#[test]
#[ignore = "needs the systemd of tests/guest/run"]
fn a_killed_daemon_leaves_no_lamp_on_and_is_back() {
    let _scene = begin();
    shoots("before-kill");
    let before = daemon_id();
    // Light that no timer of the kernel's ends.
    write(&format!("{LAMP}/brightness"), "15\n");
    let torch = || number(&format!("{LAMP}/brightness"));
    assert_eq!(torch(), 15);
    signal("KILL", before);
    let torch_off = holds_within(DARK, "the torch goes out", || torch() == 0);
    let after = active_again(before);
    // And in the middle of a flash.
    let mut client = capturectl(&["shoot", "--out", "/tmp/daemon/never"])
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    holds_within(PATIENCE, "a flash", lit);
    signal("KILL", after);
    let flash_off = holds_within(Duration::from_secs(1), "the flash goes out", || !lit());
    active_again(after);
    // The shot died with the daemon; whoever asked hears of it.
    assert!(!client.wait().unwrap().success());
    shoots("after-kill");
    eprintln!(
        "figure | captured.service killed with SIGKILL | a torch left on is out {} ms later by ExecStopPost, a flash {} ms later; it is active again and photographs",
        torch_off.as_millis(),
        flash_off.as_millis()
    );
}

/// The service with another program in the daemon's place, and with folders of its own.
fn unit_of_the_probe(program: &str) -> String {
    let unit = fs::read_to_string(format!("{UNITS}/captured.service")).unwrap();
    let kept = unit.lines().filter(|line| {
        let left_out = [
            "Requires=",
            "Exec",
            "Watchdog",
            "Restart",
            "NotifyAccess",
            "Also",
        ];
        !left_out.iter().any(|start| line.starts_with(start))
    });
    kept.map(|line| match line {
        "Type=notify" => {
            format!("Type=oneshot\nExecStart={program}\nStandardOutput=file:/run/probed")
        }
        "StateDirectory=captured" => "StateDirectory=captured-probe".to_owned(),
        "CacheDirectory=captured" => "CacheDirectory=captured-probe".to_owned(),
        other => other.to_owned(),
    })
    .map(|line| line + "\n")
    .collect()
}

/// What a probe managed, and what not, by name.
fn attempts(text: &str) -> BTreeMap<String, String> {
    text.lines()
        .filter_map(|line| line.split_once('\t'))
        .map(|(name, result)| (name.to_owned(), result.to_owned()))
        .collect()
}

#[test]
#[ignore = "needs the systemd of tests/guest/run"]
fn inside_the_service_everything_is_blocked_that_a_daemon_of_cameras_does_not_need() {
    let _scene = begin();
    let everybody = |path: &str, mode| {
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    };
    for folder in ["/opt/open", "/home/somebody"] {
        fs::create_dir_all(folder).unwrap();
        everybody(folder, 0o777);
    }
    for file in ["/home/somebody/letter", "/tmp/of-everybody"] {
        fs::write(file, "private").unwrap();
        everybody(file, 0o666);
    }
    fs::copy("/usr/bin/probe", "/usr/bin/probe-of-root").unwrap();
    everybody("/usr/bin/probe-of-root", 0o4755);
    // Open to everybody, so that only the sandbox stands between.
    for path in [
        "/dev/ttyS1",
        "/dev/video0",
        "/dev/mem",
        "/dev/kmsg",
        "/sys/kernel/mm/ksm/pages_to_scan",
    ] {
        everybody(path, 0o666);
    }
    fs::write(
        "/run/systemd/system/captured-probe.service",
        unit_of_the_probe("/usr/bin/probe"),
    )
    .unwrap();
    systemctl(&["daemon-reload"]);
    systemctl(&["start", "captured-probe.service"]);
    let inside = attempts(&fs::read_to_string("/run/probed").unwrap());
    let outside = attempts(&run("probe", &[]));
    for (name, result) in &inside {
        eprintln!("  {name}: {result} (root outside: {})", outside[name]);
    }
    // What the daemon lives on.
    let needed = [
        "Unix socket",
        "kernel uevents",
        "file in its own state",
        "camera",
        "noise",
        "brightness of the lamp",
    ];
    // What even root outside is not given by this kernel, and would prove nothing.
    let not_to_be_had: Vec<&String> = outside
        .iter()
        .filter(|(_, result)| *result != "done")
        .map(|(name, _)| name)
        .collect();
    assert!(not_to_be_had.is_empty(), "{not_to_be_had:?}");
    assert_eq!(inside.len(), outside.len());
    let wrong: Vec<_> = inside
        .iter()
        .filter(|(name, result)| needed.contains(&name.as_str()) != (*result == "done"))
        .collect();
    assert!(wrong.is_empty(), "{wrong:?}");
    eprintln!(
        "figure | inside captured.service, a probe in the daemon's place | {} of {} attempts refused that succeed outside, {} of {} done that the daemon needs",
        inside.len() - needed.len(),
        outside.len() - needed.len(),
        needed.len(),
        needed.len()
    );
    assert!(Path::new("/var/lib/private/captured-probe/probe").exists());
}
