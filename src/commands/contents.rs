//! What lies in files and folders, as one hash.

use super::{CommandError, error::InputError};
use std::path::Path;

/// The hash of the names and contents of all files at and under these paths; a path where nothing
/// is counts as that.
pub(super) fn of(paths: &[&Path]) -> Result<blake3::Hash, CommandError> {
    let mut hasher = blake3::Hasher::new();
    for path in paths {
        add(path, &mut hasher).map_err(|error| InputError {
            path: path.to_path_buf(),
            problem: format!("cannot be read: {error}"),
            remedy: "check its permissions",
        })?;
    }
    Ok(hasher.finalize())
}

fn add(path: &Path, hasher: &mut blake3::Hasher) -> std::io::Result<()> {
    let metadata = match path.metadata() {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            hasher.update(b"nothing");
            return Ok(());
        }
        Err(error) => return Err(error),
    };
    if metadata.is_dir() {
        let entries = path.read_dir()?.map(|entry| Ok(entry?.path()));
        let mut entries: Vec<_> = entries.collect::<std::io::Result<_>>()?;
        entries.sort();
        for entry in entries {
            hasher.update(entry.file_name().unwrap_or_default().as_encoded_bytes());
            add(&entry, hasher)?;
        }
        hasher.update(b"folder");
    } else if metadata.is_file() {
        let mut of_file = blake3::Hasher::new();
        of_file.update_reader(std::fs::File::open(path)?)?;
        hasher.update(of_file.finalize().as_bytes());
    }
    Ok(())
}
