//! Which terms, and on how fine a grid: the cheapest that do, or the best that time allows.

use super::{
    cost::{CostModel, Workload},
    glance::Glance,
    rule::Rule,
    terms::{Bounced, Geometry, Shadow, Terms},
};
use crate::{develop::Options, scene::Material};
use serde::{Deserialize, Serialize};

/// Grids that a plan may use: so many times as coarse a side as the finest.
const COARSER: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// Share of all time that the largest change must save to be worth it.
const WORTH: f64 = 0.5;

/// What decides that a term may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Without it the relit pictures change less than the photograph's noise does, all terms that
    /// go together.
    #[default]
    Visible,
    /// The shot's own samples do not ask for it, by this rule; of shadows and bounced light, of
    /// which a photograph lit from the lens shows nothing, as [`Self::Visible`].
    Predicted(Rule),
}

/// Which terms a shot is modelled with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Plan {
    /// The terms.
    pub terms: Terms,
    /// The factor by which a side of the photograph's grid shrinks.
    pub factor: usize,
    /// What leaving the others out is expected to change, root mean square, linear light of white = 1.
    pub change: f32,
    /// Expected time from the flash's light to the relit pictures, milliseconds.
    pub expected_ms: f64,
}

/// A time in which nothing can be answered.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "a budget of {budget_ms:.1} ms is less than the cheapest answer takes here ({least_ms:.1} ms); give at least that, or a smaller photograph"
)]
pub struct TooLittleTime {
    /// What was given, milliseconds.
    pub budget_ms: f64,
    /// What the cheapest answer takes, milliseconds.
    pub least_ms: f64,
}

impl Plan {
    /// Every term that needs no network, whatever the shot.
    pub fn closed(work: Workload) -> Self {
        Self {
            terms: Terms::CLOSED,
            factor: base_factor(work),
            change: 0.0,
            expected_ms: 0.0,
        }
    }

    /// The plan that is best worth its time among those whose pictures change no more than `glance` says
    /// can be seen: what hardly saves anything is not left out.
    pub fn sufficient(
        glance: &Glance,
        criterion: Criterion,
        costs: &CostModel,
        work: Workload,
        network: bool,
    ) -> Self {
        let allowed = |plan: &Self| match criterion {
            Criterion::Visible => plan.change <= glance.tolerance,
            Criterion::Predicted(rule) => {
                let terms = plan.terms;
                let geometry = [Geometry::Plane, Geometry::Smooth, Geometry::Full];
                let material = [Material::Matte, Material::OneRoughness, Material::Varying];
                geometry[glance.depth.pick(rule).min(2)] == terms.geometry
                    && material[glance.material.pick(rule).min(2)] == terms.material
                    && shadows_and_bounces(glance, terms) <= glance.tolerance
            }
        };
        let everything = Self::of(full(network), base_factor(work), glance, costs, work);
        let worth = |plan: &Self| {
            let time = plan.expected_ms / everything.expected_ms.max(f64::MIN_POSITIVE);
            let coarser = plan.factor / base_factor(work);
            let missed = missed(glance, plan.terms, coarser);
            let share = missed / glance.tolerance.max(f32::MIN_POSITIVE);
            let change = f64::from(share.min(1.0));
            time + WORTH * change * change
        };
        // A look at few pixels misses the spark that spoils one roughness for all, and takes a whole thing for as shiny as
        // its shiniest spot: a photographed pig lost 14 dB. Only samples, or a budget, may ask for it.
        let looked = criterion == Criterion::Visible;
        plans(network, work)
            .filter(|(terms, _)| !(looked && terms.material == Material::OneRoughness))
            .map(|(terms, factor)| Self::of(terms, factor, glance, costs, work))
            .filter(|plan| plan.factor <= 2 * base_factor(work) && allowed(plan))
            .min_by(|a, b| worth(a).total_cmp(&worth(b)))
            .unwrap_or(everything)
    }

