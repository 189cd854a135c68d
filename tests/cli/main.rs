//! `capturectl` as its users meet it: a process with arguments, files and an exit code.

mod answers;
mod bad_input;
mod capture;
mod corrupt;
mod film;
mod full_disk;
mod json;
mod lamps;
mod spoiled;
mod sync;
mod report;
mod table;
mod tiers;

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// What one run of `capturectl` left behind.
#[derive(Debug)]
pub struct Ran {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error, with line breaks and frames taken out so that wrapped words are found.
    pub err: String,
}

impl Ran {
    /// The one JSON document on standard output.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {self:#?}"))
    }

    /// Checks a failure: its exit code, the words that must be in its message, and that it is a
    /// message and not a crash.
    #[track_caller]
    pub fn refuses(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, code, "{self:#?}");
        for word in words {
            assert!(self.err.contains(word), "{word:?} is missing in {self:#?}");
        }
        self.does_not_panic();
    }

    /// No panic text, whatever the exit code.
    #[track_caller]
    pub fn does_not_panic(&self) {
        assert!((0..=7).contains(&self.code), "{self:#?}");
        assert!(!self.err.contains("panicked"), "{self:#?}");
        assert!(!self.err.contains("RUST_BACKTRACE"), "{self:#?}");
    }

    /// Checks a success.
    #[track_caller]
    pub fn succeeds(&self) -> &Self {
        assert_eq!(self.code, 0, "{self:#?}");
        self.does_not_panic();
        self
    }
}

/// `capturectl` in `folder`, away from any daemon and configuration of this machine.
fn command(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_capturectl"));
    command
        .current_dir(folder)
        .env("XDG_RUNTIME_DIR", folder)
        .env_remove("RUNTIME_DIRECTORY")
        // What steps cost is measured once for all tests, and not among the user's files.
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .env_remove("CACHE_DIRECTORY")
        .env("COLUMNS", "400");
    command
}

/// Runs `capturectl` in `folder`.
pub fn capturectl<S: AsRef<str>>(folder: &Path, arguments: &[S]) -> Ran {
    let output = command(folder)
        .args(arguments.iter().map(AsRef::as_ref))
        .output()
        .expect("capturectl is built");
    ran(&output)
}

/// What it answered.
fn ran(output: &Output) -> Ran {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let err: String = text(&output.stderr)
        .lines()
        .map(|line| {
            line.trim_start_matches([' ', '│', '×', '⚠', '╰', '▶'])
                .trim_end()
        })
        .collect::<Vec<_>>()
        .join(" ");
    Ran {
        code: output.status.code().unwrap_or(-1),
        out: text(&output.stdout),
        err,
    }
}

/// A bundled recording.
pub fn recording(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/recordings")
        .join(name)
}

/// Everything in a folder, also what is hidden.
pub fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .map(|entries| {
            entries
                .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
                .collect()
        })
        .unwrap_or_default();
    names.sort();
    names
}
