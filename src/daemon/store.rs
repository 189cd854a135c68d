//! The folder in which the daemon keeps its shots.

use crate::api::{Fault, FaultKind};
use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
    time::{SystemTime, UNIX_EPOCH},
};
use thiserror::Error;

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
    #[error("no shot {id:?} with a file {name:?}; ask for a name that the shot's reply lists")]
    Missing { id: String, name: String },
    #[error("{path}: {source}")]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
}

impl StoreError {
    /// For the reply.
    pub fn fault(&self) -> Fault {
        let kind = match self {
            Self::Folder { .. } => FaultKind::Output,
            Self::Missing { .. } => FaultKind::Request,
            Self::Read { .. } => FaultKind::Daemon,
        };
        Fault {
            kind,
            message: self.to_string(),
            remedy: None,
        }
    }
}

/// The shots of one daemon, one folder each.
pub struct Store {
    folder: PathBuf,
    /// Milliseconds of the newest name given out, so that no name is given twice.
    newest: AtomicU64,
}

impl Store {
    /// Opens the store in `state`, creating the folders.
    ///
    /// # Errors
    /// [`StoreError::Folder`] when they cannot be created.
    pub fn open(state: &Path) -> Result<Self, StoreError> {
        let folder = state.join("shots");
        std::fs::create_dir_all(&folder).map_err(|source| StoreError::Folder {
            path: folder.clone(),
            source,
        })?;
        Ok(Self {
            folder,
            newest: AtomicU64::new(0),
        })
    }

    /// A name for a new shot, later than all before it, and the folder it will be.
    pub fn next(&self) -> (String, PathBuf) {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
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

    /// One file of one shot.
    ///
    /// # Errors
    /// [`StoreError::Missing`] for anything that is not a plain name of a file in a shot.
    pub fn read(&self, id: &str, name: &str) -> Result<Vec<u8>, StoreError> {
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
        std::fs::read(&path).map_err(|source| StoreError::Read { path, source })
    }
}

/// Letters, digits, `_`, `-` and dots that do not lead: nothing that could leave the folder.
fn is_plain(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 100
        && !name.starts_with('.')
        && name
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || b"_-.".contains(&byte))
}

fn shortened(name: &str) -> String {
    name.chars().take(100).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_outside_a_shot_can_be_read() {
        let state = tempfile::tempdir().unwrap();
        std::fs::write(state.path().join("secret"), "s").unwrap();
        let store = Store::open(state.path()).unwrap();
        let (id, folder) = store.next();
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("shot.json"), "{}").unwrap();
        std::os::unix::fs::symlink(state.path().join("secret"), folder.join("link")).unwrap();
        assert_eq!(store.read(&id, "shot.json").unwrap(), b"{}");
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
                matches!(store.read(id, name), Err(StoreError::Missing { .. })),
                "{id} {name}"
            );
        }
    }

    #[test]
    fn names_are_never_given_twice_however_fast_they_are_asked_for() {
        let state = tempfile::tempdir().unwrap();
        let store = Store::open(state.path()).unwrap();
        let names: std::collections::BTreeSet<_> = (0..1000).map(|_| store.next().0).collect();
        assert_eq!(names.len(), 1000);
    }
}
