//! A lamp on a line of a GPIO character device.

use super::{Plan, during, guard::Darkness, latency, lit_by_switch, reach_of_switch};
use crate::{
    device::DriverError,
    lamp::{Lamp, Lit, Moment, Reach},
    node::opening,
};
use gpiocdev::{Request, line::Value};
use std::{
    os::fd::AsRawFd,
    path::{Path, PathBuf},
    time::Duration,
};

/// The lamp. The line is held as an output, and inactive, from opening to closing; a line that is
/// let go keeps or loses its level as its chip likes, so a lamp should be wired to be dark without.
struct Gpio {
    chip: PathBuf,
    request: Request,
    plan: Plan,
}

/// Opens the lamp, dark, and says how it is kept so.
pub(super) fn open(plan: &Plan) -> Result<(Box<dyn Lamp>, Darkness), DriverError> {
    let lamp = Gpio::open(plan)?;
    let darkness = Darkness::Line(lamp.request.as_raw_fd());
    Ok((Box::new(lamp), darkness))
}

impl Gpio {
    /// Takes the line, dark.
    fn open(plan: &Plan) -> Result<Self, DriverError> {
        let chip = plan.node.as_deref().unwrap_or(Path::new("/dev/gpiochip0"));
        // Says plainly what is missing; the library's errors speak of its own calls.
        std::fs::File::open(chip).map_err(|error| opening(chip, error))?;
        let mut builder = Request::builder();
        builder
            .on_chip(chip)
            .with_consumer("captured flash")
            .with_line(plan.line)
            .as_output(Value::Inactive);
        if plan.active_low {
            builder.as_active_low();
        }
        let request = builder.request().map_err(|error| DriverError::NoDevice {
            address: format!("{} line {}", chip.display(), plan.line),
            reason: format!(
                "{error}; flash.line names a line that nobody uses (`gpioinfo` shows them)"
            ),
        })?;
        Ok(Self {
            chip: chip.to_owned(),
            request,
            plan: plan.clone(),
        })
    }

    fn set(&self, value: Value) -> Result<(), DriverError> {
        self.request
            .set_value(self.plan.line, value)
            .map(drop)
            .map_err(|error| DriverError::Hardware {
                device: self.chip.display().to_string(),
                problem: format!("line {}: {error}", self.plan.line),
                remedy: "start again; if it comes back, check the GPIO chip",
            })
    }
}

impl Lamp for Gpio {
    fn reach(&self) -> Reach {
        reach_of_switch(&self.plan)
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        let (on, off) = (|| self.set(Value::Active), || self.set(Value::Inactive));
        lit_by_switch(&self.plan, flash, on, off)
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        Ok(during(latency(&self.plan), || self.set(Value::Inactive))?.0)
    }
}

impl Drop for Gpio {
    fn drop(&mut self) {
        // Nobody is left to hear of a failure.
        drop(self.set(Value::Inactive));
    }
}
