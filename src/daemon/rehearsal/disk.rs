//! A disk that fills up. Its syncs do nothing: power is not lost here, and months of them would take days.

use crate::output::{Disk, FileSystem, NewFile};
use std::{
    io::{self, Read, Write},
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
};

/// The real file system, with so many bytes left.
pub(super) struct Filling {
    left: AtomicU64,
    /// What it says is free, where that is not so.
    claims: AtomicU64,
}

impl Filling {
    pub const ROOMY: u64 = 1 << 40;

    pub fn new() -> Self {
        Self {
            left: AtomicU64::new(Self::ROOMY),
            claims: AtomicU64::new(Self::ROOMY),
        }
    }

    /// Leaves room for so many bytes; it says that `claims` are free.
    pub fn leave(&self, left: u64, claims: u64) {
        self.left.store(left, Ordering::SeqCst);
        self.claims.store(claims, Ordering::SeqCst);
    }

    fn take(&self, bytes: u64) -> io::Result<()> {
        let less = |left: u64| left.checked_sub(bytes);
        self.left
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, less)
            .map(drop)
            .map_err(|_| io::Error::from(io::ErrorKind::StorageFull))
    }
}

struct Writing<'a>(&'a Filling, Box<dyn NewFile + 'a>);

impl Write for Writing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.take(bytes.len() as u64)?;
        self.1.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.1.flush()
    }
}

impl NewFile for Writing<'_> {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl FileSystem for Filling {
    fn create_dir(&self, dir: &Path) -> io::Result<()> {
        Disk.create_dir(dir)
    }
    fn create_file<'a>(&'a self, file: &Path) -> io::Result<Box<dyn NewFile + 'a>> {
        Ok(Box::new(Writing(self, Disk.create_file(file)?)))
    }
    fn open<'a>(&'a self, file: &Path) -> io::Result<(u64, Box<dyn Read + 'a>)> {
        Disk.open(file)
    }
    fn sync_file(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }
    fn sync_dir(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }
    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        Disk.rename_new(from, to)
    }
    fn rename_over_empty(&self, from: &Path, to: &Path) -> io::Result<()> {
        Disk.rename_over_empty(from, to)
    }
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        Disk.exchange(one, other)
    }
    fn remove(&self, dir: &Path) -> io::Result<()> {
        Disk.remove(dir)
    }
    fn remove_file(&self, file: &Path) -> io::Result<()> {
        Disk.remove_file(file)
    }
    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>> {
        Disk.list(dir)
    }
    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        Ok(self.claims.load(Ordering::SeqCst))
    }
}
