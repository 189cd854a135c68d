//! The units: what systemd itself says of them.

use std::process::Command;

/// Highest exposure that `systemd-analyze security` may find, of 10.
const EXPOSURE: f64 = 0.6;

/// Runs `systemd-analyze` in the folder of the units; `None`, and a reason on standard error, without it.
fn analyze(arguments: &[&str]) -> Option<String> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/systemd");
    let Ok(output) = Command::new("systemd-analyze")
        .args(arguments)
        .current_dir(folder)
        .output()
    else {
        eprintln!(
            "SKIPPED: the units were not judged, for want of systemd-analyze (apt-get install systemd)"
        );
        return None;
    };
    let text = [output.stdout, output.stderr].concat();
    Some(String::from_utf8_lossy(&text).into_owned())
}

#[test]
fn the_service_is_exposed_to_almost_nothing() {
    let Some(text) = analyze(&[
        "security",
        "--offline=true",
        "--no-pager",
        "captured.service",
    ]) else {
        return;
    };
    let Some(found) = text
        .split("Overall exposure level for captured.service: ")
        .nth(1)
    else {
        eprintln!("SKIPPED: this systemd-analyze scores no file: {text}");
        return;
    };
    let score: f64 = found.split(' ').next().unwrap().parse().unwrap();
    eprintln!("figure | systemd-analyze security, offline | {score} of 10");
    assert!(score <= EXPOSURE, "{text}");
}

#[test]
fn every_unit_is_understood_by_systemd() {
    for unit in [
        "captured.service",
        "captured.socket",
        "captured-viewer.socket",
    ] {
        let Some(text) = analyze(&["verify", "--man=no", unit]) else {
            return;
        };
        let complaints: Vec<&str> = text
            .lines()
            // The program is not installed where the tests run.
            .filter(|line| line.contains("captured") && !line.contains("is not executable"))
            .collect();
        assert!(complaints.is_empty(), "{complaints:?}");
    }
}

#[test]
fn nothing_in_the_service_makes_every_caller_look_the_same_or_hides_the_lamps() {
    let service = include_str!("../systemd/captured.service");
    let settings: Vec<&str> = service
        .lines()
        .filter(|line| !line.starts_with('#'))
        .collect();
    // With it every peer has uid 65534.
    assert!(
        !settings
            .iter()
            .any(|line| line.starts_with("PrivateUsers="))
    );
    for needed in [
        "Type=notify",
        "ExecStopPost=/usr/bin/capturectl lamps-off",
        "ReadWritePaths=-/sys/class/leds -/sys/devices",
        "MemoryDenyWriteExecute=yes",
        "DevicePolicy=closed",
    ] {
        assert!(settings.contains(&needed), "{needed}");
    }
}
