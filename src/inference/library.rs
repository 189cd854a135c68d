//! ONNX Runtime's shared library: where it may be, and whether a file is one, before it is loaded.
//!
//! Loading runs a library's code, and a failed load cannot be tried again in the same process. So a
//! file is read first: an ELF of this processor that exports `OrtGetApiBase`, of a version new enough.

use super::Settings;
use std::{
    fs::{self, File},
    io::Read,
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Oldest version whose interface this program speaks: 1.24.
pub const OLDEST_MINOR: u32 = 24;
/// A library's names and versions stand in its first part; none is longer than this.
const READ: u64 = 64 << 20;
const ENTRY: &[u8] = b"OrtGetApiBase";
/// Every symbol of ONNX Runtime carries its version as `VERS_1.32.0`.
const VERSION: &[u8] = b"VERS_";

/// A file that is no ONNX Runtime for this program.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "{path}: {problem}; give libonnxruntime.so of version 1.24 or newer (`capturectl runtime fetch` says how to get it)"
)]
pub struct LibraryError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: String,
}

/// A library that passed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// The file.
    pub path: PathBuf,
    /// Its version, as its symbols state it.
    pub version: String,
}

/// Why there is none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// The one that was asked for cannot be used.
    Asked(LibraryError),
    /// None was asked for, and none found.
    Nowhere,
}

/// The library to load: the one asked for by the settings, else by `ORT_DYLIB_PATH`, and no other
/// then; else the first usable one of [`places`].
///
/// # Errors
/// [`Refused`].
pub fn find(settings: &Settings) -> Result<Found, Refused> {
    let named = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty());
    if let Some(path) = settings
        .runtime
        .clone()
        .or_else(|| named.map(PathBuf::from))
    {
        return examine(&path).map_err(Refused::Asked);
    }
    let libraries = places()
        .into_iter()
        .flat_map(|folder| libraries_in(&folder));
    let usable = libraries.filter_map(|path| examine(&path).ok()).next();
    usable.ok_or(Refused::Nowhere)
}

/// Folders that are looked through unasked, best first.
pub fn places() -> Vec<PathBuf> {
    let program = std::env::current_exe().ok();
    let installed = program.and_then(|path| Some(path.parent()?.parent()?.join("lib/captured")));
    let triplet = format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    let system = ["/usr/local/lib", &triplet, "/usr/lib64", "/usr/lib"];
    let own = installed.into_iter().chain(fetch_folder());
    own.chain(system.map(PathBuf::from)).collect()
}

/// Where a library for this user alone belongs: `captured/runtime` in the user's data folder.
pub fn fetch_folder() -> Option<PathBuf> {
    let absolute = |name: &str| {
        let path = PathBuf::from(std::env::var_os(name)?);
        path.is_absolute().then_some(path)
    };
    let data =
        absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")))?;
    Some(data.join("captured/runtime"))
}

/// `libonnxruntime.so` and its versions in a folder, longest names first: they name one version,
/// the shorter ones are links.
fn libraries_in(folder: &Path) -> Vec<PathBuf> {
    let names = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = names
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.and_then(|name| name.strip_prefix("libonnxruntime.so"))
                .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        })
        .collect();
    found.sort_by(|a, b| b.cmp(a));
    found
}

