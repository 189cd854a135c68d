//! `shoot`: a shot, now.

use super::{
    Answer, CommandError, client::Client, error::ResultError, inference::TierArguments,
    lights::LightArguments, progress::Progress,
};
use crate::{
    api::{CheckedLights, Light, ShotReply, ShotRequest, Tier},
    config::Config,
    darkroom::{Answering, Asked},
    output::{Destination, Disk, Existing, Staging},
    radiometry::burst::BurstReport,
    session::{self, Kept},
};
use clap::Args;
use std::{path::PathBuf, time::Duration};

/// The light of `--relight` when none is given: above, to the right, in front.
const USUAL_LIGHT: Light = Light::from_direction([0.6, 0.5, 0.62]);

/// Arguments of `shoot`.
#[derive(Debug, Args)]
pub struct Shoot {
    /// Develop the shot and show it under new light [default light: 0.6,0.5,0.62].
    #[arg(long)]
    relight: bool,
    #[command(flatten)]
    lights: LightArguments,
    #[command(flatten)]
    tier: TierArguments,
    /// Address of the device [default: the daemon's, else the configured one].
    #[arg(long, value_name = "ADDRESS")]
    device: Option<String>,
    /// Make the shot of so many color frames: less noise, more time. Flash and ambient frames are shared
    /// out so that the noise is least. At most limits.burst of the configuration.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=64))]
    burst: Option<u32>,
    /// Folder for the shot; must not exist yet, or be empty.
    #[arg(long, value_name = "DIR", default_value = "shot")]
    out: PathBuf,
}

/// What is said of a shot, whoever took it.
struct Told {
    by: &'static str,
    device: String,
    note: String,
    kept: Kept,
}

impl Shoot {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let Asked {
            tier,
            variant,
            budget,
        } = self.tier.asked()?;
        let mut request = ShotRequest {
            device: self.device.clone(),
            burst: self.burst,
            relight: self.relight,
            lights: self.lights.read()?,
            environment: self.lights.read_environment()?,
            tier,
            variant,
            budget_ms: budget.map(|budget| 1e3 * budget.as_secs_f64()),
        };
        let dark = request.lights.is_empty() && request.environment.is_none();
        if !self.relight && !dark {
            return Err(CommandError::Arguments(
                "a light is given without --relight; add --relight".to_owned(),
            ));
        }
        if !self.relight && (tier != Tier::Auto || budget.is_some()) {
            return Err(CommandError::Arguments(
                "--tier or --budget is given without --relight; add --relight".to_owned(),
            ));
        }
        request
            .check_burst(config.limits.burst)
            .map_err(|problem| CommandError::Arguments(format!("--{problem}")))?;
        if self.relight && dark {
            request.lights.push(USUAL_LIGHT);
        }
        let limit = config.limits.lights;
        let checked = CheckedLights::new(&request.lights, limit, request.environment.as_ref())?;
        let told = match self.daemon(config)? {
            Some(client) => self.through(&client, config, &request)?,
            None => self.within(config, checked)?,
        };
        let Told {
            by,
            device,
            mut note,
            kept,
        } = told;
        let burst = kept.manifest.report["burst"].clone();
        if let Ok(burst) = serde_json::from_value::<BurstReport>(burst) {
            note.push_str(&in_words(&burst));
        }
        let text = format!("{}: shot of {device}, taken {note}", self.out.display());
        let json = serde_json::json!({
            "by": by,
            "device": device,
            "out": self.out,
            "files": kept.files,
            "shot": kept.manifest,
        });
        Ok(Answer::new(text, &json)
            .with_note(format!("taken {note}"))
            .with_warnings(kept.warnings))
    }

    /// The daemon, where one runs and owns the device that is wanted.
    fn daemon(&self, config: &Config) -> Result<Option<Client>, CommandError> {
        let Some(client) = Client::find(&config.socket_candidates())? else {
            return Ok(None);
        };
        let wanted = match &self.device {
            Some(wanted) => {
                let mut devices = client.status()?.devices.into_iter();
                devices.any(|owned| owned.address == *wanted || owned.device.address == *wanted)
            }
            None => true,
        };
        Ok(wanted.then_some(client))
    }

    /// Lets the daemon take the shot, and fetches it file by file through the socket: neither side
    /// needs rights in the other's folders.
    fn through(
        &self,
        client: &Client,
        config: &Config,
        request: &ShotRequest,
    ) -> Result<Told, CommandError> {
        if !self.tier.backend.is_empty() {
            return Err(CommandError::Arguments(format!(
                "--models, --runtime and --threads are for this process, but the daemon at {} takes the shot; set them under [inference] in its configuration",
                client.socket().display()
            )));
        }
        // Before the flash fires: a folder in the way should cost no shot.
        let mut staging = Staging::begin(&Disk, &self.out, Existing::Refuse, |_| false)?;
        let progress = Progress::of_unknown("the daemon takes the shot");
        let patience = config.limits.request_time() + Duration::from_secs(5);
        let ShotReply {
            id,
            device,
            files,
            warnings,
            shot: manifest,
        } = client.shoot(request, patience)?;
        for file in &files {
            progress.doing(file);
            let bytes = client.file(&id, file)?;
            staging.put(file, &bytes)?;
        }
        for stated in &manifest.files {
            if !staging.files().contains(stated) {
                return Err(ResultError {
                    path: self.out.join(&stated.name),
                    problem: "did not arrive as the daemon wrote it".to_owned(),
                    remedy: "take the shot again",
                }
                .into());
            }
        }
        staging.commit()?;
        let note = format!("by the daemon at {}", client.socket().display());
        Ok(Told {
            by: "daemon",
            device,
            note,
            kept: Kept {
                files,
                warnings,
                manifest,
            },
        })
    }

    /// Takes the shot in this process.
    fn within(&self, config: &Config, mut lights: CheckedLights) -> Result<Told, CommandError> {
        drop(Staging::begin(&Disk, &self.out, Existing::Refuse, |_| {
            false
        })?);
        // Before the flash fires, too.
        let answering = if self.relight {
            let (answering, said) = self.tier.ready(config)?;
            lights.warnings.extend(said);
            answering
        } else {
            Answering::Closed
        };
        let configured = config.devices.first().map_or("", String::as_str);
        let address = self.device.as_deref().unwrap_or(configured);
        let mut device = session::open(address, config.rig_of(address))?;
        let progress = Progress::of_unknown("taking the shot");
        let taken = session::take(device.as_mut(), &config.capture, self.burst)?;
        let lights = self.relight.then_some(&lights);
        let to = Destination {
            disk: &Disk,
            folder: &self.out,
            existing: Existing::Refuse,
        };
        let kept = session::keep(&taken, lights, &answering, &to, &mut |stage| {
            progress.doing(stage);
        })?;
        Ok(Told {
            by: "process",
            device: taken.info.address,
            note: "in this process; no daemon with this device was found".to_owned(),
            kept,
        })
    }
}

fn in_words(burst: &BurstReport) -> String {
    let ([flash, ambient], [best_flash, best_ambient]) = (burst.used, burst.best_split);
    format!(
        "; of {flash} frames with flash and {ambient} without (best are {best_flash} and {best_ambient}, as a \
         flash frame has {:.2} times the noise), which leaves {:.2} of the noise of one and one",
        burst.noise_ratio, burst.expected_noise
    )
}
