//! The folder in which shots are kept, one folder each: what is in it is whole, and stays.
//!
//! A shot is written under a hidden name and appears by one rename (see
//! [`Staging`](crate::output::Staging)); it goes by one rename to another hidden name. What a killed
//! process or a loss of power left under hidden names is looked through when the store is opened:
//! whole shots get their names, of others the files that are whole are salvaged and marked, the rest
//! stays where it is. Only what somebody asked to delete is deleted.

mod check;
mod naming;
mod recovery;
mod room;

pub use check::{Condition, Finding, check};
pub use recovery::Recovered;

use crate::{
    api::{Fault, FaultKind},
    output::{Disk, FileSystem, Manifest, ManifestError},
};
use naming::{DELETED, is_plain, shortened, time_of};
use std::{
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::{SystemTime, UNIX_EPOCH},
};
use thiserror::Error;

/// Name of the file by whose lock a store belongs to one process.
const LOCK: &str = ".lock";
/// The largest file of a shot that is handed out, bytes.
const LARGEST_FILE: u64 = 1 << 30;

/// Why something is not in the store.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum StoreError {
    #[error(
        "{path}: cannot be used to keep shots: {source}; set `state` in the configuration to a folder that can be written"
    )]
    Folder {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path}: another daemon keeps its shots here; stop it, or set another `state`")]
    Occupied { path: PathBuf },
    #[error("no shot {id:?} with a file {name:?}; ask for a name that the shot's reply lists")]
    Missing { id: String, name: String },
    #[error("no shot {id:?}; `capturectl shots` lists them")]
    NoShot { id: String },
    #[error("{path}: {source}")]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(transparent)]
    Damaged(#[from] ManifestError),
    #[error("{path}: cannot be deleted: {source}")]
    Delete {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(
        "the shots take {used} bytes and one more may take {needed}, but shots.quota_bytes is {quota}; delete shots, or raise it"
    )]
    Quota { used: u64, needed: u64, quota: u64 },
    #[error(
        "{path}: {free} bytes are free and a shot may take {needed}, but shots.keep_free_bytes asks for {kept} to stay; delete something, or lower it"
    )]
    Space {
        path: PathBuf,
        free: u64,
        needed: u64,
        kept: u64,
    },
}

impl StoreError {
    /// For the reply.
    pub fn fault(&self) -> Fault {
        let kind = match self {
            Self::Folder { .. }
            | Self::Occupied { .. }
            | Self::Delete { .. }
            | Self::Quota { .. }
            | Self::Space { .. } => FaultKind::Output,
            Self::Missing { .. } | Self::NoShot { .. } => FaultKind::Request,
            Self::Damaged(_) => FaultKind::Input,
            Self::Read { .. } => FaultKind::Daemon,
        };
        Fault {
            kind,
            message: self.to_string(),
            remedy: None,
        }
    }
}

/// The shots of one daemon.
pub struct Store {
    disk: Arc<dyn FileSystem>,
    folder: PathBuf,
    /// Milliseconds of the newest name given out, so that no name is given twice.
    newest: AtomicU64,
    /// Bytes of all files in the store.
    used: AtomicU64,
    /// Bytes of the largest shot seen.
    largest: AtomicU64,
    /// Held for as long as the store is open.
    _lock: Option<std::fs::File>,
}

