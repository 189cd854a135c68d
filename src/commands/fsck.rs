//! `fsck`: are the shots that were kept still what was written?

use super::{Answer, CommandError};
use crate::{
    config::Config,
    output::Disk,
    store::{Condition, Store, check},
};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `fsck`.
#[derive(Debug, Args)]
pub struct Fsck {
    /// The daemon's state folder [default: as configured].
    #[arg(value_name = "DIR")]
    state: Option<PathBuf>,
    /// Finish, salvage and clear away what a killed daemon left, as the daemon does when it starts.
    #[arg(long)]
    salvage: bool,
}

impl Fsck {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let state = self.state.unwrap_or_else(|| config.state_path());
        let recovered = if self.salvage {
            Store::open(&state)?.1
        } else {
            Vec::new()
        };
        let folder = state.join("shots");
        let unreadable = |source| crate::store::StoreError::Read {
            path: folder.clone(),
            source,
        };
        let findings = check(&Disk, &folder).map_err(unreadable)?;
        let count = |condition| {
            let found = findings.iter().filter(|found| found.condition == condition);
            found.count()
        };
        let damaged = count(Condition::Damaged);
        let mut lines = vec![format!(
            "{}: {} shots whole, {} salvaged, {damaged} damaged, {} unfinished",
            folder.display(),
            count(Condition::Whole),
            count(Condition::Salvaged),
            count(Condition::Unfinished),
        )];
        for found in &findings {
            if let Some(problem) = &found.problem {
                lines.push(format!("{}: {problem}", found.name));
            }
        }
        let json = serde_json::json!({
            "folder": folder,
            "recovered": recovered,
            "found": findings,
        });
        let mut answer = Answer::new(lines.join("\n"), &json);
        if damaged > 0 {
            answer.exit_code = crate::api::FaultKind::Input.exit_code();
        }
        Ok(answer)
    }
}
