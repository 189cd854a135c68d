//! `import`: a capture folder becomes a recording, with its mask and truth beside it.

use super::{Answer, CommandError, progress::Progress};
use crate::folder::{FolderError, Imported, import};
use clap::Args;
use drivers::recording::summarize;
use std::path::{Path, PathBuf};

/// Arguments of `import`.
#[derive(Debug, Args)]
pub struct Import {
    /// The capture folder.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// The recording to write; must not exist yet [default: the folder's name with .mcap].
    #[arg(long, value_name = "FILE.mcap")]
    out: Option<PathBuf>,
}

impl Import {
    pub(super) fn run(self) -> Result<Answer, CommandError> {
        let out = self.out.unwrap_or_else(|| named_after(&self.folder));
        let progress = Progress::of_unknown("importing");
        let Imported { made, notes } =
            import(&self.folder, &out).map_err(|error| classified(error, &out))?;
        let summary = summarize(&out)?;
        drop(progress);
        let text = format!(
            "{}: {} bytes from {}",
            out.display(),
            summary.bytes,
            self.folder.display()
        );
        let json = serde_json::json!({ "out": out, "made": made, "recording": summary });
        Ok(Answer::new(text, &json).with_warnings(notes))
    }
}

/// `capture.mcap` in the current folder for `some/where/capture/`, also for `.`.
fn named_after(folder: &Path) -> PathBuf {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = whole
        .file_name()
        .map_or_else(|| "capture".into(), |name| name.to_string_lossy());
    PathBuf::from(format!("{name}.mcap"))
}

/// The same error whether reading or writing failed has another exit code.
fn classified(error: FolderError, out: &Path) -> CommandError {
    let writing = match &error {
        FolderError::Recording(_) | FolderError::Commit(_) | FolderError::Unwritable { .. } => true,
        FolderError::Io { path, .. } => {
            path.parent() == out.parent() && path.with_extension("") == out.with_extension("")
        }
        _ => false,
    };
    if writing {
        CommandError::Unwritten(error)
    } else {
        CommandError::Folder(error)
    }
}