impl Store {
    /// Opens the store in `state`, creating the folders, and recovers what an earlier process left
    /// unfinished.
    ///
    /// # Errors
    /// [`StoreError::Folder`] when they cannot be created or recovered, [`StoreError::Occupied`]
    /// when another process has the store open.
    pub fn open(state: &Path) -> Result<(Self, Vec<Recovered>), StoreError> {
        let folder = state.join("shots");
        let unusable = |source| StoreError::Folder {
            path: folder.clone(),
            source,
        };
        std::fs::create_dir_all(&folder).map_err(unusable)?;
        let lock = std::fs::File::create(folder.join(LOCK)).map_err(unusable)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => {
                return Err(StoreError::Occupied { path: folder });
            }
            Err(std::fs::TryLockError::Error(error)) => return Err(unusable(error)),
        }
        let (mut store, recovered) = Self::on(Arc::new(Disk), folder)?;
        store._lock = Some(lock);
        Ok((store, recovered))
    }

    /// Opens the store in `folder` of `disk`, which exists and which nobody else uses, and recovers
    /// what an earlier process left unfinished.
    ///
    /// # Errors
    /// [`StoreError::Folder`] when it cannot be read or recovered.
    pub fn on(
        disk: Arc<dyn FileSystem>,
        folder: PathBuf,
    ) -> Result<(Self, Vec<Recovered>), StoreError> {
        let unusable = |source| StoreError::Folder {
            path: folder.clone(),
            source,
        };
        let recovered = recovery::recover(&*disk, &folder).map_err(unusable)?;
        let names = disk.list(&folder).map_err(unusable)?.unwrap_or_default();
        let newest = names.iter().filter_map(|name| time_of(name)).max();
        let mut used = 0;
        let mut largest = 0;
        for name in names.iter().filter(|name| time_of(name).is_some()) {
            let bytes = room::bytes_of(&*disk, &folder.join(name)).map_err(unusable)?;
            used += bytes;
            largest = largest.max(bytes);
        }
        let store = Self {
            disk,
            folder,
            // A clock that was set back since must not name a shot like an older one.
            newest: AtomicU64::new(newest.unwrap_or(0)),
            used: AtomicU64::new(used),
            largest: AtomicU64::new(largest),
            _lock: None,
        };
        Ok((store, recovered))
    }

    /// Where the shots lie.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Bytes of all files in the store.
    pub fn used_bytes(&self) -> u64 {
        self.used.load(Ordering::Relaxed)
    }

    /// The file system it lies on.
    pub fn disk(&self) -> &dyn FileSystem {
        &*self.disk
    }

    /// A name for a new shot of this date, later than all before it, and the folder it will be.
    pub fn next(&self, date: SystemTime) -> (String, PathBuf) {
        let now = date.duration_since(UNIX_EPOCH).unwrap_or_default();
        let now = u64::try_from(now.as_millis()).unwrap_or(u64::MAX);
        let later = |newest: u64| now.max(newest + 1);
        let before = self
            .newest
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, |newest| {
                Some(later(newest))
            });
        let id = format!("shot-{}", later(before.unwrap_or_else(|newest| newest)));
        let folder = self.folder.join(&id);
        (id, folder)
    }

    /// Names of all shots, newest first.
    ///
    /// # Errors
    /// [`StoreError::Read`] when the folder cannot be read.
    pub fn ids(&self) -> Result<Vec<String>, StoreError> {
        let names = self
            .disk
            .list(&self.folder)
            .map_err(|source| StoreError::Read {
                path: self.folder.clone(),
                source,
            })?;
        let mut ids: Vec<(u64, String)> = names
            .unwrap_or_default()
            .into_iter()
            .filter(|name| !name.starts_with('.'))
            .filter_map(|name| Some((time_of(&name)?, name)))
            .collect();
        ids.sort_unstable_by(|a, b| b.cmp(a));
        Ok(ids.into_iter().map(|(_, id)| id).collect())
    }

    /// What `shot.json` of a shot says, checked against itself.
    ///
    /// # Errors
    /// [`StoreError::NoShot`], or [`StoreError::Damaged`] when it is not what was written.
    pub fn manifest(&self, id: &str) -> Result<Manifest, StoreError> {
        let folder = self.shot(id)?;
        Ok(Manifest::read(&*self.disk, &folder)?)
    }

    /// Where one file of one shot lies.
    ///
    /// # Errors
    /// [`StoreError::Missing`] for anything that is not a plain name of a file in a shot.
    pub fn file(&self, id: &str, name: &str) -> Result<PathBuf, StoreError> {
        let missing = || StoreError::Missing {
            id: shortened(id),
            name: shortened(name),
        };
        if !(is_plain(id) && is_plain(name)) {
            return Err(missing());
        }
        let path = self.folder.join(id).join(name);
        let found = path.symlink_metadata().map_err(|_| missing())?;
        if !found.is_file() || found.len() > LARGEST_FILE {
            return Err(missing());
        }
        Ok(path)
    }

    /// Deletes a shot; when this returns it is gone and stays gone.
    ///
    /// # Errors
    /// [`StoreError::NoShot`], or [`StoreError::Delete`] when it cannot be.
    pub fn delete(&self, id: &str) -> Result<(), StoreError> {
        let path = self.shot(id)?;
        let hidden = self.folder.join(format!("{DELETED}{id}"));
        let bytes = room::bytes_of(&*self.disk, &path).unwrap_or(0);
        self.disk
            .rename_new(&path, &hidden)
            .and_then(|()| self.disk.sync_dir(&self.folder))
            .map_err(|source| StoreError::Delete { path, source })?;
        // What is left of it when this fails goes when the store is next opened.
        if self.disk.remove(&hidden).is_ok() {
            self.forget(bytes);
        }
        Ok(())
    }

    /// The folder of a shot that is there.
    fn shot(&self, id: &str) -> Result<PathBuf, StoreError> {
        let path = self.folder.join(id);
        let known = is_plain(id)
            && time_of(id).is_some()
            && matches!(self.disk.list(&path), Ok(Some(names)) if !names.is_empty());
        known
            .then_some(path)
            .ok_or_else(|| StoreError::NoShot { id: shortened(id) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_outside_a_shot_can_be_read_or_deleted() {
        let state = tempfile::tempdir().unwrap();
        std::fs::write(state.path().join("secret"), "s").unwrap();
        let (store, _) = Store::open(state.path()).unwrap();
        let (id, folder) = store.next(SystemTime::now());
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("shot.json"), "{}").unwrap();
        std::os::unix::fs::symlink(state.path().join("secret"), folder.join("link")).unwrap();
        assert!(store.file(&id, "shot.json").is_ok());
        for (id, name) in [
            ("..", "secret"),
            (id.as_str(), "../../secret"),
            (id.as_str(), "link"),
            (id.as_str(), ""),
            (id.as_str(), "absent"),
            ("", "shots"),
            (id.as_str(), "a\0b"),
        ] {
            assert!(
                matches!(store.file(id, name), Err(StoreError::Missing { .. })),
                "{id} {name}"
            );
        }
        for id in [
            "..",
            "",
            ".lock",
            "shot-",
            "shot-1/..",
            "../shots",
            "shot-1",
        ] {
            assert!(
                matches!(store.delete(id), Err(StoreError::NoShot { .. })),
                "{id}"
            );
        }
        store.delete(&id).unwrap();
        assert!(!folder.exists() && state.path().join("secret").exists());
    }

    #[test]
    fn names_are_never_given_twice_however_fast_they_are_asked_for_and_wherever_the_clock_goes() {
        let state = tempfile::tempdir().unwrap();
        let far = state.path().join("shots/shot-9000000000000");
        std::fs::create_dir_all(&far).unwrap();
        let (store, _) = Store::open(state.path()).unwrap();
        let names: std::collections::BTreeSet<_> =
            (0..1000).map(|_| store.next(SystemTime::now()).0).collect();
        assert_eq!(names.len(), 1000);
        assert_eq!(names.first().unwrap(), "shot-9000000000001");
    }

    #[test]
    fn a_store_belongs_to_one_process_at_a_time() {
        let state = tempfile::tempdir().unwrap();
        let first = Store::open(state.path()).unwrap();
        let second = Store::open(state.path());
        assert!(matches!(second, Err(StoreError::Occupied { .. })));
        drop(first);
        Store::open(state.path()).unwrap();
    }
}