    /// The plan of the least change that takes no longer than `budget_ms`; the cheapest one where
    /// there is none.
    pub fn within(
        budget_ms: f64,
        glance: &Glance,
        costs: &CostModel,
        work: Workload,
        network: bool,
    ) -> Self {
        let all = plans(network, work)
            .map(|(terms, factor)| Self::of(terms, factor, glance, costs, work));
        let best = all
            .filter(|plan| plan.expected_ms <= budget_ms)
            .min_by(|a, b| {
                let change = a.change.total_cmp(&b.change);
                change.then(a.expected_ms.total_cmp(&b.expected_ms))
            });
        best.unwrap_or_else(|| Self::cheapest(glance, costs, work))
    }

    /// The plan that takes the least time.
    pub fn cheapest(glance: &Glance, costs: &CostModel, work: Workload) -> Self {
        let coarsest = base_factor(work) * COARSER[COARSER.len() - 1];
        Self::of(Terms::FEWEST, coarsest, glance, costs, work)
    }

    /// Whether anything at all can be answered in `budget_ms`, from the shot to the relit pictures.
    ///
    /// # Errors
    /// [`TooLittleTime`] when the cheapest plan is expected to take longer.
    pub fn check(budget_ms: f64, costs: &CostModel, work: Workload) -> Result<(), TooLittleTime> {
        let cheapest = Self::cheapest(&Glance::typical(), costs, work);
        let least_ms = costs.radiometry.at(work.pixels) + cheapest.expected_ms;
        if least_ms <= budget_ms {
            return Ok(());
        }
        Err(TooLittleTime {
            budget_ms,
            least_ms,
        })
    }

    /// How a photograph of `pixels` is developed. `blocked` is the mean share of the hemisphere that
    /// the scene blocks, [0, 1].
    pub fn options(&self, base: &Options, pixels: usize, blocked: f32) -> Options {
        let mut options = self.terms.options(base, blocked);
        options.working_pixels = pixels / (self.factor * self.factor);
        options
    }

    fn of(terms: Terms, factor: usize, glance: &Glance, costs: &CostModel, work: Workload) -> Self {
        Self {
            terms,
            factor,
            change: change(glance, terms, factor / base_factor(work)),
            expected_ms: costs.rest_ms(terms, factor, work),
        }
    }
}

/// The factor that the largest working grid asks for anyway.
fn base_factor(work: Workload) -> usize {
    let fits = |factor: &usize| work.pixels / (factor * factor) <= work.working_pixels.max(1);
    (1..).find(fits).unwrap_or(1)
}

fn full(network: bool) -> Terms {
    if network {
        Terms::EVERYTHING
    } else {
        Terms::CLOSED
    }
}

/// Every combination of terms that makes sense, on every grid it may use.
fn plans(network: bool, work: Workload) -> impl Iterator<Item = (Terms, usize)> + Clone {
    let base = base_factor(work);
    let shadows = [Shadow::None, Shadow::Swept, Shadow::Network];
    let materials = [Material::Matte, Material::OneRoughness, Material::Varying];
    let bounces = [Bounced::None, Bounced::Constant, Bounced::Predicted];
    let shadows = shadows
        .into_iter()
        .filter(move |shadow| network || *shadow != Shadow::Network);
    let combinations = shadows.flat_map(move |shadow| {
        materials
            .into_iter()
            .flat_map(move |material| bounces.map(|indirect| (shadow, material, indirect)))
    });
    combinations.flat_map(move |(shadow, material, indirect)| {
        COARSER.into_iter().flat_map(move |coarser| {
            let factor = coarser * base;
            let geometry = if factor == base {
                Geometry::Full
            } else {
                Geometry::Smooth
            };
            let terms = Terms {
                geometry,
                material,
                shadow,
                indirect,
            };
            // A plane casts no shadow and bounces nothing.
            let flat = shadow == Shadow::None && indirect == Bounced::None && factor > base;
            let plane = flat.then_some(Terms {
                geometry: Geometry::Plane,
                ..terms
            });
            plane
                .into_iter()
                .chain([terms])
                .map(move |terms| (terms, factor))
        })
    })
}

