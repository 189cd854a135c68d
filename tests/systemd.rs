//! The units: what systemd itself says of them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    process::Command,
};

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

/// Every file below a folder by its path there, with its mode.
fn files(folder: &Path) -> BTreeMap<PathBuf, u32> {
    use std::os::unix::fs::PermissionsExt as _;
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in std::fs::read_dir(inner).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let mode = std::fs::metadata(&path).unwrap().permissions().mode() & 0o777;
                found.insert(path.strip_prefix(folder).unwrap().to_owned(), mode);
            }
        }
    }
    found
}

/// The files of an asset's pattern: of its folder, those that end as it says.
fn matching(pattern: &Path) -> Vec<PathBuf> {
    let name = pattern.file_name().unwrap().to_str().unwrap();
    let Some(ending) = name.strip_prefix('*') else {
        return vec![pattern.to_owned()];
    };
    let entries = std::fs::read_dir(pattern.parent().unwrap()).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    paths
        .filter(|path| path.to_str().unwrap().ends_with(ending))
        .collect()
}

#[test]
fn the_debian_package_holds_what_install_puts_in_place() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    let deb = &manifest["package"]["metadata"]["deb"];
    let text = |value: &toml::Value| value.as_str().unwrap().to_owned();

    let placed = tempfile::tempdir().unwrap();
    let installed = Command::new(env!("CARGO_BIN_EXE_capturectl"))
        .args(["install", "--prefix", "/usr", "--destdir"])
        .arg(placed.path())
        .output()
        .unwrap();
    assert!(installed.status.success(), "{installed:?}");
    let installed = files(placed.path());

    let mut packed = BTreeMap::new();
    for asset in deb["assets"].as_array().unwrap() {
        let [from, to, mode] = [0, 1, 2].map(|at| text(&asset[at]));
        // Programs are those of this build, and what the program writes is what it wrote here.
        let program = from.strip_prefix("target/release/");
        let source = match (program, from.strip_prefix("target/package/")) {
            (Some(program), _) => placed.path().join("usr/bin").join(program),
            (_, Some(written)) => placed.path().join(written),
            _ => root.join(&from),
        };
        let sources = matching(&source);
        assert!(!sources.is_empty(), "nothing is {from}");
        for source in sources {
            let target = match to.strip_suffix('/') {
                Some(folder) => Path::new(folder).join(source.file_name().unwrap()),
                None => PathBuf::from(&to),
            };
            let elsewhere = target.to_str().unwrap();
            let elsewhere = elsewhere.replace("zsh/vendor-completions", "zsh/site-functions");
            let twin = placed.path().join(&elsewhere);
            assert!(
                std::fs::read(&source).unwrap() == std::fs::read(&twin).unwrap_or_default(),
                "{from} is not what install writes to {elsewhere}"
            );
            let mode = u32::from_str_radix(&mode, 8).unwrap();
            let twice = packed.insert(PathBuf::from(elsewhere), mode);
            assert_eq!(twice, None, "{target:?} is packed twice");
        }
    }
    assert_eq!(packed, installed);

    // What the owner may change is left alone by an upgrade.
    let kept = deb["conf-files"].as_array().unwrap().iter().map(text);
    let kept: BTreeSet<_> = kept.map(|path| PathBuf::from(&path[1..])).collect();
    let owned = packed.keys().filter(|path| path.starts_with("etc"));
    assert_eq!(kept, owned.cloned().collect());
    // Each unit is started and enabled, or left alone, by what is said of its name.
    let units = deb["systemd-units"].as_array().unwrap();
    let named: BTreeSet<_> = units.iter().map(|unit| text(&unit["unit-name"])).collect();
    let found = packed
        .keys()
        .filter(|path| path.starts_with("usr/lib/systemd"));
    let found = found.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned());
    assert_eq!(named, found.collect());
    let postinst = root.join(text(&deb["maintainer-scripts"])).join("postinst");
    let postinst = std::fs::read_to_string(postinst).unwrap();
    assert!(postinst.lines().any(|line| line == "#DEBHELPER#"));
}
