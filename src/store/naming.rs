//! What the names in a store mean.

use crate::output::UNFINISHED;

/// What the name of a shot that is being deleted begins with.
pub(super) const DELETED: &str = ".deleted-";

/// The milliseconds in the name of a shot, finished, unfinished or being deleted; `None` for names
/// that are none of ours.
pub(super) fn time_of(name: &str) -> Option<u64> {
    let id = match name.strip_prefix(UNFINISHED) {
        Some(rest) => unfinished_id(rest)?,
        None => name.strip_prefix(DELETED).unwrap_or(name),
    };
    let digits = id.strip_prefix("shot-")?;
    let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    plain.then(|| digits.parse().ok()).flatten()
}

/// The shot that `ID-PROCESS-ATTEMPT` would have become.
pub(super) fn unfinished_id(rest: &str) -> Option<&str> {
    let (rest, _attempt) = rest.rsplit_once('-')?;
    rest.rsplit_once('-').map(|(id, _process)| id)
}

/// Letters, digits, `_`, `-` and dots that do not lead: nothing that could leave the folder.
pub(super) fn is_plain(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 100
        && !name.starts_with('.')
        && name
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || b"_-.".contains(&byte))
}

/// For messages.
pub(super) fn shortened(name: &str) -> String {
    name.chars().take(100).collect()
}
