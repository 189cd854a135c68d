//! A V4L2 flash subdevice: mode, strobe, timeout, intensity, faults, external strobe.

use super::{Mode, Plan, during, guard::Darkness, latency, longest};
use crate::{
    device::DriverError,
    lamp::{Lamp, Lit, Moment, Reach},
    node::{Control, FLASH, Node, nodes_with_function, opening, refused},
};
use std::{os::fd::AsRawFd, path::PathBuf, time::Duration};
use v4l::sys;

/// `V4L2_FLASH_LED_MODE_…`.
const DARK: i64 = 0;
const STROBE: i64 = 1;
const TORCH: i64 = 2;
/// `V4L2_FLASH_STROBE_SOURCE_…`.
const SOFTWARE: i64 = 0;
const EXTERNAL: i64 = 1;
/// Timers of flash chips are this much off, as a part of the time (LM3554 and AS3645A: 10 %).
const TIMER_ERROR: f64 = 0.1;
/// A kernel timer ends up to three ticks of a 250 Hz kernel late.
const TICKS: Duration = Duration::from_millis(12);

/// `V4L2_FLASH_FAULT_…` and what each means.
const FAULTS: [(u32, &str); 9] = [
    (sys::V4L2_FLASH_FAULT_OVER_VOLTAGE, "over voltage"),
    (sys::V4L2_FLASH_FAULT_TIMEOUT, "its timeout ended it"),
    (sys::V4L2_FLASH_FAULT_OVER_TEMPERATURE, "over temperature"),
    (sys::V4L2_FLASH_FAULT_SHORT_CIRCUIT, "short circuit"),
    (sys::V4L2_FLASH_FAULT_OVER_CURRENT, "over current"),
    (sys::V4L2_FLASH_FAULT_INDICATOR, "indicator failure"),
    (sys::V4L2_FLASH_FAULT_UNDER_VOLTAGE, "under voltage"),
    (sys::V4L2_FLASH_FAULT_INPUT_VOLTAGE, "input voltage too low"),
    (
        sys::V4L2_FLASH_FAULT_LED_OVER_TEMPERATURE,
        "LED over temperature",
    ),
];
/// The end of a flash by its timeout is what is wanted here.
const WANTED: u32 = sys::V4L2_FLASH_FAULT_TIMEOUT;

/// The lamp. While it is open the kernel refuses changes through `/sys/class/leds`.
struct Subdevice {
    node: Node,
    plan: Plan,
    mode: Control,
    strobe: Option<Control>,
    stop: Option<Control>,
    source: Option<Control>,
    timeout: Option<Control>,
    faults: Option<Control>,
    /// Longest timeout that neither chip nor plan exceeds.
    longest: Duration,
}

/// Opens the lamp, dark, and says how it is kept so.
pub(super) fn open(plan: &Plan) -> Result<(Box<dyn Lamp>, Darkness), DriverError> {
    let lamp = Subdevice::open(plan)?;
    let darkness = Darkness::Control {
        node: lamp.node.as_raw_fd(),
        id: lamp.mode.id,
        value: DARK as i32,
    };
    Ok((Box::new(lamp), darkness))
}

impl Subdevice {
    /// Opens it, sets its intensity, and makes sure that it is dark.
    fn open(plan: &Plan) -> Result<Self, DriverError> {
        let path = match &plan.node {
            Some(path) => path.clone(),
            None => only_flash()?,
        };
        let node = Node::open(&path).map_err(|error| opening(&path, error))?;
        let setting = |reason: &str| DriverError::Setting {
            device: path.display().to_string(),
            setting: "flash.mode",
            reason: reason.to_owned(),
        };
        let control = |id| node.control(id);
        let mode = control(sys::V4L2_CID_FLASH_LED_MODE)
            .ok_or_else(|| setting("it is no flash; flash.node names another subdevice"))?;
        let timeout = control(sys::V4L2_CID_FLASH_TIMEOUT);
        let strobe = control(sys::V4L2_CID_FLASH_STROBE);
        let source = control(sys::V4L2_CID_FLASH_STROBE_SOURCE);
        if plan.mode == Mode::Strobe && !plan.external && strobe.is_none() {
            return Err(setting("it has no strobe; set flash.mode to torch"));
        }
        if plan.external
            && source
                .as_ref()
                .is_none_or(|source| source.greatest < EXTERNAL)
        {
            return Err(setting(
                "it has no external strobe; set flash.external to false",
            ));
        }
        let bound = timeout.as_ref().map_or(Duration::MAX, |timeout| {
            Duration::from_micros(u64::try_from(timeout.greatest).unwrap_or(0))
        });
        let mut lamp = Self {
            stop: control(sys::V4L2_CID_FLASH_STROBE_STOP),
            faults: control(sys::V4L2_CID_FLASH_FAULT),
            longest: longest(plan).min(bound),
            plan: plan.clone(),
            mode,
            strobe,
            source,
            timeout,
            node,
        };
        if let Some(wanted) = plan.intensity {
            let id = match plan.mode {
                Mode::Strobe => sys::V4L2_CID_FLASH_INTENSITY,
                Mode::Torch => sys::V4L2_CID_FLASH_TORCH_INTENSITY,
            };
            let intensity = lamp
                .node
                .control(id)
                .ok_or_else(|| setting("its intensity is fixed; leave flash.intensity out"))?;
            lamp.set(
                &intensity,
                intensity.nearest(wanted),
                "setting the flash's intensity",
            )?;
        }
        lamp.rest()?;
        Ok(lamp)
    }

