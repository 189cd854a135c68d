//! A folder appears whole or not at all: written under a hidden name, synced, renamed, synced.
//!
//! The file system stands behind [`FileSystem`], so that the same code runs on the real one and on
//! ones that fail. While the folder is unfinished a journal in it says which of its files are whole,
//! so that a process that was killed loses none of them (see [`crate::store`]).

use super::file_system::{FileSystem, NewFile};
use serde::{Deserialize, Serialize};
use std::{
    io::{self, Write as _},
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Why a folder was not written; nothing of it is left behind.
#[derive(Debug, Error)]
pub enum CommitError {
    /// The name is taken by something that must not be lost.
    #[error(
        "{path}: already exists and is not empty; choose another folder, or replace earlier results with --force"
    )]
    Exists {
        /// The folder asked for.
        path: PathBuf,
    },
    /// A file stands where a new one is to go.
    #[error("{path}: exists already; choose another name, or move it away")]
    Taken {
        /// The file in the way.
        path: PathBuf,
    },
    /// Force was given, but the folder holds what this program did not write.
    #[error(
        "{path}: holds {foreign:?}, which is no result of ours, so it is not replaced; choose another folder"
    )]
    Foreign {
        /// The folder asked for.
        path: PathBuf,
        /// One of the files in the way.
        foreign: String,
    },
    /// The path has no last name, as `/` and `..` have none.
    #[error("{path}: is no name for a new file or folder; give one, such as results")]
    Name {
        /// The folder asked for.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error(
        "{path}: cannot {action}: {source}; check its permissions and free space, or choose another folder"
    )]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The cause.
        source: io::Error,
    },
}

impl CommitError {
    /// For contents that could not be written.
    pub fn unwritten(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            action: "write it",
            source,
        }
    }
}

/// What to do with a folder that stands where the new one goes; an empty one never matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Keep it and say so.
    Refuse,
    /// Replace it, if every file in it passes [`Staging::begin`]'s test.
    Replace,
}

/// Where a folder goes.
#[derive(Clone, Copy)]
pub struct Destination<'a> {
    /// On which file system.
    pub disk: &'a dyn FileSystem,
    /// Under which name.
    pub folder: &'a Path,
    /// What happens to a folder of that name.
    pub existing: Existing,
}

/// One file as it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Name within the folder.
    pub name: String,
    /// Size in bytes.
    pub bytes: u64,
    /// BLAKE3 of the contents, hexadecimal.
    pub blake3: String,
}

impl FileEntry {
    /// Whether the file in `dir` is the one that was written.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn is_whole(&self, disk: &dyn FileSystem, dir: &Path) -> io::Result<bool> {
        let (bytes, file) = disk.open(&dir.join(&self.name))?;
        if bytes != self.bytes {
            return Ok(false);
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(file)?;
        Ok(hasher.finalize().to_hex().as_str() == self.blake3)
    }
}

/// Name of the journal in an unfinished folder: one [`FileEntry`] as JSON per line.
pub const JOURNAL: &str = ".files";
/// What the name of an unfinished folder begins with.
pub const UNFINISHED: &str = ".partial-";

/// How the finished folder gets its name.
#[derive(Debug, Clone, Copy)]
enum Arrival {
    Free,
    OverEmpty,
    Exchange,
}

/// A folder being written; dropping it before [`Staging::commit`] removes every trace.
pub struct Staging<'a> {
    disk: &'a dyn FileSystem,
    journal: Option<Box<dyn NewFile + 'a>>,
    partial: PathBuf,
    parent: PathBuf,
    target: PathBuf,
    arrival: Arrival,
    files: Vec<FileEntry>,
    folders: Vec<PathBuf>,
    finished: bool,
}

