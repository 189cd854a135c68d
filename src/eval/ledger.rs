//! What an interrupted evaluation had finished, kept beside its report until that is written.

use crate::output::{CommitError, Disk, FileSystem as _};
use serde::{Serialize, de::DeserializeOwned};
use std::{
    cell::Cell,
    path::{Path, PathBuf},
};

/// Ending of every file of a ledger.
const ENDING: &str = ".eval.json";

/// Results by capture (its place in the run) and name. A result is found again only by a run of the same program with the
/// same options and rows, on a capture of the same contents.
#[derive(Debug, Default)]
pub struct Ledger {
    /// `None` keeps nothing.
    folder: Option<PathBuf>,
    /// What the run and each capture are, in the captures' order.
    keys: Vec<blake3::Hash>,
    taken_over: Cell<usize>,
}

impl Ledger {
    /// One that keeps nothing.
    pub fn none() -> Self {
        Self::default()
    }

    /// The ledger of a report: the hidden folder `.unfinished-NAME` beside it. `run` stands for the
    /// program, the options and the rows; `captures` gives every capture's name and the hash of its
    /// contents, in their order.
    ///
    /// # Errors
    /// [`CommitError::Name`] for a report that has no name.
    pub fn beside(
        report: &Path,
        run: blake3::Hash,
        captures: &[(&str, blake3::Hash)],
    ) -> Result<Self, CommitError> {
        let resolved = report.canonicalize().unwrap_or_else(|_| report.into());
        let Some(name) = resolved.file_name() else {
            return Err(CommitError::Name {
                path: report.into(),
            });
        };
        let mut hidden = std::ffi::OsString::from(".unfinished-");
        hidden.push(name);
        let keys = captures.iter().map(|(name, contents)| {
            let mut hasher = blake3::Hasher::new();
            hasher.update(run.as_bytes()).update(contents.as_bytes());
            hasher.update(name.as_bytes()).finalize()
        });
        let keys = keys.collect();
        Ok(Self {
            folder: Some(resolved.with_file_name(hidden)),
            keys,
            taken_over: Cell::new(0),
        })
    }

    /// How many results were found so far.
    pub fn taken_over(&self) -> usize {
        self.taken_over.get()
    }

    /// A result of an earlier run; `None` where there is none, and where what lies there is not what
    /// such a run wrote.
    pub(super) fn found<T: DeserializeOwned>(&self, capture: usize, name: &str) -> Option<T> {
        let bytes = std::fs::read(self.place(capture, name)?).ok()?;
        let (seal, content) = bytes.split_at_checked(SEAL)?;
        if seal != self.seal(capture, name, content)?.as_bytes() {
            return None;
        }
        let found = serde_json::from_slice(content).ok()?;
        self.taken_over.set(self.taken_over.get() + 1);
        Some(found)
    }

    /// Keeps a result. One that cannot be kept or would not read back the same (an error that is
    /// no number) is measured again next time.
    pub(super) fn keep<T: Serialize + DeserializeOwned + PartialEq>(
        &self,
        capture: usize,
        name: &str,
        result: &T,
    ) {
        let Some(place) = self.place(capture, name) else {
            return;
        };
        let Ok(content) = serde_json::to_vec(result) else {
            return;
        };
        let back = serde_json::from_slice::<T>(&content);
        if back.is_ok_and(|back| back == *result)
            && let Some(seal) = self.seal(capture, name, &content)
            && let Some(folder) = place.parent()
        {
            // A full disk must not end a run that needs none of this.
            let _ = std::fs::create_dir(folder);
            let _ = std::fs::remove_file(&place);
            let sealed = [seal.as_bytes().as_slice(), &content].concat();
            let _ = Disk.write_new(&place, &sealed);
        }
    }

    /// Removes what it holds: the report is written.
    pub fn close(self) {
        let Some(folder) = self.folder else {
            return;
        };
        for name in Disk.list(&folder).ok().flatten().unwrap_or_default() {
            if name.ends_with(ENDING) {
                let _ = std::fs::remove_file(folder.join(name));
            }
        }
        // Fails where a stranger's file is left, which is as it should be.
        let _ = std::fs::remove_dir(folder);
    }