/// What leaving out shadows and bounced light changes.
fn shadows_and_bounces(glance: &Glance, terms: Terms) -> f32 {
    let changes = &glance.changes;
    let shadow = match terms.shadow {
        Shadow::None => changes.shadow[0].hypot(changes.shadow[1]),
        Shadow::Swept => changes.shadow[1],
        Shadow::Network => 0.0,
    };
    let indirect = match terms.indirect {
        Bounced::None => changes.indirect[0],
        Bounced::Constant => changes.indirect[1],
        Bounced::Predicted => 0.0,
    };
    shadow.hypot(indirect)
}

/// Highlights that held-out samples speak against, by both rules, may be missed half as much.
fn unasked(glance: &Glance) -> f32 {
    let matte = |rule| glance.material.pick(rule) == 0;
    let measured = !glance.material.held_out.is_empty();
    if measured && matte(Rule::OneStandardError) && matte(Rule::Bic) {
        0.5
    } else {
        1.0
    }
}

/// What all that `terms` leave out changes together, on a grid `coarser` times as coarse as it may be.
fn change(glance: &Glance, terms: Terms, coarser: usize) -> f32 {
    let material = match terms.material {
        Material::Matte => glance.changes.material[0] * unasked(glance),
        Material::OneRoughness => glance.changes.material[1],
        Material::Varying => 0.0,
    };
    with_material(material, glance, terms, coarser)
}

/// The same of what is worth some time: highlights that held-out samples speak against are not.
fn missed(glance: &Glance, terms: Terms, coarser: usize) -> f32 {
    if unasked(glance) < 1.0 {
        with_material(0.0, glance, terms, coarser)
    } else {
        change(glance, terms, coarser)
    }
}

