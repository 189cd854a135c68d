//! Flash lamps: how each kind is lit, and what keeps every one of them from staying lit.
//!
//! Three bounds lie around a lamp. Hardware or kernel end a pulse where they can (flash timeout of a
//! subdevice or LED, the `transient` trigger of a plain LED). Where they cannot, a thread of the
//! driver does (`fuse`), and should this process be stopped or killed, another one that watches over it
//! (`guard`). Around them, a budget keeps the heat down (`budget`). Each lamp goes dark when it is dropped.

mod budget;
mod control;
mod fuse;
mod gpio;
mod guard;
mod led;
pub mod metering;
mod plan;
mod subdevice;

pub use plan::{Kind, Mode, Plan};

use crate::{
    device::DriverError,
    frame::Timestamp,
    lamp::{Lamp, Lit, Moment, Reach},
};
use std::{path::Path, time::Duration};

/// Opens the lamp of a plan, dark; `None` when the plan has none.
///
/// `camera` is the node whose control is used where the plan names no node.
///
/// # Errors
/// [`DriverError::NoDevice`] when it is not there or may not be opened, saying what to do;
/// [`DriverError::Setting`] for something it cannot do; else as [`Lamp::fire`].
pub fn open(plan: &Plan, camera: &Path) -> Result<Option<Box<dyn Lamp>>, DriverError> {
    let (lamp, darkness): (Box<dyn Lamp>, _) = match plan.kind {
        Kind::None => return Ok(None),
        Kind::Subdevice => subdevice::open(plan)?,
        Kind::Led => led::open(plan)?,
        Kind::Gpio => gpio::open(plan)?,
        Kind::Control => control::open(plan, camera)?,
    };
    let reach = lamp.reach();
    let lamp = if reach.bounded_by_kernel {
        lamp
    } else {
        let guarded = guard::Guarded::new(lamp, darkness, reach.longest)?;
        Box::new(fuse::Fuse::new(Box::new(guarded))?)
    };
    Ok(Some(Box::new(budget::Budget::new(lamp, plan))))
}

/// The moment at which `act` took effect: it began before and was over after.
fn during<T>(
    latency: Duration,
    act: impl FnOnce() -> Result<T, DriverError>,
) -> Result<(Moment, T), DriverError> {
    let earliest = Timestamp::now();
    let answer = act()?;
    let latest = Timestamp::now().after(latency);
    Ok((Moment { earliest, latest }, answer))
}

/// What a plan allows at once.
fn longest(plan: &Plan) -> Duration {
    Duration::from_secs_f64(plan.longest_seconds)
}

/// See [`Plan::latency_seconds`].
fn latency(plan: &Plan) -> Duration {
    Duration::from_secs_f64(plan.latency_seconds.max(0.0))
}

/// What reaches a lamp that is a switch: nothing but this program ends its light.
fn reach_of_switch(plan: &Plan) -> Reach {
    Reach {
        longest: longest(plan),
        bounded_by_kernel: false,
        latency: latency(plan),
    }
}

/// Lights a switch by `on`, for whoever puts it out after `flash`; by `off` at once where that failed.
fn lit_by_switch(
    plan: &Plan,
    flash: Duration,
    on: impl FnOnce() -> Result<(), DriverError>,
    off: impl FnOnce() -> Result<(), DriverError>,
) -> Result<Lit, DriverError> {
    // The first error is the one to tell.
    let (from, ()) = during(latency(plan), on).inspect_err(|_| drop(off()))?;
    Ok(Lit {
        from,
        until: Moment {
            earliest: from.earliest.after(flash),
            latest: from.latest.after(flash).after(latency(plan)),
        },
    })
}
