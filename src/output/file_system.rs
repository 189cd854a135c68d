//! The file system as this program uses it, so that the same code runs on the real one, on one that
//! fails and on a model of one that loses power.

use std::{
    io::{self, Read},
    path::Path,
};

/// A file that is being written.
pub trait NewFile: io::Write {
    /// Brings all that was written onto the disk.
    ///
    /// # Errors
    /// What the operating system says; final for this file.
    fn sync(&mut self) -> io::Result<()>;
}

/// What is asked of a file system.
pub trait FileSystem: Send + Sync {
    /// Creates a folder; an error of kind `AlreadyExists` when the name is taken.
    ///
    /// # Errors
    /// What the operating system says.
    fn create_dir(&self, dir: &Path) -> io::Result<()>;

    /// Creates an empty file that was not there; `AlreadyExists` when the name is taken.
    ///
    /// # Errors
    /// What the operating system says.
    fn create_file<'a>(&'a self, file: &Path) -> io::Result<Box<dyn NewFile + 'a>>;

    /// Opens a file to be read from its beginning, and says how many bytes it has.
    ///
    /// # Errors
    /// What the operating system says.
    fn open<'a>(&'a self, file: &Path) -> io::Result<(u64, Box<dyn Read + 'a>)>;

    /// Brings onto the disk what any process wrote into a file.
    ///
    /// # Errors
    /// What the operating system says.
    fn sync_file(&self, file: &Path) -> io::Result<()>;

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

    /// Removes a file.
    ///
    /// # Errors
    /// What the operating system says.
    fn remove_file(&self, file: &Path) -> io::Result<()>;

    /// File names in a folder; `None` when it does not exist.
    ///
    /// # Errors
    /// What the operating system says, also for a name that is not a folder.
    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>>;

    /// Bytes that may still be written beside `dir`.
    ///
    /// # Errors
    /// What the operating system says.
    fn free_bytes(&self, dir: &Path) -> io::Result<u64>;

    /// Creates a file that was not there, writes all of `bytes` and syncs it.
    ///
    /// # Errors
    /// What the operating system says; a failed sync is final.
    fn write_new(&self, file: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = self.create_file(file)?;
        // Begins again where a signal interrupted it, and goes on where a write was short.
        file.write_all(bytes)?;
        file.sync()
    }
}

/// The real file system.
#[derive(Debug, Clone, Copy, Default)]
pub struct Disk;

impl NewFile for std::fs::File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }
}

impl FileSystem for Disk {
    fn create_dir(&self, dir: &Path) -> io::Result<()> {
        std::fs::create_dir(dir)
    }

    fn create_file<'a>(&'a self, file: &Path) -> io::Result<Box<dyn NewFile + 'a>> {
        Ok(Box::new(std::fs::File::create_new(file)?))
    }

    fn open<'a>(&'a self, file: &Path) -> io::Result<(u64, Box<dyn Read + 'a>)> {
        let file = std::fs::File::open(file)?;
        Ok((file.metadata()?.len(), Box::new(file)))
    }

    fn sync_file(&self, file: &Path) -> io::Result<()> {
        std::fs::File::open(file)?.sync_all()
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

    fn remove_file(&self, file: &Path) -> io::Result<()> {
        std::fs::remove_file(file)
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

    fn free_bytes(&self, dir: &Path) -> io::Result<u64> {
        let found = rustix::fs::statvfs(dir)?;
        Ok(found.f_bavail.saturating_mul(found.f_frsize))
    }
}