impl<'a> Staging<'a> {
    /// Opens a hidden folder beside `target`, on the same file system.
    ///
    /// With [`Existing::Replace`], a folder in the way is replaced only if `ours` holds for each of
    /// its file names: a wrong `--out` must not cost anyone a home directory.
    ///
    /// # Errors
    /// [`CommitError::Exists`], [`CommitError::Foreign`] and [`CommitError::Name`] as said there;
    /// [`CommitError::Io`] where the parent is missing or not writable.
    pub fn begin(
        disk: &'a dyn FileSystem,
        target: &Path,
        existing: Existing,
        ours: impl Fn(&str) -> bool,
    ) -> Result<Self, CommitError> {
        let nameless = || CommitError::Name {
            path: target.into(),
        };
        // A link to a folder is followed, so that what it points to is replaced, not the link.
        let resolved = target.canonicalize().unwrap_or_else(|_| target.into());
        let name = resolved
            .file_name()
            .ok_or_else(nameless)?
            .to_string_lossy()
            .into_owned();
        let parent = match resolved.parent() {
            Some(parent) if parent.as_os_str().is_empty() => PathBuf::from("."),
            Some(parent) => parent.to_path_buf(),
            None => return Err(nameless()),
        };
        let look = |source| CommitError::Io {
            path: target.into(),
            action: "look inside",
            source,
        };
        let arrival = match disk.list(&resolved).map_err(look)? {
            None => Arrival::Free,
            Some(names) if names.is_empty() => Arrival::OverEmpty,
            Some(_) if existing == Existing::Refuse => {
                return Err(CommitError::Exists {
                    path: target.into(),
                });
            }
            Some(names) => match names.into_iter().find(|name| !ours(name)) {
                Some(foreign) => {
                    return Err(CommitError::Foreign {
                        path: target.into(),
                        foreign,
                    });
                }
                None => Arrival::Exchange,
            },
        };
        let process = std::process::id();
        for attempt in 0..1000 {
            let partial = parent.join(format!("{UNFINISHED}{name}-{process}-{attempt}"));
            match disk.create_dir(&partial) {
                Ok(()) => {
                    return Ok(Self {
                        disk,
                        journal: None,
                        partial,
                        parent,
                        target: resolved,
                        arrival,
                        files: Vec::new(),
                        folders: Vec::new(),
                        finished: false,
                    });
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(source) => {
                    let action = "create a folder beside it";
                    return Err(CommitError::Io {
                        path: target.into(),
                        action,
                        source,
                    });
                }
            }
        }
        Err(CommitError::Io {
            path: parent,
            action: "find a free .partial- name in it",
            source: io::ErrorKind::AlreadyExists.into(),
        })
    }

    /// Keeps a journal beside the files until the folder has its name, for a folder that is to be
    /// salvaged file by file.
    ///
    /// It is not synced: after a loss of power fewer files are known to be whole, never more.
    ///
    /// # Errors
    /// [`CommitError::Io`] when it cannot be created.
    pub fn journaled(mut self) -> Result<Self, CommitError> {
        let journal = self.disk.create_file(&self.partial.join(JOURNAL));
        let unwritten = |source| CommitError::unwritten(&self.target.join(JOURNAL), source);
        self.journal = Some(journal.map_err(unwritten)?);
        Ok(self)
    }

    /// Makes a folder inside, for files named `folder/file`.
    ///
    /// # Errors
    /// [`CommitError::Io`] naming the folder as it would have been called.
    pub fn folder(&mut self, name: &str) -> Result<(), CommitError> {
        let folder = self.partial.join(name);
        self.disk
            .create_dir(&folder)
            .map_err(|source| CommitError::unwritten(&self.target.join(name), source))?;
        self.folders.push(folder);
        Ok(())
    }

    /// Writes and syncs one file.
    ///
    /// # Errors
    /// [`CommitError::Io`] naming the file as it would have been called.
    pub fn put(&mut self, name: &str, bytes: &[u8]) -> Result<(), CommitError> {
        let unwritten = |source| CommitError::unwritten(&self.target.join(name), source);
        self.disk
            .write_new(&self.partial.join(name), bytes)
            .map_err(unwritten)?;
        let entry = FileEntry {
            name: name.into(),
            bytes: bytes.len() as u64,
            blake3: blake3::hash(bytes).to_hex().to_string(),
        };
        if let Some(journal) = &mut self.journal {
            let line = serde_json::to_string(&entry).map_err(io::Error::from);
            line.and_then(|line| journal.write_all(format!("{line}\n").as_bytes()))
                .map_err(unwritten)?;
        }
        self.files.push(entry);
        Ok(())
    }

    /// What was written so far, in order.
    pub fn files(&self) -> &[FileEntry] {
        &self.files
    }

    /// Gives the folder its name; when this returns, it is there and stays there.
    ///
    /// # Errors
    /// [`CommitError::Exists`] when the name was taken meanwhile; [`CommitError::Io`] otherwise.
    pub fn commit(mut self) -> Result<(), CommitError> {
        let path = self.target.clone();
        let io = |action| {
            let path = path.clone();
            move |source: io::Error| match source.kind() {
                io::ErrorKind::AlreadyExists | io::ErrorKind::DirectoryNotEmpty => {
                    CommitError::Exists { path }
                }
                _ => CommitError::Io {
                    path,
                    action,
                    source,
                },
            }
        };
        if self.journal.take().is_some() {
            let journal = self.partial.join(JOURNAL);
            self.disk
                .remove_file(&journal)
                .map_err(io("take the journal out of it"))?;
        }
        for folder in self.folders.iter().chain([&self.partial]) {
            self.disk.sync_dir(folder).map_err(io("sync its entries"))?;
        }
        match self.arrival {
            Arrival::Free => self.disk.rename_new(&self.partial, &self.target),
            Arrival::OverEmpty => self.disk.rename_over_empty(&self.partial, &self.target),
            Arrival::Exchange => self.disk.exchange(&self.partial, &self.target),
        }
        .map_err(io("give it its name"))?;
        self.finished = !matches!(self.arrival, Arrival::Exchange);
        self.disk
            .sync_dir(&self.parent)
            .map_err(io("sync the folder above it"))
    }
}

impl Drop for Staging<'_> {
    fn drop(&mut self) {
        if !self.finished {
            // What stands under the partial name now is unfinished, or was replaced.
            let _ = self.disk.remove(&self.partial);
        }
    }
}
