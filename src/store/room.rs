//! Room for one more shot: asked for before the flash fires.

use super::{Store, StoreError};
use crate::{config::Shots, output::FileSystem};
use std::{io, path::Path, sync::atomic::Ordering};

/// What a shot is expected to take before one was seen, bytes.
const USUAL_SHOT: u64 = 64 << 20;

impl Store {
    /// Whether one more shot as large as the largest has room.
    ///
    /// # Errors
    /// [`StoreError::Quota`] and [`StoreError::Space`] when it has not, [`StoreError::Read`] when the
    /// disk does not say.
    pub fn reserve(&self, limits: &Shots) -> Result<(), StoreError> {
        let needed = match self.largest.load(Ordering::Relaxed) {
            0 => USUAL_SHOT,
            largest => largest,
        };
        let used = self.used_bytes();
        if let Some(quota) = limits.quota_bytes
            && used.saturating_add(needed) > quota
        {
            return Err(StoreError::Quota {
                used,
                needed,
                quota,
            });
        }
        let path = self.folder.clone();
        let kept = limits.keep_free_bytes;
        match self.disk.free_bytes(&path) {
            Ok(free) if free < needed.saturating_add(kept) => Err(StoreError::Space {
                path,
                free,
                needed,
                kept,
            }),
            Ok(_) => Ok(()),
            Err(source) => Err(StoreError::Read { path, source }),
        }
    }

    /// Counts a shot that was committed, and deletes the oldest where the owner asks for it; returns
    /// the names of those that went.
    ///
    /// # Errors
    /// [`StoreError`] of the shot that cannot be deleted, or when the folder cannot be read.
    pub fn count(&self, id: &str, limits: &Shots) -> Result<Vec<String>, StoreError> {
        let bytes = bytes_of(&*self.disk, &self.folder.join(id)).unwrap_or(0);
        self.used.fetch_add(bytes, Ordering::Relaxed);
        self.largest.fetch_max(bytes, Ordering::Relaxed);
        self.retain(limits)
    }

    /// Deletes the oldest shots where the owner asks for it; returns their names.
    ///
    /// # Errors
    /// As [`Self::count`].
    pub fn retain(&self, limits: &Shots) -> Result<Vec<String>, StoreError> {
        let Some(keep) = limits.keep_newest else {
            return Ok(Vec::new());
        };
        let mut ids = self.ids()?;
        let surplus = ids.split_off(keep.min(ids.len()));
        for id in &surplus {
            self.delete(id)?;
        }
        Ok(surplus)
    }

    pub(super) fn forget(&self, bytes: u64) {
        let less = |used: u64| Some(used.saturating_sub(bytes));
        // The closure always answers.
        let _ = self
            .used
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
    }
}

/// Bytes of the files in a folder.
pub(super) fn bytes_of(disk: &dyn FileSystem, folder: &Path) -> io::Result<u64> {
    let mut sum = 0;
    for name in disk.list(folder)?.unwrap_or_default() {
        sum += disk.open(&folder.join(name))?.0;
    }
    Ok(sum)
}
