//! What must not bring the daemon down: bad configurations, full disks, lost devices, and its own sudden
//! end.

use crate::{Daemon, PATIENCE};
use serde_json::{Value, json};
use std::{
    io::{Read, Write},
    process::Command,
    time::{Duration, Instant},
};

const RELIGHT: &str =
    r#"{"relight": true, "tier": "closed", "lights": [{"direction": [0.5, 0.4, 0.8]}]}"#;

fn wait_for(what: &str, mut holds: impl FnMut() -> bool) {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_bad_configuration_changes_nothing_and_is_named_by_line_and_a_good_one_counts_at_once() {
    let daemon = Daemon::start_with("[limits]\nlights = 5\n", &["synthetic:desk"]);
    let config = daemon.folder.path().join("captured.toml");
    let lights =
        |daemon: &Daemon| daemon.send("GET", "/v1/config", "").1["limits"]["lights"].clone();
    assert_eq!(lights(&daemon), 5);
    for (bad, line, key) in [
        ("[limits]\nlihgts = 3\n", "line 2", "lihgts"),
        ("[limits]\n\nlights = 0\n", "line 3", "limits.lights"),
        ("[limits\n", "line 1", "captured.toml"),
    ] {
        std::fs::write(&config, bad).unwrap();
        daemon.signal("HUP");
        assert!(daemon.notification().starts_with("RELOADING=1"));
        assert_eq!(daemon.notification(), "READY=1");
        assert_eq!(lights(&daemon), 5);
        let log = daemon.log();
        let said = log.lines().last().unwrap().to_owned();
        assert!(log.contains("last good configuration stays"), "{log}");
        assert!(log.contains(line) && log.contains(key), "{bad:?}: {said}");
    }
    std::fs::write(&config, "[limits]\nlights = 3\n").unwrap();
    daemon.signal("HUP");
    daemon.notification();
    assert_eq!(daemon.notification(), "READY=1");
    assert_eq!(lights(&daemon), 3);
}

#[test]
fn a_shot_without_room_is_refused_before_the_camera_streams() {
    let daemon = Daemon::start_with("[shots]\nquota_bytes = 1048576\n", &["synthetic:desk"]);
    let (status, answer) = daemon.send("POST", "/v1/shots", RELIGHT);
    assert_eq!(status, 507, "{answer}");
    assert_eq!(answer["kind"], "output");
    assert!(
        answer["message"]
            .as_str()
            .unwrap()
            .contains("shots.quota_bytes"),
        "{answer}"
    );
    assert!(!daemon.log().contains("in_use=true"), "{}", daemon.log());
}

#[test]
fn a_device_that_is_lost_is_opened_again_while_the_other_goes_on() {
    let daemon = Daemon::start_with("", &["flaky:unplug=2:synthetic:desk", "synthetic:statue"]);
    let shoot = |device: &str| {
        let body = json!({ "device": device }).to_string();
        daemon.send("POST", "/v1/shots", &body)
    };
    let devices = || daemon.send("GET", "/v1/status", "").1["devices"].clone();
    let flaky = devices()[0]["device"]["address"]
        .as_str()
        .unwrap()
        .to_owned();
    let other = devices()[1]["device"]["address"]
        .as_str()
        .unwrap()
        .to_owned();
    for round in 1..=3 {
        let (status, answer) = shoot(&flaky);
        assert_eq!(
            (status, &answer["kind"]),
            (502, &json!("device")),
            "{answer}"
        );
        assert_eq!(shoot(&other).0, 200);
        wait_for("the device is not opened again", || {
            devices()[0]["phase"] == "idle"
        });
        assert!(devices()[0]["reconnects"].as_u64().unwrap() >= round);
        assert_eq!(devices()[0]["in_use"], false);
        assert_eq!(devices()[1]["reconnects"], 0);
    }
    let (status, answer) = shoot("synthetic:elsewhere");
    assert_eq!(status, 400, "{answer}");
}

#[test]
fn a_daemon_killed_at_any_moment_of_a_shot_keeps_what_it_acknowledged() {
    let mut daemon = Daemon::start("synthetic:desk");
    let mut acknowledged = Vec::new();
    // Spread over the time of a shot, which the first one tells.
    let began = Instant::now();
    let (_, answer) = daemon.send("POST", "/v1/shots", RELIGHT);
    acknowledged.push(answer["id"].as_str().unwrap().to_owned());
    let whole = began.elapsed();
    for part in 1..=6 {
        let mut stream = daemon.connect();
        let request = Daemon::request("POST", "/v1/shots", RELIGHT);
        stream.write_all(request.as_bytes()).unwrap();
        std::thread::sleep(whole * part / 6);
        daemon.end_by("KILL");
        let mut text = String::new();
        drop(stream.read_to_string(&mut text));
        if let Some((head, body)) = text.split_once("\r\n\r\n")
            && head.starts_with("HTTP/1.1 200")
            && let Ok(reply) = serde_json::from_str::<Value>(body)
        {
            acknowledged.push(reply["id"].as_str().unwrap().to_owned());
        }
        daemon.restart();
        let (code, text, err) = daemon.capturectl(&["--json", "fsck", "state"]);
        assert_eq!(code, Some(0), "{err}");
        let found: Value = serde_json::from_str(&text).unwrap();
        let whole = |id: &String| {
            let mut found = found["found"].as_array().unwrap().iter();
            found.any(|one| one["name"] == id.as_str() && one["condition"] == "whole")
        };
        assert!(acknowledged.iter().all(whole), "{acknowledged:?} {found}");
    }
}

#[test]
fn another_user_may_look_and_neither_shoot_nor_delete() {
    let daemon = Daemon::start("synthetic:desk");
    let (_, answer) = daemon.send("POST", "/v1/shots", "{}");
    let id = answer["id"].as_str().unwrap();
    // For everybody, as an owner might.
    let open = |path: &std::path::Path, mode| {
        use std::os::unix::fs::PermissionsExt as _;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    };
    open(&daemon.socket(), 0o666);
    open(daemon.folder.path(), 0o755);
    let theirs = daemon.folder.path().join("theirs");
    std::fs::create_dir(&theirs).unwrap();
    open(&theirs, 0o777);
    let as_other = |arguments: &[&str]| {
        let output = Command::new("setpriv")
            .args(["--reuid=4242", "--regid=4242", "--clear-groups"])
            .args([env!("CARGO_BIN_EXE_capturectl"), "--json"])
            .args(arguments)
            .current_dir(&theirs)
            .env("XDG_RUNTIME_DIR", daemon.folder.path())
            .output();
        let said = output.map_or_else(|error| error.to_string().into_bytes(), |found| found.stdout);
        serde_json::from_slice::<Value>(&said).unwrap_or_default()
    };
    let status = as_other(&["status"]);
    if status["role"] != "look" {
        eprintln!(
            "SKIPPED: nothing could be asked as another user (needs root, setpriv and a build that others may read): {status}"
        );
        return;
    }
    assert_eq!(as_other(&["shots"])["shots"][0]["id"], id);
    for refused in [
        &["shoot", "--out", "shot"][..],
        &["shots", "--delete", id],
        &["viewer"],
    ] {
        let said = as_other(refused)["error"]["message"].to_string();
        assert!(said.contains("uid 4242 may look"), "{refused:?}: {said}");
    }
    assert!(daemon.folder.path().join("state/shots").join(id).exists());
}

#[test]
fn memory_of_an_idle_daemon_is_small() {
    let daemon = Daemon::start("synthetic:desk");
    assert_eq!(daemon.send("GET", "/v1/status", "").0, 200);
    let resident = daemon.resident_bytes() as f64 / f64::from(1 << 20);
    eprintln!("figure | memory of an idle daemon | {resident:.1} MiB");
    assert!(resident < 64.0, "{resident} MiB");
}
