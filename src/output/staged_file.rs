//! One file that appears whole or not at all: written under another name beside its own, renamed.

use super::{
    commit::CommitError,
    file_system::{Disk, FileSystem},
};
use std::{
    io,
    path::{Path, PathBuf},
};

/// A file being written; dropping it before [`StagedFile::commit`] or [`StagedFile::salvage`]
/// removes it.
#[derive(Debug)]
pub struct StagedFile {
    partial: PathBuf,
    target: PathBuf,
    settled: bool,
}

impl StagedFile {
    /// For a file that is worth nothing until it is whole: written as `.partial-NAME-PROCESS`.
    ///
    /// # Errors
    /// [`CommitError::Taken`] when `target` exists, [`CommitError::Name`] when it names no file.
    pub fn begin(target: &Path) -> Result<Self, CommitError> {
        Self::under(target, |name| {
            format!(".partial-{name}-{}", std::process::id())
        })
    }

    /// For a file whose beginning is worth keeping when the end never comes: written as
    /// `NAME.partial`, so that it is found after a crash.
    ///
    /// # Errors
    /// As [`Self::begin`]; [`CommitError::Taken`] also when `NAME.partial` exists.
    pub fn begin_salvageable(target: &Path) -> Result<Self, CommitError> {
        let staged = Self::under(target, |name| format!("{name}.partial"))?;
        if staged.partial.symlink_metadata().is_ok() {
            let path = staged.salvage();
            return Err(CommitError::Taken { path });
        }
        Ok(staged)
    }

    fn under(target: &Path, partial: impl Fn(&str) -> String) -> Result<Self, CommitError> {
        let path = || target.to_owned();
        if target.symlink_metadata().is_ok() {
            return Err(CommitError::Taken { path: path() });
        }
        let name = target
            .file_name()
            .ok_or_else(|| CommitError::Name { path: path() })?;
        Ok(Self {
            partial: target.with_file_name(partial(&name.to_string_lossy())),
            target: path(),
            settled: false,
        })
    }

    /// Where to write; whoever writes creates and syncs the file.
    pub fn partial(&self) -> &Path {
        &self.partial
    }

    /// Leaves what was written under its unfinished name, and says which.
    pub fn salvage(mut self) -> PathBuf {
        self.settled = true;
        self.partial.clone()
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// [`CommitError::Taken`] when the name was taken meanwhile, [`CommitError::Io`] otherwise.
    pub fn commit(mut self) -> Result<(), CommitError> {
        let path = self.target.clone();
        Disk.rename_new(&self.partial, &self.target)
            .map_err(|source| match source.kind() {
                io::ErrorKind::AlreadyExists => CommitError::Taken { path },
                _ => CommitError::Io {
                    path,
                    action: "give it its name",
                    source,
                },
            })?;
        self.settled = true;
        let parent = self.target.parent();
        let parent = parent.filter(|parent| !parent.as_os_str().is_empty());
        let parent = parent.unwrap_or(Path::new("."));
        Disk.sync_dir(parent).map_err(|source| CommitError::Io {
            path: parent.to_owned(),
            action: "sync it",
            source,
        })
    }

    /// Writes a whole file that was not there.
    ///
    /// # Errors
    /// As [`Self::begin`] and [`Self::commit`]; [`CommitError::Io`] when it cannot be written.
    pub fn write(target: &Path, bytes: &[u8]) -> Result<(), CommitError> {
        let staged = Self::begin(target)?;
        Disk.write_new(staged.partial(), bytes)
            .map_err(|source| CommitError::unwritten(target, source))?;
        staged.commit()
    }
}

impl Drop for StagedFile {
    fn drop(&mut self) {
        if !self.settled {
            // It may never have been created.
            let _ = std::fs::remove_file(&self.partial);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names = Disk.list(folder).unwrap().unwrap();
        names.sort();
        names
    }

    #[test]
    fn a_file_has_its_name_only_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.mcap");
        let staged = StagedFile::begin(&target).unwrap();
        std::fs::write(staged.partial(), "half").unwrap();
        drop(staged);
        assert!(names(folder.path()).is_empty());
        StagedFile::write(&target, b"whole").unwrap();
        assert_eq!(names(folder.path()), ["a.mcap"]);
        assert_eq!(std::fs::read(&target).unwrap(), b"whole");
    }

    #[test]
    fn a_name_that_is_taken_before_or_meanwhile_stays_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.mcap");
        let staged = StagedFile::begin(&target).unwrap();
        std::fs::write(staged.partial(), "late").unwrap();
        std::fs::write(&target, "first").unwrap();
        assert!(matches!(staged.commit(), Err(CommitError::Taken { .. })));
        assert!(matches!(
            StagedFile::begin(&target),
            Err(CommitError::Taken { .. })
        ));
        assert_eq!(std::fs::read(&target).unwrap(), b"first");
        assert_eq!(names(folder.path()), ["a.mcap"]);
    }

    #[test]
    fn what_an_earlier_crash_left_is_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.mcap");
        let staged = StagedFile::begin_salvageable(&target).unwrap();
        std::fs::write(staged.partial(), "beginning").unwrap();
        let kept = staged.salvage();
        let refused = StagedFile::begin_salvageable(&target).unwrap_err();
        assert!(refused.to_string().contains("a.mcap.partial"), "{refused}");
        assert_eq!(std::fs::read(kept).unwrap(), b"beginning");
    }
}