    fn place(&self, capture: usize, name: &str) -> Option<PathBuf> {
        let key = self.key(capture, name)?;
        let folder = self.folder.as_ref()?;
        Some(folder.join(format!("{}{ENDING}", &key.to_hex()[..32])))
    }

    /// What a result is: run, capture, its name.
    fn key(&self, capture: usize, name: &str) -> Option<blake3::Hash> {
        let mut hasher = blake3::Hasher::new_keyed(self.keys.get(capture)?.as_bytes());
        hasher.update(name.as_bytes());
        Some(hasher.finalize())
    }

    /// Binds a result's text to what it is of.
    fn seal(&self, capture: usize, name: &str, content: &[u8]) -> Option<blake3::Hash> {
        let key = self.key(capture, name)?;
        Some(blake3::keyed_hash(key.as_bytes(), content))
    }
}

/// Bytes of the seal before a result's text.
const SEAL: usize = blake3::OUT_LEN;

#[cfg(test)]
mod tests {
    use super::*;

    fn ledger(folder: &Path, run: &str, contents: &str) -> Ledger {
        let capture = ("a", blake3::hash(contents.as_bytes()));
        let run = blake3::hash(run.as_bytes());
        Ledger::beside(&folder.join("report"), run, &[capture]).unwrap()
    }

    #[test]
    fn a_result_is_found_by_the_same_run_on_the_same_contents_only() {
        let folder = tempfile::tempdir().unwrap();
        let first = ledger(folder.path(), "run", "contents");
        first.keep(0, "clean", &vec![0.1, 2.0 / 3.0]);
        let found = |run, contents, capture, name: &str| -> Option<Vec<f64>> {
            ledger(folder.path(), run, contents).found(capture, name)
        };
        assert_eq!(
            found("run", "contents", 0, "clean"),
            Some(vec![0.1, 2.0 / 3.0])
        );
        assert_eq!(found("another", "contents", 0, "clean"), None);
        assert_eq!(found("run", "others", 0, "clean"), None);
        assert_eq!(found("run", "contents", 0, "noisy"), None);
        assert_eq!(found("run", "contents", 1, "clean"), None);
    }

    #[test]
    fn a_file_that_was_changed_cut_or_moved_is_not_taken_over() {
        let folder = tempfile::tempdir().unwrap();
        let first = ledger(folder.path(), "run", "contents");
        first.keep(0, "clean", &vec![1.0]);
        first.keep(0, "noisy", &vec![2.0]);
        let [clean, noisy] = ["clean", "noisy"].map(|name| first.place(0, name).unwrap());
        let whole = std::fs::read(&clean).unwrap();
        let raised = [&whole[..SEAL], b"[9.0]"].concat();
        let other = std::fs::read(&noisy).unwrap();
        for bytes in [
            &raised[..],
            &whole[..whole.len() - 1],
            &other,
            b"",
            b"[1.0]",
        ] {
            std::fs::write(&clean, bytes).unwrap();
            assert_eq!(first.found::<Vec<f64>>(0, "clean"), None, "{bytes:?}");
        }
        std::fs::write(&clean, &whole).unwrap();
        assert_eq!(first.found::<Vec<f64>>(0, "clean"), Some(vec![1.0]));
        assert_eq!(first.taken_over(), 1);
    }

    #[test]
    fn closing_removes_what_is_its_own_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let hidden = folder.path().join(".unfinished-report");
        let first = ledger(folder.path(), "run", "contents");
        first.keep(0, "clean", &vec![1.0]);
        std::fs::write(hidden.join("thesis.txt"), "mine").unwrap();
        first.close();
        let left: Vec<_> = std::fs::read_dir(&hidden).unwrap().collect();
        assert_eq!(left.len(), 1);
        std::fs::remove_file(hidden.join("thesis.txt")).unwrap();
        ledger(folder.path(), "run", "contents").close();
        assert!(!hidden.exists());
    }
}
