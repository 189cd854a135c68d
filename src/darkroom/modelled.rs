//! The shot, developed with the terms that its tier asks for or that it needs itself.

use super::{
    Clock, DarkroomError, Order,
    answering::{Answering, Auto},
    name_of, refuse_without_flash,
};
use crate::{
    develop::{DevelopError, Options, Stage},
    parsimony::{Criterion, Glance, Model, Plan, Rule, Shadow, Terms, Workload},
    radiometry::{self, SubtractOptions},
    relight::networks::compact::Compact,
};
use serde::Serialize;
use std::time::{Duration, Instant};

/// A look may take this share of a budget; beyond it what is typical must do.
const LOOKING_SHARE: f64 = 0.15;
/// Aligning the pair may take this share of a budget; beyond it the pair is taken as it lies.
const ALIGNING_SHARE: f64 = 0.3;
/// A plan may take this share of what is left of a budget: times scatter.
const PLANNED_SHARE: f64 = 0.8;

/// Why the terms are as they are; for `shot.json`.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Evidence {
    /// The terms in words.
    pub words: String,
    /// The terms and their grid.
    pub plan: Plan,
    /// The budget, milliseconds.
    pub budget_ms: Option<f64>,
    /// What all steps together were expected to take, milliseconds.
    pub expected_ms: f64,
    /// What the look at a small copy found; `None` where there was no time for one.
    pub glance: Option<Glance>,
    /// What held-out samples would have asked for, by one standard error.
    pub by_one_standard_error: Option<Terms>,
    /// The same by the Bayesian information criterion.
    pub by_bic: Option<Terms>,
}

/// The shot, developed.
pub(super) struct Modelled {
    pub model: Model,
    /// Why its terms are as they are, where it was asked.
    pub evidence: Option<Evidence>,
    /// The networks that were brought into memory for it.
    pub networks: Option<Compact>,
}

/// Develops the shot.
pub(super) fn modelled(
    order: &Order<'_>,
    clock: &mut Clock,
    observe: &mut dyn FnMut(&str),
) -> Result<Modelled, DarkroomError> {
    let began = Instant::now();
    let base = Options::default();
    let shot = order.shot;
    let (width, height) = shot.flash.pixels.size();
    let work = Workload {
        pixels: width * height,
        working_pixels: base.working_pixels,
        // An environment costs some eight lamps.
        lamps: order.lamps.len() + 8 * usize::from(order.environment.is_some()),
    };
    if let Answering::Auto(auto) = order.answering
        && let Some(budget) = auto.budget
    {
        Plan::check(1e3 * budget.as_secs_f64(), &auto.costs, work)?;
    }
    let steps = Steps::within(order.answering, work);
    clock.begin(name_of(Stage::Radiometry));
    observe(Stage::Radiometry.description());
    let subtract = SubtractOptions {
        align: steps.align,
        ..base.subtract
    };
    let flash_only =
        radiometry::subtract(&shot.flash, &shot.ambient, &subtract).map_err(DevelopError::from)?;
    refuse_without_flash(order, &flash_only.report)?;
    let (plan, glance, evidence) = match order.answering {
        Answering::Closed | Answering::Compact(_) | Answering::Paper(_) => {
            (Plan::closed(work), Glance::nothing_known(), None)
        }
        Answering::Auto(auto) => {
            clock.begin("choose");
            observe("choosing what to model");
            let glance = if steps.look {
                Some(Glance::at(shot, &flash_only, &base)?)
            } else {
                None
            };
            let (plan, mut evidence) = chosen(auto, glance, work, began);
            evidence.expected_ms += steps.expected_ms;
            let glance = evidence.glance.clone().unwrap_or_else(Glance::typical);
            (plan, glance, Some(evidence))
        }
    };
    // Whoever counts milliseconds has none for a second look.
    let build = match (order.answering, order.answering.has_time()) {
        (Answering::Auto(_), true) | (Answering::Compact(_), _) => Model::careful,
        _ => Model::new,
    };
    let model = build(shot, flash_only, &plan, &glance, &base, &mut |stage| {
        clock.begin(name_of(stage));
        observe(stage.description());
    })?;
    let networks = match (order.answering, plan.terms.shadow) {
        (Answering::Auto(auto), Shadow::Network) => {
            clock.begin("load networks");
            auto.networks.as_ref().map(|load| load()).transpose()?
        }
        _ => None,
    };
    let compact = match (order.answering, &networks) {
        (Answering::Compact(compact), _) | (_, Some(compact)) => Some(compact),
        _ => None,
    };
    let model = match compact {
        Some(compact) => {
            let surfaces = if glance.asks_for_surfaces() {
                clock.begin("correct surfaces");
                observe("correcting surfaces with a network");
                Some(compact.surfaces.as_ref())
            } else {
                clock.begin("prepare correction");
                observe("preparing what a network says of light");
                None
            };
            model.refined(shot, surfaces)?
        }
        None => model,
    };
    Ok(Modelled {
        model,
        evidence,
        networks,
    })
}

/// What is done before a plan is made.
struct Steps {
    /// Whether the pair is aligned.
    align: bool,
    /// Whether a small copy is looked at.
    look: bool,
    /// What that is expected to take, milliseconds.
    expected_ms: f64,
}

impl Steps {
    /// What a budget has time for; everything where there is none.
    fn within(answering: &Answering, work: Workload) -> Self {
        let Answering::Auto(auto) = answering else {
            return Self {
                align: true,
                look: false,
                expected_ms: 0.0,
            };
        };
        let costs = &auto.costs;
        let [aligning, looking] = [costs.alignment, costs.glance].map(|line| line.at(work.pixels));
        let fits = |ms: f64, share: f64| {
            let within = |budget: Duration| ms < share * 1e3 * budget.as_secs_f64();
            auto.budget.is_none_or(within)
        };
        let align = fits(aligning, ALIGNING_SHARE);
        let look = fits(looking, LOOKING_SHARE);
        let optional = [(align, aligning), (look, looking)];
        let chosen = optional.iter().filter(|(done, _)| *done).map(|(_, ms)| ms);
        Self {
            align,
            look,
            expected_ms: costs.radiometry.at(work.pixels) + chosen.sum::<f64>(),
        }
    }
}

fn chosen(auto: &Auto, glance: Option<Glance>, work: Workload, began: Instant) -> (Plan, Evidence) {
    let known = glance.clone().unwrap_or_else(Glance::typical);
    let sufficient = |criterion| {
        Plan::sufficient(
            &known,
            criterion,
            &auto.costs,
            work,
            auto.networks.is_some(),
        )
    };
    let enough = sufficient(Criterion::Visible);
    let plan = match auto.budget {
        None => enough,
        Some(budget) => {
            let spent_ms = 1e3 * began.elapsed().as_secs_f64();
            let left_ms = PLANNED_SHARE * (1e3 * budget.as_secs_f64() - spent_ms);
            // What is enough is enough, however much time there is.
            if enough.expected_ms <= left_ms {
                enough
            } else {
                Plan::within(left_ms, &known, &auto.costs, work, auto.networks.is_some())
            }
        }
    };
    let by = |rule| {
        glance
            .as_ref()
            .map(|_| sufficient(Criterion::Predicted(rule)).terms)
    };
    let evidence = Evidence {
        words: plan.terms.to_string(),
        plan,
        budget_ms: auto.budget.map(|budget| 1e3 * budget.as_secs_f64()),
        expected_ms: plan.expected_ms,
        by_one_standard_error: by(Rule::OneStandardError),
        by_bic: by(Rule::Bic),
        glance,
    };
    (plan, evidence)
}
