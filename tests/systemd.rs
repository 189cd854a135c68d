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
        // Not the name of a group in captured.sysusers: the service would end with 217/USER.
        "User=captured-daemon",
        "ExecStopPost=/usr/bin/capturectl lamps-off",
        "ReadWritePaths=-/sys/class/leds -/sys/devices",
        "MemoryDenyWriteExecute=yes",
        "DevicePolicy=closed",
    ] {
        assert!(settings.contains(&needed), "{needed}");
    }
}

#[test]
fn what_is_installed_is_whole_runs_from_where_the_units_say_and_keeps_the_owners_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let install = || {
        let output = Command::new(env!("CARGO_BIN_EXE_capturectl"))
            .args(["install", "--prefix", "/usr", "--destdir"])
            .arg(root)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
    };
    install();
    for name in [
        "etc/captured/captured.toml",
        "usr/bin/captured",
        "usr/bin/capturectl",
        "usr/lib/systemd/system/captured.service",
        "usr/lib/systemd/system/captured.socket",
        "usr/lib/systemd/system/captured-viewer.socket",
        "usr/lib/sysusers.d/captured.conf",
        "usr/lib/tmpfiles.d/captured.conf",
        "usr/lib/udev/rules.d/60-captured.rules",
        "usr/share/bash-completion/completions/capturectl",
        "usr/share/captured/captured.toml",
        "usr/share/man/man1/capturectl.1",
    ] {
        let length = std::fs::metadata(root.join(name)).expect(name).len();
        assert!(length > 0, "{name} is empty");
    }
    // Every program that a unit starts is there and runs.
    let units = root.join("usr/lib/systemd/system");
    let service = std::fs::read_to_string(units.join("captured.service")).unwrap();
    let programs: Vec<&str> = service
        .lines()
        .filter_map(|line| line.strip_prefix("Exec")?.split_once('='))
        .filter_map(|(_, command)| command.split(' ').next())
        .filter(|program| program.contains("captur"))
        .collect();
    assert!(programs.len() >= 2, "{service}");
    for program in programs {
        let found = root.join(program.trim_start_matches('/'));
        let ran = Command::new(&found)
            .arg("--version")
            .output()
            .expect(program);
        assert!(ran.status.success(), "{program}");
    }
    for unit in [
        "captured.service",
        "captured.socket",
        "captured-viewer.socket",
    ] {
        let path = units.join(unit);
        if let Some(text) = analyze(&["verify", "--man=no", path.to_str().unwrap()]) {
            let complaints = text
                .lines()
                .filter(|line| line.contains("captured") && !line.contains("is not executable"));
            assert_eq!(complaints.count(), 0, "{text}");
        }
    }
    // Once more, over what runs: what the owner changed stays.
    let config = root.join("etc/captured/captured.toml");
    std::fs::write(&config, "[limits]\nlights = 3\n").unwrap();
    install();
    assert_eq!(
        std::fs::read_to_string(&config).unwrap(),
        "[limits]\nlights = 3\n"
    );
    let left: Vec<_> = std::fs::read_dir(root.join("usr/bin"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(left.len(), 2, "{left:?}");
}
