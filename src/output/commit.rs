//! A folder appears whole or not at all: written under a hidden name, synced, renamed, synced.
//!
//! The file system stands behind [`FileSystem`], so that the same code runs on the real one and on
//! ones that fail.

use serde::{Deserialize, Serialize};
use std::{
    io,
    path::{Path, PathBuf},
};
use thiserror::Error;

/// What the commit asks of a file system.
pub trait FileSystem {
    /// Creates a folder; an error of kind `AlreadyExists` when the name is taken.
    ///
    /// # Errors
    /// What the operating system says.
    fn create_dir(&self, dir: &Path) -> io::Result<()>;

    /// Creates a file that was not there, writes all of `bytes` and syncs it.
    ///
    /// # Errors
    /// What the operating system says; a failed sync is final.
    fn write_new(&self, file: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Syncs a folder's entries.
    ///
    /// # Errors
    /// What the operating system says.
    fn sync_dir(&self, dir: &Path) -> io::Result<()>;

    /// Renames a folder or file to a name that is free; `AlreadyExists` when it is not.
    ///
    /// # Errors
    /// What the operating system says.
    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Renames a folder over an empty one.
    ///
    /// # Errors
    /// What the operating system says; an error when `to` is not empty.
    fn rename_over_empty(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Exchanges two folders in one step.
    ///
    /// # Errors
    /// What the operating system says.
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()>;

    /// Removes a folder and all in it.
    ///
    /// # Errors
    /// What the operating system says.
    fn remove(&self, dir: &Path) -> io::Result<()>;

    /// File names in a folder; `None` when it does not exist.
    ///
    /// # Errors
    /// What the operating system says, also for a name that is not a folder.
    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>>;
}

/// The real file system.
#[derive(Debug, Clone, Copy, Default)]
pub struct Disk;

impl FileSystem for Disk {
    fn create_dir(&self, dir: &Path) -> io::Result<()> {
        std::fs::create_dir(dir)
    }

    fn write_new(&self, file: &Path, bytes: &[u8]) -> io::Result<()> {
        use std::io::Write as _;
        let mut file = std::fs::File::create_new(file)?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    fn sync_dir(&self, dir: &Path) -> io::Result<()> {
        std::fs::File::open(dir)?.sync_all()
    }

    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        use rustix::{fs::RenameFlags, io::Errno};
        let cwd = rustix::fs::CWD;
        match rustix::fs::renameat_with(cwd, from, cwd, to, RenameFlags::NOREPLACE) {
            // Not every file system knows the flag; claiming the name first is as exclusive.
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {
                if from.is_dir() {
                    std::fs::create_dir(to)?;
                } else {
                    std::fs::File::create_new(to)?;
                }
                std::fs::rename(from, to)
            }
            other => other.map_err(io::Error::from),
        }
    }

    fn rename_over_empty(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        let cwd = rustix::fs::CWD;
        rustix::fs::renameat_with(cwd, one, cwd, other, rustix::fs::RenameFlags::EXCHANGE)
            .map_err(io::Error::from)
    }

    fn remove(&self, dir: &Path) -> io::Result<()> {
        std::fs::remove_dir_all(dir)
    }

    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>> {
        let entries = match std::fs::read_dir(dir) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error),
        };
        let name = |entry: io::Result<std::fs::DirEntry>| {
            Ok(entry?.file_name().to_string_lossy().into_owned())
        };
        entries.map(name).collect::<io::Result<_>>().map(Some)
    }
}

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
            let partial = parent.join(format!(".partial-{name}-{process}-{attempt}"));
            match disk.create_dir(&partial) {
                Ok(()) => {
                    return Ok(Self {
                        disk,
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
        self.disk
            .write_new(&self.partial.join(name), bytes)
            .map_err(|source| CommitError::unwritten(&self.target.join(name), source))?;
        self.files.push(FileEntry {
            name: name.into(),
            bytes: bytes.len() as u64,
            blake3: blake3::hash(bytes).to_hex().to_string(),
        });
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