fn with_material(material: f32, glance: &Glance, terms: Terms, coarser: usize) -> f32 {
    let changes = &glance.changes;
    if terms.geometry == Geometry::Plane {
        // Shadows and bounced light go with the shape, and were counted with it.
        return changes.geometry[0].hypot(material);
    }
    let grid = if coarser > 1 {
        changes.geometry[1] * (coarser as f32 - 1.0)
    } else {
        0.0
    };
    grid.hypot(material)
        .hypot(shadows_and_bounces(glance, terms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parsimony::{Changes, cost::Line};

    const WORK: Workload = Workload {
        pixels: 262_144,
        working_pixels: 2_100_000,
        lamps: 1,
    };

    /// Every step a line of its own.
    fn costs() -> CostModel {
        let line = |per_megapixel_ms| Line {
            fixed_ms: 0.2,
            per_megapixel_ms,
        };
        CostModel {
            radiometry: line(10.0),
            alignment: line(30.0),
            reduce: line(1.0),
            registration: line(20.0),
            flat: line(40.0),
            shape: line(60.0),
            one_roughness: line(30.0),
            varying: line(10.0),
            slabs: line(10.0),
            obscurance: line(30.0),
            lamp: line(2.0),
            sweep: line(4.0),
            correction: line(8.0),
            enlarge: line(3.0),
            glance: line(10.0),
            surfaces_network: line(100.0),
            light_network: line(40.0),
            network_load_ms: 50.0,
        }
    }

    /// A scene in which only what is named changes anything.
    fn glance(changes: Changes) -> Glance {
        Glance {
            tolerance: 0.01,
            changes,
            ..Glance::typical()
        }
    }

    fn sufficient(changes: Changes) -> Terms {
        Plan::sufficient(&glance(changes), Criterion::Visible, &costs(), WORK, true).terms
    }

    #[test]
    fn a_scene_in_which_nothing_matters_gets_the_fewest_terms_and_clutter_all() {
        assert_eq!(sufficient(Changes::default()), Terms::FEWEST);
        let all = [0.05; 2];
        let clutter = Changes {
            geometry: all,
            material: all,
            shadow: all,
            indirect: all,
        };
        assert_eq!(sufficient(clutter), Terms::EVERYTHING);
    }

    #[test]
    fn a_term_is_kept_for_what_it_changes_and_no_other() {
        let relief = Changes {
            geometry: [0.05, 0.05],
            shadow: [0.05, 0.001],
            ..Changes::default()
        };
        let terms = sufficient(relief);
        assert_eq!(terms.geometry, Geometry::Full);
        assert_eq!(terms.shadow, Shadow::Swept);
        assert_eq!(terms.material, Material::Matte);
        assert_eq!(terms.indirect, Bounced::None);
    }

    #[test]
    fn changes_that_are_small_one_by_one_are_not_dropped_together() {
        // Any two of 0.006 stay under 0.01, all three do not.
        let several = Changes {
            geometry: [1.0, 1.0],
            material: [0.006; 2],
            shadow: [1.0, 0.006],
            indirect: [0.006; 2],
        };
        // Each of them is worth leaving out.
        let line = |per_megapixel_ms| Line {
            fixed_ms: 0.2,
            per_megapixel_ms,
        };
        let costs = CostModel {
            one_roughness: line(600.0),
            obscurance: line(600.0),
            light_network: line(600.0),
            ..costs()
        };
        let plan = Plan::sufficient(&glance(several), Criterion::Visible, &costs, WORK, true);
        assert!(plan.change <= 0.01 && plan.change > 0.008, "{plan:?}");
    }

    #[test]
    fn one_roughness_for_all_is_for_those_who_count_milliseconds() {
        // Something shines, and nothing says that it does not shine alike everywhere.
        let shining = glance(Changes {
            geometry: [1.0, 1.0],
            material: [1.0, 0.0],
            shadow: [1.0, 1.0],
            indirect: [1.0, 1.0],
        });
        let costs = CostModel {
            varying: Line {
                fixed_ms: 1000.0,
                per_megapixel_ms: 0.0,
            },
            ..costs()
        };
        let plan = Plan::sufficient(&shining, Criterion::Visible, &costs, WORK, true);
        assert_eq!(plan.terms.material, Material::Varying);
        let hurried = Plan::within(500.0, &shining, &costs, WORK, true);
        assert_eq!(hurried.terms.material, Material::OneRoughness);
    }

    #[test]
    fn what_hardly_saves_time_is_kept() {
        let bounced = Changes {
            geometry: [1.0, 1.0],
            material: [1.0, 1.0],
            shadow: [1.0, 1.0],
            indirect: [0.009, 0.009],
        };
        let indirect = |obscurance: f64| {
            let costs = CostModel {
                obscurance: Line {
                    fixed_ms: obscurance,
                    per_megapixel_ms: 0.0,
                },
                ..costs()
            };
            let found = glance(bounced);
            let plan = Plan::sufficient(&found, Criterion::Visible, &costs, WORK, true);
            plan.terms.indirect
        };
        assert_eq!(indirect(1.0), Bounced::Predicted);
        assert_eq!(indirect(1000.0), Bounced::None);
    }

    #[test]
    fn less_time_never_buys_a_better_picture_and_is_kept() {
        let typical = Glance::typical();
        let mut last = 0.0;
        for budget_ms in [200.0, 100.0, 60.0, 40.0, 25.0, 15.0, 8.0] {
            let plan = Plan::within(budget_ms, &typical, &costs(), WORK, true);
            assert!(plan.expected_ms <= budget_ms, "{budget_ms}: {plan:?}");
            assert!(plan.change >= last, "{budget_ms}: {plan:?}");
            last = plan.change;
        }
    }

    #[test]
    fn a_budget_under_the_cheapest_answer_is_refused_with_what_that_takes() {
        let least = Plan::check(0.5, &costs(), WORK).unwrap_err();
        assert!(Plan::check(1.01 * least.least_ms, &costs(), WORK).is_ok());
        assert!(least.to_string().contains("0.5 ms"), "{least}");
    }
}