/// Reads enough of a file to know whether it is a usable ONNX Runtime, without running any of it.
///
/// # Errors
/// [`LibraryError`], naming the file.
pub fn examine(path: &Path) -> Result<Found, LibraryError> {
    let refused = |problem: String| LibraryError {
        path: path.to_owned(),
        problem,
    };
    let unread = |error: std::io::Error| refused(format!("cannot be read: {error}"));
    // The loader resolves relative names in its own way.
    let path = fs::canonicalize(path).map_err(unread)?;
    let mut bytes = Vec::new();
    let file = File::open(&path).map_err(unread)?;
    file.take(READ).read_to_end(&mut bytes).map_err(unread)?;
    let machine: [u8; 2] = match std::env::consts::ARCH {
        "x86_64" => [62, 0],
        "aarch64" => [183, 0],
        "arm" => [40, 0],
        "riscv64" => [243, 0],
        _ => [0, 0],
    };
    // ELF header: magic, then at 16 the type (3 = shared object), at 18 the machine.
    if bytes.get(..4) != Some(b"\x7fELF") || bytes.get(16..18) != Some(&[3, 0]) {
        return Err(refused("is no shared library".to_owned()));
    }
    if machine != [0, 0] && bytes.get(18..20) != Some(&machine) {
        return Err(refused(format!(
            "is a library for another processor than this {}",
            std::env::consts::ARCH
        )));
    }
    let at = |text: &[u8]| bytes.windows(text.len()).position(|found| found == text);
    if at(ENTRY).is_none() {
        return Err(refused(
            "is a shared library, but not ONNX Runtime (it has no OrtGetApiBase)".to_owned(),
        ));
    }
    let version = at(VERSION).map(|start| {
        let rest = &bytes[start + VERSION.len()..];
        let digits = rest
            .iter()
            .take_while(|b| b.is_ascii_digit() || **b == b'.');
        digits.map(|byte| char::from(*byte)).collect::<String>()
    });
    let Some(version) = version.filter(|version| !version.is_empty()) else {
        return Err(refused(
            "is an ONNX Runtime that states no version".to_owned(),
        ));
    };
    let mut numbers = version.split('.').map(str::parse::<u32>);
    match (numbers.next(), numbers.next()) {
        (Some(Ok(1)), Some(Ok(minor))) if minor >= OLDEST_MINOR => Ok(Found { path, version }),
        _ => Err(refused(format!("is ONNX Runtime {version}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with the marks of a library for this processor.
    fn library(marks: &str) -> tempfile::NamedTempFile {
        let program = fs::read(std::env::current_exe().unwrap()).unwrap();
        let mut bytes = program[..64].to_vec();
        bytes[16] = 3;
        bytes.extend_from_slice(marks.as_bytes());
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), bytes).unwrap();
        file
    }

    #[test]
    fn a_library_is_known_by_its_marks_and_refused_by_what_it_lacks() {
        struct Case(&'static str, Result<&'static str, &'static str>);
        for Case(marks, expected) in [
            Case("OrtGetApiBase\0VERS_1.32.0\0", Ok("1.32.0")),
            Case("OrtGetApiBase\0VERS_1.24.4\0", Ok("1.24.4")),
            Case("OrtGetApiBase\0VERS_1.23.2\0", Err("1.23.2")),
            Case("OrtGetApiBase\0VERS_2.1\0", Err("2.1")),
            Case("OrtGetApiBase\0", Err("no version")),
            Case("VERS_1.32.0\0", Err("OrtGetApiBase")),
        ] {
            let file = library(marks);
            match (examine(file.path()), expected) {
                (Ok(found), Ok(version)) => assert_eq!(found.version, version),
                (Err(error), Err(words)) => {
                    assert!(error.to_string().contains(words), "{error}");
                }
                (found, expected) => panic!("{marks}: {found:?}, not {expected:?}"),
            }
        }
    }

    #[test]
    fn what_is_no_library_of_this_processor_is_refused() {
        let file = library("OrtGetApiBase\0VERS_1.32.0\0");
        let whole = fs::read(file.path()).unwrap();
        let mut foreign = whole.clone();
        foreign[18] ^= 0xff;
        let refused = |bytes: &[u8]| {
            fs::write(file.path(), bytes).unwrap();
            examine(file.path()).unwrap_err().to_string()
        };
        assert!(refused(&foreign).contains("another processor"));
        assert!(refused(b"#!/bin/sh\n").contains("no shared library"));
        assert!(refused(b"").contains("no shared library"));
        let nowhere = examine(Path::new("/nowhere/libonnxruntime.so")).unwrap_err();
        assert!(nowhere.to_string().contains("cannot be read"));
    }
}
