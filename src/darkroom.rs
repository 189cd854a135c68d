//! From a shot to a folder of results: develop, light, write, and say what to doubt.

mod answering;
mod doubts;
mod lights;
mod modelled;
mod reel;
mod standing;
mod surroundings;

pub use answering::{Answering, Asked, Auto, LoadNetworks, ready};
pub use reel::{Moment, Reel};

use crate::{
    api::FaultKind,
    costs::{self, CostError},
    develop::{DevelopError, Development, Stage},
    inference::InferenceError,
    output::{Destination, Manifest, OutputError, RelitView, Results, Tone, sheet::Panel, write},
    parsimony::TooLittleTime,
    radiometry::{SubtractionReport, burst::BurstReport, linearise},
    relight::{Environment, Luminaire, Relit, networks::NetworkError},
    shot::{DropCounts, Shot},
    verdict::{Verdict, judge},
};
use doubts::{doubts, fraction, mean_confidence};
use drivers::{ColorFrame, Plane};
use modelled::{Evidence, Modelled};
use standing::Standing;
use std::time::Instant;
use surroundings::Surroundings;
use thiserror::Error;

/// Fraction of usable pixels within the noise from which there is no flash in the picture.
const NO_FLASH: f32 = 0.98;

/// What is to be made.
pub struct Order<'a> {
    /// The frames.
    pub shot: &'a Shot,
    /// Where they came from.
    pub source: Source<'a>,
    /// Lamps, in the order of the numbered results.
    pub lamps: &'a [Luminaire],
    /// Light from all around and what it is called; its results come last.
    pub environment: Option<(&'a str, &'a Environment)>,
    /// What answers.
    pub answering: &'a Answering,
    /// What the caller knows to lower the trust.
    pub warnings: Vec<String>,
    /// Further files of the folder: name and contents.
    pub attachments: &'a [(&'a str, &'a [u8])],
}

/// Where a shot came from.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// A folder, file or device, for people.
    pub name: &'a str,
    /// Frames that became part of no shot; `None` where frames were not put together.
    pub drops: Option<DropCounts>,
    /// What a burst was made of; `None` for a shot of one bracket.
    pub burst: Option<&'a BurstReport>,
}

