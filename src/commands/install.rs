//! `install`: everything where systemd, udev, `man` and the shells look for it.

use super::{Answer, CommandError, error::ResultError, manual};
use crate::inference::{Manifest, Settings, model_places};
use clap::Args;
use std::{
    io,
    path::{Path, PathBuf},
};

/// Arguments of `install`.
#[derive(Debug, Args)]
pub struct Install {
    /// What the paths begin with.
    #[arg(long, value_name = "DIR", default_value = "/usr/local")]
    prefix: PathBuf,
    /// Put everything under this folder instead of `/`, for whoever builds a package.
    #[arg(long, value_name = "DIR")]
    destdir: Option<PathBuf>,
}

/// Files of the source tree, and where they go under the prefix.
const FILES: [(&str, &str); 6] = [
    (
        "lib/systemd/system/captured.service",
        include_str!("../../systemd/captured.service"),
    ),
    (
        "lib/systemd/system/captured.socket",
        include_str!("../../systemd/captured.socket"),
    ),
    (
        "lib/systemd/system/captured-viewer.socket",
        include_str!("../../systemd/captured-viewer.socket"),
    ),
    (
        "lib/udev/rules.d/60-captured.rules",
        include_str!("../../systemd/60-captured.rules"),
    ),
    (
        "lib/sysusers.d/captured.conf",
        include_str!("../../systemd/captured.sysusers"),
    ),
    (
        "lib/tmpfiles.d/captured.conf",
        include_str!("../../systemd/captured.tmpfiles"),
    ),
];
const CONFIG: &str = include_str!("../../config/captured.toml");

impl Install {
    pub(super) fn run(self) -> Result<Answer, CommandError> {
        let placed = |path: &Path| match &self.destdir {
            None => path.to_owned(),
            Some(dir) => dir.join(path.strip_prefix("/").unwrap_or(path)),
        };
        let prefix = placed(&self.prefix);
        let mut written = Vec::new();
        let mut put = |path: PathBuf, bytes: &[u8], mode: u32| {
            replace(&path, bytes, mode).map_err(|error| unwritten(&path, &error))?;
            written.push(path);
            Ok::<(), CommandError>(())
        };
        for name in ["capturectl", "captured"] {
            let program = std::env::current_exe()
                .map(|own| own.with_file_name(name))
                .and_then(|path| std::fs::read(&path).map_err(|error| with_path(&path, &error)));
            let target = prefix.join("bin").join(name);
            let program = program.map_err(|error| unwritten(&target, &error))?;
            put(target, &program, 0o755)?;
        }
        for (place, text) in FILES {
            let text = text.replace("/usr/bin/", &format!("{}/bin/", self.prefix.display()));
            put(prefix.join(place), text.as_bytes(), 0o644)?;
        }
        let pages = manual::pages().map_err(|error| unwritten(&prefix, &error))?;
        for (place, text) in pages {
            put(prefix.join(place), &text, 0o644)?;
        }
        for (file, bytes) in models()? {
            put(
                prefix.join("share/captured/models").join(file),
                &bytes,
                0o644,
            )?;
        }
        // What the owner changed stays; the defaults stand beside it.
        let config = placed(Path::new("/etc/captured/captured.toml"));
        put(
            prefix.join("share/captured/captured.toml"),
            CONFIG.as_bytes(),
            0o644,
        )?;
        if !config.exists() {
            put(config, CONFIG.as_bytes(), 0o644)?;
        }
        let mut lines: Vec<String> = written
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        lines.push(
            "next: systemd-sysusers && systemd-tmpfiles --create && udevadm control --reload && systemctl daemon-reload && systemctl enable --now captured.socket captured.service; for the page, systemctl enable captured-viewer.socket && systemctl restart captured.service"
                .to_owned(),
        );
        Ok(Answer::new(
            lines.join("\n"),
            &serde_json::json!({ "written": written }),
        ))
    }
}

/// The model files of this program that are found here; those that are missing are no reason to stop.
fn models() -> Result<Vec<(String, Vec<u8>)>, CommandError> {
    let places = model_places(&Settings::default());
    let manifest = Manifest::embedded()?;
    let read = |file: &str| {
        places
            .iter()
            .find_map(|place| std::fs::read(place.join(file)).ok())
    };
    let files = manifest.models().iter().map(|model| model.file.clone());
    Ok(files
        .filter_map(|file| read(&file).map(|bytes| (file, bytes)))
        .collect())
}

/// Writes a file beside the old one and puts it in its place: what runs goes on with the old one.
fn replace(path: &Path, bytes: &[u8], mode: u32) -> io::Result<()> {
    use std::{io::Write as _, os::unix::fs::OpenOptionsExt as _};
    let folder = path.parent().unwrap_or(Path::new("/"));
    std::fs::create_dir_all(folder)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = folder.join(format!(".partial-{name}-{}", std::process::id()));
    let written = std::fs::File::options()
        .write(true)
        .create_new(true)
        .mode(mode)
        .open(&partial)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        // It may never have been created.
        let _ = std::fs::remove_file(&partial);
    }
    written
}

fn with_path(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

fn unwritten(path: &Path, error: &io::Error) -> CommandError {
    ResultError {
        path: path.to_owned(),
        problem: format!("cannot be installed: {error}"),
        remedy: "run as root, or choose another --prefix or --destdir",
    }
    .into()
}