    /// Whether a timeout of the chip ends each flash.
    fn is_timed(&self) -> bool {
        self.plan.mode == Mode::Strobe && !self.plan.external && self.timeout.is_some()
    }

    fn set(&self, control: &Control, value: i64, what: &'static str) -> Result<i64, DriverError> {
        self.node
            .set(control, value)
            .map_err(|error| refused(self.node.path(), what, error))
    }

    /// Dark, and ready to be fired.
    fn rest(&mut self) -> Result<(), DriverError> {
        if let Some(source) = &self.source {
            self.set(source, SOFTWARE, "disarming the flash")?;
        }
        let ready = match self.plan.mode {
            Mode::Strobe => STROBE,
            Mode::Torch => DARK,
        };
        self.set(&self.mode, ready, "setting the flash's mode")?;
        Ok(())
    }

    /// Reads what went wrong, which clears it.
    fn check_faults(&self) -> Result<(), DriverError> {
        let Some(faults) = &self.faults else {
            return Ok(());
        };
        let bits = self
            .node
            .value(faults)
            .map_err(|error| refused(self.node.path(), "reading the flash's faults", error))?;
        let bits = bits as u32 & !WANTED;
        if bits == 0 {
            return Ok(());
        }
        let named = FAULTS.iter().filter(|(bit, _)| bits & bit != 0);
        let names: Vec<&str> = named.map(|(_, name)| *name).collect();
        Err(DriverError::Hardware {
            device: self.node.path().display().to_string(),
            problem: format!("flash fault {bits:#x}: {}", names.join(", ")),
            remedy: "let it cool, and check its supply and its LED",
        })
    }

    fn light(&self, flash: Duration) -> Result<Duration, DriverError> {
        if self.plan.external {
            if let Some(source) = &self.source {
                self.set(source, EXTERNAL, "arming the flash")?;
            }
            return Ok(flash);
        }
        if self.plan.mode == Mode::Torch {
            self.set(&self.mode, TORCH, "lighting the torch")?;
            return Ok(flash);
        }
        let mut granted = flash;
        if let Some(timeout) = &self.timeout {
            // Up to the next step, so that light lasts though the timer runs fast.
            let wanted = flash.mul_f64(1.0 + TIMER_ERROR).min(self.longest);
            let micros = i64::try_from(wanted.as_micros()).unwrap_or(i64::MAX);
            let mut value = timeout.nearest(micros);
            if value < micros && value + timeout.step <= timeout.greatest {
                value += timeout.step;
            }
            let got = self.set(timeout, value, "setting the flash's timeout")?;
            granted = Duration::from_micros(u64::try_from(got).unwrap_or(0));
            if granted > self.longest.mul_f64(1.0 + TIMER_ERROR) {
                return Err(DriverError::Hardware {
                    device: self.node.path().display().to_string(),
                    problem: format!(
                        "its shortest timeout is {granted:?}, and {:?} is allowed",
                        self.longest
                    ),
                    remedy: "raise flash.longest_seconds",
                });
            }
        }
        if let Some(strobe) = &self.strobe {
            self.set(strobe, 1, "firing the flash")?;
        }
        Ok(granted)
    }
}

impl Lamp for Subdevice {
    fn reach(&self) -> Reach {
        Reach {
            // The timer may run fast.
            longest: self.longest.div_f64(1.0 + TIMER_ERROR),
            bounded_by_kernel: self.is_timed(),
            latency: latency(&self.plan),
        }
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        self.check_faults()?;
        let fired = during(latency(&self.plan), || self.light(flash));
        // A fault may have kept it dark, or put it out.
        let checked = fired.and_then(|fired| self.check_faults().map(|()| fired));
        match checked {
            Ok((from, granted)) => Ok(Lit {
                from,
                until: Moment {
                    earliest: from.earliest.after(granted.mul_f64(1.0 - TIMER_ERROR)),
                    latest: from
                        .latest
                        .after(granted.mul_f64(1.0 + TIMER_ERROR) + TICKS),
                },
            }),
            Err(error) => {
                // The first error is the one to tell.
                drop(self.put_out());
                Err(error)
            }
        }
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        let out = during(latency(&self.plan), || {
            if let Some(stop) = self.stop.as_ref().filter(|_| self.is_timed()) {
                self.set(stop, 1, "stopping the flash")?;
                return Ok(());
            }
            self.rest()
        })?;
        Ok(out.0)
    }
}

impl Drop for Subdevice {
    fn drop(&mut self) {
        // Nobody is left to hear of a failure; the chip's timeout holds.
        drop(self.put_out());
        drop(self.set(&self.mode, DARK, "setting the flash's mode"));
    }
}

fn only_flash() -> Result<PathBuf, DriverError> {
    let refuse = |reason: String| DriverError::NoDevice {
        address: "flash subdevice".into(),
        reason,
    };
    let found = nodes_with_function(FLASH);
    match &found[..] {
        [(_, path)] => Ok(path.clone()),
        [] => Err(refuse(
            "no media device has a flash; give flash.node, or join the group of /dev/media*".into(),
        )),
        many => {
            let names: Vec<String> = many
                .iter()
                .map(|(name, path)| format!("{} ({name})", path.display()))
                .collect();
            Err(refuse(format!(
                "there are several; give flash.node: {}",
                names.join(", ")
            )))
        }
    }
}
