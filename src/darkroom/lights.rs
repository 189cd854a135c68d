//! The developed shot under its lights: by its model, or by the paper's networks.

use super::{
    Answering, Clock, DarkroomError, Order, standing::Standing, surroundings::Surroundings,
};
use crate::{
    develop::Development,
    parsimony::Model,
    relight::{
        Luminaire, Relit,
        enlarge::Mix,
        networks::{Decomposed, Network, NetworkError, Paper, compact::Compact, resampled},
    },
};
use drivers::Plane;

/// One answer per lamp, in their order, and one for the environment, at the photograph's size; `stands` is
/// what stands for either.
pub(super) fn lit(
    order: &Order<'_>,
    stands: (&Standing, Option<&Surroundings>),
    model: &mut Model,
    networks: Option<&Compact>,
    clock: &mut Clock,
    observe: &mut dyn FnMut(&str),
) -> Result<Vec<Relit>, DarkroomError> {
    match order.answering {
        Answering::Closed => by_model(None, order, stands, model, clock, observe),
        Answering::Compact(compact) => {
            let network = Some(compact.light.as_ref());
            by_model(network, order, stands, model, clock, observe)
        }
        Answering::Auto(_) => {
            let network = networks.map(|compact| compact.light.as_ref());
            by_model(network, order, stands, model, clock, observe)
        }
        Answering::Paper(paper) => Ok(by_networks(
            paper,
            order,
            stands.1,
            &mut model.development,
            clock,
            observe,
        )?),
    }
}

fn by_model(
    network: Option<&dyn Network>,
    order: &Order<'_>,
    (standing, around): (&Standing, Option<&Surroundings>),
    model: &Model,
    clock: &mut Clock,
    observe: &mut dyn FnMut(&str),
) -> Result<Vec<Relit>, DarkroomError> {
    clock.begin("relight");
    let begins = &mut |index: usize| {
        observe(&format!("light {} of {}", index + 1, order.lamps.len()));
    };
    let mut relit = model.relight_each(&standing.emitters, network, begins)?;
    if let Some(((name, _), around)) = order.environment.zip(around) {
        observe(name);
        clock.begin("environment");
        relit.push(around.relight(&model.development));
    }
    Ok(relit)
}

/// The networks' surfaces take the place of the closed form's.
fn by_networks(
    paper: &Paper,
    order: &Order<'_>,
    around: Option<&Surroundings>,
    development: &mut Development,
    clock: &mut Clock,
    observe: &mut dyn FnMut(&str),
) -> Result<Vec<Relit>, NetworkError> {
    observe("working out surfaces with a network");
    clock.begin("decompose");
    let feed = development.feed(order.shot, paper.variant);
    let scene = paper.decompose(&feed)?;
    take_surfaces(development, &scene);
    clock.begin("relight");
    let mut relit = Vec::with_capacity(order.lamps.len());
    // Near ones were refused.
    let distant = order.lamps.iter().filter_map(|lamp| match lamp {
        Luminaire::Distant(lamp) => Some(lamp),
        Luminaire::Near(_) | Luminaire::Area(_) => None,
    });
    for (index, lamp) in distant.enumerate() {
        observe(&format!("light {} of {}", index + 1, order.lamps.len()));
        let answer = paper.relight(&feed, &scene, lamp)?;
        relit.push(development.finish_fed(&feed, answer));
    }
    if let Some(((name, _), around)) = order.environment.zip(around) {
        clock.begin("environment");
        let count = around.set.count();
        let begins = &mut |number: usize| {
            observe(&format!("{name}: light {} of {count}", number + 1));
        };
        let answer = paper.superposed(&feed, &scene, around.set.lamps(), begins)?;
        relit.push(development.finish_fed(&feed, answer));
    }
    Ok(relit)
}

fn take_surfaces(development: &mut Development, found: &Decomposed) {
    let scene = &mut development.scene;
    let answered = scene.albedo.map(Mix::is_known);
    scene.albedo = where_answered(&found.albedo(), &answered);
    scene.normal = where_answered(&found.normal(), &answered);
    scene.roughness = where_answered(&found.roughness(), &answered);
}

/// A network's plane on the working grid. It answers everywhere, also where there is nothing to ask.
fn where_answered<T: Mix>(found: &Plane<T>, answered: &Plane<bool>) -> Plane<T> {
    let mut plane = resampled(found, answered.size());
    let samples = plane.samples_mut().iter_mut();
    for (sample, answered) in samples.zip(answered.samples()) {
        if !answered {
            *sample = T::UNKNOWN;
        }
    }
    plane
}
