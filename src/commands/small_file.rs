//! Text files that a person names on the command line.

use std::{fs::File, io::Read, path::Path};

/// Largest of them, bytes.
const LARGEST: u64 = 1 << 20;

/// Reads one of at most 1 MiB: what is larger, or endless, is no file of settings.
///
/// # Errors
/// In words, without the path.
pub(super) fn read(path: &Path) -> Result<String, String> {
    let unread = |error: std::io::Error| format!("cannot be read: {error}");
    let mut text = String::new();
    let file = File::open(path).map_err(unread)?;
    file.take(LARGEST + 1)
        .read_to_string(&mut text)
        .map_err(unread)?;
    match text.len() as u64 > LARGEST {
        true => Err(format!("larger than {LARGEST} bytes")),
        false => Ok(text),
    }
}
