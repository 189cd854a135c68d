//! What only a running daemon can answer.

use super::{Answer, CommandError, client::Client};
use crate::config::Config;
use clap::Args;

/// Arguments of `shots`.
#[derive(Debug, Args)]
pub struct Shots {
    /// How many of the newest to list.
    #[arg(long, value_name = "COUNT", default_value_t = 50)]
    limit: usize,
    /// Delete these instead.
    #[arg(long, value_name = "ID", num_args = 1..)]
    delete: Vec<String>,
}

fn client(config: &Config) -> Result<Client, CommandError> {
    Client::find(&config.socket_candidates())?.ok_or_else(|| {
        CommandError::Arguments(
            "no daemon listens here; start captured, or give its configuration with --config"
                .to_owned(),
        )
    })
}

/// How the daemon is.
pub(super) fn status(config: &Config) -> Result<Answer, CommandError> {
    let client = client(config)?;
    let status = client.status()?;
    let mut lines = vec![format!(
        "captured {} at {}: {} shots taken, {} failed, {:.1} MB kept",
        status.version,
        client.socket().display(),
        status.shots,
        status.failures,
        status.used_bytes as f64 / 1e6,
    )];
    for device in &status.devices {
        let mut line = format!("{}: {}", device.device.address, device.phase.name());
        if let Some(problem) = &device.problem {
            line.push_str(&format!(" ({problem})"));
        }
        lines.push(line);
    }
    Ok(Answer::new(lines.join("\n"), &status))
}

/// Where the page is.
pub(super) fn viewer(config: &Config) -> Result<Answer, CommandError> {
    let page = client(config)?.viewer()?;
    let json = serde_json::json!({ "viewer": page });
    Ok(Answer::new(page, &json))
}

impl Shots {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let client = client(config)?;
        if !self.delete.is_empty() {
            for id in &self.delete {
                client.delete(id)?;
            }
            let json = serde_json::json!({ "deleted": self.delete });
            return Ok(Answer::new(
                format!("deleted {}", self.delete.join(", ")),
                &json,
            ));
        }
        let kept = client.shots(self.limit)?;
        let line = |shot: &crate::api::ShotEntry| {
            let lights = match shot.lights.len() {
                0 => "frames alone".to_owned(),
                1 => "1 light".to_owned(),
                count => format!("{count} lights"),
            };
            let size = format!("{}×{}", shot.width, shot.height);
            format!("{}  {size}  {lights}  {}", shot.id, shot.source)
        };
        let mut lines: Vec<String> = kept.shots.iter().map(line).collect();
        lines.push(format!("{} shots in all", kept.count));
        Ok(Answer::new(lines.join("\n"), &kept))
    }
}
