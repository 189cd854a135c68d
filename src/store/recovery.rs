//! What an earlier process left unfinished.

use super::naming::{DELETED, unfinished_id};
use crate::output::{
    FRAMES, FileEntry, FileSystem, JOURNAL, Manifest, UNFINISHED, manifest::MANIFEST,
};
use serde::Serialize;
use std::{
    io::{self, Read as _},
    path::Path,
};

/// Far more than the journal of any shot needs, bytes.
const LARGEST_JOURNAL: u64 = 4 << 20;

/// One thing that was found when a store was opened.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "what")]
pub enum Recovered {
    /// A shot that was whole but had not got its name yet; it has it now.
    Finished {
        /// The shot.
        id: String,
    },
    /// A shot whose writing was cut short; those of its files that are whole are kept.
    Salvaged {
        /// The shot.
        id: String,
        /// How many files are whole.
        whole: usize,
    },
    /// Something unfinished whose frames are not whole; it stays where it is.
    Unfinished {
        /// The hidden folder.
        name: String,
    },
    /// A shot whose deletion was cut short; it is gone now.
    Deleted {
        /// The shot.
        id: String,
    },
}

/// Looks through everything unfinished in `folder`.
pub(super) fn recover(disk: &dyn FileSystem, folder: &Path) -> io::Result<Vec<Recovered>> {
    let mut names = disk.list(folder)?.unwrap_or_default();
    names.sort_unstable();
    // A process that was killed between a rename and its sync acknowledged nothing, but showed it.
    disk.sync_dir(folder)?;
    let mut recovered = Vec::new();
    for name in names {
        if let Some(id) = name.strip_prefix(DELETED) {
            disk.remove(&folder.join(&name))?;
            recovered.push(Recovered::Deleted { id: id.to_owned() });
        } else if let Some(id) = name.strip_prefix(UNFINISHED).and_then(unfinished_id) {
            recovered.push(unfinished(disk, folder, &name, id)?);
        }
    }
    Ok(recovered)
}

/// Finishes, salvages or leaves one unfinished shot.
fn unfinished(disk: &dyn FileSystem, folder: &Path, name: &str, id: &str) -> io::Result<Recovered> {
    let partial = folder.join(name);
    let left = || Recovered::Unfinished {
        name: name.to_owned(),
    };
    if disk.list(&folder.join(id))?.is_some() {
        return Ok(left());
    }
    let whole = Manifest::read(disk, &partial)
        .ok()
        .filter(|manifest| manifest.verify_files(disk, &partial).is_ok());
    if let Some(manifest) = whole {
        name_it(disk, folder, name, id, &manifest.files)?;
        return Ok(Recovered::Finished { id: id.to_owned() });
    }
    let files = whole_files(disk, &partial)?;
    if !files.iter().any(|file| file.name == FRAMES) {
        return Ok(left());
    }
    let count = files.len();
    put_aside(disk, &partial)?;
    let (manifest, bytes) = salvaged(files).seal().map_err(io::Error::from)?;
    disk.write_new(&partial.join(MANIFEST), &bytes)?;
    disk.sync_dir(&partial)?;
    name_it(disk, folder, name, id, &manifest.files)?;
    Ok(Recovered::Salvaged {
        id: id.to_owned(),
        whole: count,
    })
}

/// Gives a folder whose files were found whole its name. They may be whole in memory alone: where a
/// process was killed, what it wrote waits for the disk.
fn name_it(
    disk: &dyn FileSystem,
    folder: &Path,
    name: &str,
    id: &str,
    files: &[FileEntry],
) -> io::Result<()> {
    let partial = folder.join(name);
    for file in files
        .iter()
        .map(|file| file.name.as_str())
        .chain([MANIFEST])
    {
        disk.sync_file(&partial.join(file))?;
    }
    disk.sync_dir(&partial)?;
    match disk.remove_file(&partial.join(JOURNAL)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => disk.sync_dir(&partial)?,
    }
    disk.rename_new(&partial, &folder.join(id))?;
    disk.sync_dir(folder)
}

/// The files that are as the journal states them.
fn whole_files(disk: &dyn FileSystem, partial: &Path) -> io::Result<Vec<FileEntry>> {
    let mut journal = Vec::new();
    match disk.open(&partial.join(JOURNAL)) {
        Ok((_, file)) => file.take(LARGEST_JOURNAL).read_to_end(&mut journal)?,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let mut files: Vec<FileEntry> = Vec::new();
    for line in journal.split(|byte| *byte == b'\n') {
        // The last line may be cut, and after a loss of power any may be.
        let Ok(entry) = serde_json::from_slice::<FileEntry>(line) else {
            continue;
        };
        let inside = Path::new(&entry.name)
            .file_name()
            .is_some_and(|name| name == entry.name.as_str());
        let known = files.iter().any(|file| file.name == entry.name);
        if inside
            && !known
            && entry.name != MANIFEST
            && entry.is_whole(disk, partial).unwrap_or(false)
        {
            files.push(entry);
        }
    }
    Ok(files)
}

/// Moves a manifest that is none out of the way.
fn put_aside(disk: &dyn FileSystem, partial: &Path) -> io::Result<()> {
    let names = disk.list(partial)?.unwrap_or_default();
    if !names.iter().any(|name| name == MANIFEST) {
        return Ok(());
    }
    let free = (1..)
        .map(|number| format!("{MANIFEST}.torn-{number}"))
        .find(|name| !names.contains(name));
    // The numbers do not end.
    let Some(free) = free else { return Ok(()) };
    disk.rename_new(&partial.join(MANIFEST), &partial.join(free))
}

/// The manifest of a shot of which only `files` are left.
fn salvaged(files: Vec<FileEntry>) -> Manifest {
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    let warning = format!(
        "this shot was cut short while it was written; of its files these are whole: {}; develop it again with `capturectl relight {FRAMES}`",
        names.join(", ")
    );
    Manifest {
        format: 1,
        program: concat!("captured ", env!("CARGO_PKG_VERSION")).to_owned(),
        source: "salvaged".to_owned(),
        width: 0,
        height: 0,
        scale_known: false,
        png_white: 1.0,
        timings_ms: Vec::new(),
        report: serde_json::json!({ "salvaged": true }),
        lights: Vec::new(),
        warnings: vec![warning],
        files,
        blake3: String::new(),
    }
}
