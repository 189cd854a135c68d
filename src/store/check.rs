//! Every shot compared with its manifest, and everything else in the folder named.

use super::{
    LOCK,
    naming::{DELETED, time_of},
};
use crate::output::{FileSystem, Manifest, UNFINISHED};
use serde::{Deserialize, Serialize};
use std::{io, path::Path};

/// How something in a store is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// Every file is as its manifest states it.
    Whole,
    /// Whole, but cut short while it was written: not every file that was to be is there.
    Salvaged,
    /// Not what was written.
    Damaged,
    /// Never finished: being written now, or left by a process that was killed.
    Unfinished,
    /// Being deleted, or left by a process that was killed then.
    Deleted,
    /// Nothing of ours.
    Foreign,
}

/// One name in a store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// The name.
    pub name: String,
    /// How it is.
    pub condition: Condition,
    /// What is wrong and what to do; `None` where all is well.
    pub problem: Option<String>,
}

/// Looks at everything in `folder`, newest shots first, and changes nothing.
///
/// # Errors
/// What the operating system says of the folder itself.
pub fn check(disk: &dyn FileSystem, folder: &Path) -> io::Result<Vec<Finding>> {
    let mut names = disk.list(folder)?.unwrap_or_default();
    names.retain(|name| name != LOCK);
    names.sort_unstable_by(|a, b| (time_of(b), b).cmp(&(time_of(a), a)));
    Ok(names
        .into_iter()
        .map(|name| {
            let (condition, problem) = condition_of(disk, folder, &name);
            Finding {
                name,
                condition,
                problem,
            }
        })
        .collect())
}

fn condition_of(disk: &dyn FileSystem, folder: &Path, name: &str) -> (Condition, Option<String>) {
    let said = |words: &str| Some(words.to_owned());
    if time_of(name).is_none() {
        let words = "is no shot; move it elsewhere";
        return (Condition::Foreign, said(words));
    }
    if name.starts_with(DELETED) {
        let words = "is being deleted; goes when the daemon next starts, or with --salvage";
        return (Condition::Deleted, said(words));
    }
    if name.starts_with(UNFINISHED) {
        let words = "was never finished; what is whole is salvaged when the daemon next starts, or with --salvage; what stays after that can be deleted";
        return (Condition::Unfinished, said(words));
    }
    let dir = folder.join(name);
    let checked = Manifest::read(disk, &dir)
        .and_then(|manifest| manifest.verify_files(disk, &dir).map(|()| manifest));
    match checked {
        Ok(manifest) if manifest.report["salvaged"] == true => {
            (Condition::Salvaged, manifest.warnings.first().cloned())
        }
        Ok(_) => (Condition::Whole, None),
        Err(error) => (Condition::Damaged, Some(error.to_string())),
    }
}