/// Why there are no results.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum DarkroomError {
    #[error(transparent)]
    Develop(#[from] DevelopError),
    #[error(
        "{source_name}: no flash in the shot: {weak_percent:.1} % of its flash-only light is within the noise (median {snr_db:.1} dB); check that the flash fires and that flash and ambient frames are not exchanged"
    )]
    NoFlash {
        source_name: String,
        weak_percent: f32,
        snr_db: f32,
    },
    #[error(
        "light {index} is near, and the paper's networks know distant lights alone; give it a direction, or use --tier compact, closed or auto"
    )]
    NearForPaper { index: usize },
    #[error(transparent)]
    Budget(#[from] TooLittleTime),
    #[error(transparent)]
    Costs(#[from] CostError),
    #[error(transparent)]
    Inference(#[from] InferenceError),
    #[error(transparent)]
    Network(#[from] NetworkError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl DarkroomError {
    /// Which part failed.
    pub fn kind(&self) -> FaultKind {
        match self {
            Self::Develop(_) | Self::NoFlash { .. } | Self::Costs(_) => FaultKind::Shot,
            Self::Budget(_) | Self::NearForPaper { .. } => FaultKind::Request,
            Self::Inference(_) | Self::Network(_) => FaultKind::Input,
            Self::Output(_) => FaultKind::Output,
        }
    }
}

/// Develops a shot, sets it into every light and writes the folder.
///
/// `observe` hears what is being done.
///
/// # Errors
/// [`DarkroomError::Develop`] and [`DarkroomError::NoFlash`] when the shot cannot answer;
/// [`DarkroomError::Network`] when a network fails;
/// [`DarkroomError::Output`] when the folder exists or cannot be written. Nothing is left behind.
pub fn print(
    order: &Order<'_>,
    to: &Destination<'_>,
    observe: &mut dyn FnMut(&str),
) -> Result<Manifest, DarkroomError> {
    let near = |lamp: &Luminaire| !matches!(lamp, Luminaire::Distant(_));
    if let (Answering::Paper(_), Some(index)) = (order.answering, order.lamps.iter().position(near))
    {
        return Err(DarkroomError::NearForPaper { index });
    }
    let clock = &mut Clock::default();
    let Modelled {
        mut model,
        evidence,
        networks,
    } = modelled::modelled(order, clock, observe)?;
    let verdict = model.verdict.take().or_else(|| {
        order.answering.has_time().then(|| {
            clock.begin("judge");
            judge(order.shot, &model.development)
        })
    });
    if let Some(verdict) = &verdict {
        model.development.scene.confidence = verdict.confidence.clone();
    }
    let surroundings = order.environment.map(|(name, environment)| {
        observe(&format!("choosing lights for {name}"));
        Surroundings::new(environment, &model.development, clock)
    });
    let standing = Standing::new(order.lamps, &model.development, clock);
    // Asked for by no later stage; 48 MB of a photograph of 12 megapixels.
    model.development.flash_only.variance = Plane::default();
    let around = surroundings.as_ref();
    let relit = lights::lit(
        order,
        (&standing, around),
        &mut model,
        networks.as_ref(),
        clock,
        observe,
    )?;
    let development = &model.development;
    let timings_ms = clock.end();
    if let (Answering::Auto(auto), Some(evidence)) = (order.answering, &evidence)
        && let (Some(file), Some(_)) = (&auto.costs_file, auto.budget)
    {
        let took_ms = timings_ms.iter().map(|(_, ms)| ms).sum();
        costs::learn(file, evidence.expected_ms, took_ms);
    }
    observe("writing");
    let mut warnings = order.warnings.clone();
    let labels: Vec<String> = order
        .lamps
        .iter()
        .map(label)
        .chain(order.environment.map(|(name, _)| name.to_owned()))
        .collect();
    warnings.extend(doubts(&labels, development, verdict.as_ref(), &relit));
    // An environment's light comes from everywhere: no direction.
    let directions = order
        .lamps
        .iter()
        .map(Luminaire::person_origin)
        .chain([[0.0; 3]]);
    let views: Vec<RelitView<'_>> = relit
        .iter()
        .zip(directions)
        .zip(&labels)
        .map(|((relit, toward_person), label)| RelitView {
            toward_person,
            label,
            relit: &relit.light,
            shadow: &relit.shadow,
        })
        .collect();
    let photographs: Vec<Panel> = [("flash photograph", Some(&order.shot.flash))]
        .into_iter()
        .chain([("without flash", order.shot.ambient.first())])
        .filter_map(|(label, frame)| photograph(label, frame?))
        .collect();
    let mut report = report(
        order,
        development,
        (evidence.as_ref(), verdict.as_ref()),
        &relit,
    );
    report["large_lights"] = serde_json::json!(standing.found);
    report["environment"] = serde_json::json!(surroundings.map(|all| all.found));
    let results = Results {
        source: order.source.name,
        photographs: &photographs,
        flash_only: &development.flash_only.light,
        scene: &development.scene,
        relit: &views,
        timings_ms: &timings_ms,
        report,
        warnings: &warnings,
        attachments: order.attachments,
    };
    Ok(write(&results, to.folder, to.existing, to.disk)?)
}

/// Times what begins and ends by turns.
#[derive(Default)]
struct Clock {
    running: Option<(&'static str, Instant)>,
    times_ms: Vec<(String, f64)>,
}

impl Clock {
    fn begin(&mut self, name: &'static str) {
        self.stop();
        self.running = Some((name, Instant::now()));
    }

    fn stop(&mut self) {
        if let Some((name, began)) = self.running.take() {
            self.times_ms
                .push((name.to_owned(), began.elapsed().as_secs_f64() * 1e3));
        }
    }

    fn end(&mut self) -> Vec<(String, f64)> {
        self.stop();
        std::mem::take(&mut self.times_ms)
    }
}

/// The stage's name in `shot.json`.
fn name_of(stage: Stage) -> &'static str {
    match stage {
        Stage::Radiometry => "radiometry",
        Stage::Registration => "registration",
        Stage::Scene => "scene",
        Stage::Prepare => "prepare",
    }
}

/// A photograph of the shot, small and shown as bright as it needs.
fn photograph(label: &str, frame: &ColorFrame) -> Option<Panel> {
    let light = linearise(frame).ok()?.0;
    Some(Panel::light(label, &light, &Tone::robust([&light])))
}

fn label(lamp: &Luminaire) -> String {
    let [x, y, z] = lamp.person_origin();
    let (of, metres) = match lamp {
        Luminaire::Distant(_) => ("", ""),
        Luminaire::Near(_) => ("at ", " m"),
        Luminaire::Area(_) => ("large at ", " m"),
    };
    format!("{of}{x:.2},{y:.2},{z:.2}{metres}")
}

/// The paper's networks know distant lights alone.
fn refuse_near_for_paper(order: &Order<'_>) -> Result<(), DarkroomError> {
    let near = |lamp: &Luminaire| !matches!(lamp, Luminaire::Distant(_));
    match (order.answering, order.lamps.iter().position(near)) {
        (Answering::Paper(_), Some(index)) => Err(DarkroomError::NearForPaper { index }),
        _ => Ok(()),
    }
}

/// A picture that holds noise alone has no answer.
fn refuse_without_flash(order: &Order<'_>, found: &SubtractionReport) -> Result<(), DarkroomError> {
    if found.weak_fraction < NO_FLASH {
        return Ok(());
    }
    Err(DarkroomError::NoFlash {
        source_name: order.source.name.to_owned(),
        weak_percent: 100.0 * found.weak_fraction,
        snr_db: found.snr_db,
    })
}

/// What the stages found, for `shot.json`.
fn report(
    order: &Order<'_>,
    development: &Development,
    (evidence, verdict): (Option<&Evidence>, Option<&Verdict>),
    relit: &[Relit],
) -> serde_json::Value {
    let (tier, networks) = match order.answering {
        Answering::Closed => ("closed", None),
        Answering::Compact(compact) => ("compact", Some(compact.records().to_vec())),
        Answering::Paper(paper) => ("paper", Some(paper.records().into())),
        Answering::Auto(_) => ("auto", None),
    };
    let unseen: Vec<f32> = relit
        .iter()
        .map(|relit| relit.unseen_path_fraction)
        .collect();
    serde_json::json!({
        "subtraction": development.flash_only.report,
        "depth_measured_fraction": fraction(&development.registered.measured, |measured| *measured),
        "depth_known_fraction": fraction(&development.registered.metres, |metres| !metres.is_nan()),
        "confidence_mean": mean_confidence(development),
        "unseen_path_fraction": unseen,
        "drops": order.source.drops,
        "burst": order.source.burst,
        "tier": tier,
        "networks": networks,
        "model": evidence,
        "verdict": verdict.map(|verdict| &verdict.findings),
    })
}
