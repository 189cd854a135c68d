//! What must not change between the frames of a shot: exposure, gain, white balance, focus.

use super::plan::CameraPlan;
use crate::{
    device::{DriverError, Settings},
    frame::Exposure,
    node::{CONTROL_CHANGED, Control, Node, SOURCE_CHANGED, refused},
};
use v4l::sys;

/// Seconds of one step of `exposure_time_absolute`, as the kernel defines it.
const ABSOLUTE_SECONDS: f64 = 1e-4;
/// `V4L2_EXPOSURE_MANUAL`.
const MANUAL: i64 = 1;

/// Automatic controls, what turns each off, and the control whose value then stays.
const AUTOMATIC: [(u32, i64, u32); 5] = [
    (
        sys::V4L2_CID_EXPOSURE_AUTO,
        MANUAL,
        sys::V4L2_CID_EXPOSURE_ABSOLUTE,
    ),
    (
        sys::V4L2_CID_EXPOSURE_AUTO_PRIORITY,
        0,
        sys::V4L2_CID_EXPOSURE_ABSOLUTE,
    ),
    (sys::V4L2_CID_AUTOGAIN, 0, sys::V4L2_CID_GAIN),
    (
        sys::V4L2_CID_AUTO_WHITE_BALANCE,
        0,
        sys::V4L2_CID_WHITE_BALANCE_TEMPERATURE,
    ),
    (sys::V4L2_CID_FOCUS_AUTO, 0, sys::V4L2_CID_FOCUS_ABSOLUTE),
];

/// The exposure of a color camera, locked.
#[derive(Debug)]
pub(super) struct Locked {
    time: Option<(Control, f64)>,
    gain: Option<(Control, Option<f64>)>,
    /// Stands for a time that the device does not tell.
    frame_seconds: f64,
    /// What was read back last.
    pub granted: Exposure,
}

/// Checks what was asked for, whatever the device.
pub(super) fn check(settings: &Settings, device: &str) -> Result<(), DriverError> {
    let refuse = |setting, reason: String| DriverError::Setting {
        device: device.to_owned(),
        setting,
        reason,
    };
    let good = |value: Option<f32>| value.is_none_or(|v| v.is_finite() && v > 0.0);
    if !good(settings.exposure_seconds) {
        let reason = format!("{:?}; it must be above 0", settings.exposure_seconds);
        return Err(refuse("exposure_seconds", reason));
    }
    if !good(settings.gain) {
        return Err(refuse(
            "gain",
            format!("{:?}; it must be above 0", settings.gain),
        ));
    }
    settings.check_pattern(device)
}

/// Sets the plan's own controls, by name.
pub(super) fn set_controls(node: &Node, plan: &CameraPlan) -> Result<(), DriverError> {
    if plan.controls.is_empty() {
        return Ok(());
    }
    let all = node.controls();
    for (name, value) in &plan.controls {
        let refuse = |reason: String| DriverError::Setting {
            device: node.path().display().to_string(),
            setting: "controls",
            reason,
        };
        let Some(control) = all.iter().find(|control| control.key() == *name) else {
            let names: Vec<String> = all.iter().map(Control::key).collect();
            return Err(refuse(format!(
                "no control {name:?}; there are {}",
                names.join(", ")
            )));
        };
        let got = node
            .set(control, *value)
            .map_err(|error| refused(node.path(), "setting a control", error))?;
        if got != *value {
            return Err(refuse(format!(
                "{name} = {value} became {got}; it takes {} to {} in steps of {}",
                control.least, control.greatest, control.step
            )));
        }
    }
    Ok(())
}

impl Locked {
    /// Turns everything automatic off, keeps the values it had reached, sets what was asked for
    /// and reads back what was granted.
    pub fn lock(
        node: &Node,
        plan: &CameraPlan,
        settings: &Settings,
        frame_seconds: f64,
    ) -> Result<Self, DriverError> {
        for (automatic, off, kept) in AUTOMATIC {
            let Some(switch) = node.control(automatic).filter(|control| !control.fixed) else {
                continue;
            };
            let reached = node.control(kept).and_then(|kept| node.value(&kept).ok());
            set_exactly(node, &switch, off)?;
            // Some cameras fall back to a default when they are no longer automatic.
            if let (Some(value), Some(kept)) = (reached, settable(node, kept)) {
                let value = kept.nearest(value);
                node.set(&kept, value)
                    .map_err(|error| refused(node.path(), "locking a control", error))?;
            }
        }
        let lines = sys::V4L2_CID_EXPOSURE;
        let time = settable(node, sys::V4L2_CID_EXPOSURE_ABSOLUTE)
            .map(|control| {
                (
                    control,
                    plan.exposure_unit_seconds.unwrap_or(ABSOLUTE_SECONDS),
                )
            })
            .or_else(|| settable(node, lines).zip(plan.exposure_unit_seconds));
        let gain = settable(node, sys::V4L2_CID_ANALOGUE_GAIN)
            .or_else(|| settable(node, sys::V4L2_CID_GAIN))
            .map(|control| (control, plan.gain_unit));
        let mut locked = Self {
            time,
            gain,
            frame_seconds,
            granted: Exposure::UNIT,
        };
        locked.set(node, settings.exposure_seconds, settings.gain)?;
        let time = locked.time.iter().map(|(control, _)| control.id);
        let gain = locked.gain.iter().map(|(control, _)| control.id);
        for watched in time.chain(gain) {
            // A device without events says nothing when another program turns its knobs.
            drop(node.subscribe(CONTROL_CHANGED, watched));
        }
        drop(node.subscribe(SOURCE_CHANGED, 0));
        Ok(locked)
    }

    /// Shortest and longest exposure time that can be chosen, seconds; `None` when it cannot.
    pub fn range(&self) -> Option<(f32, f32)> {
        let (control, unit) = self.time.as_ref()?;
        let seconds = |steps: i64| (steps.max(1) as f64 * unit) as f32;
        Some((seconds(control.least), seconds(control.greatest)))
    }

    /// Sets exposure time and gain, and reads back what was granted.
    pub fn set(
        &mut self,
        node: &Node,
        seconds: Option<f32>,
        gain: Option<f32>,
    ) -> Result<(), DriverError> {
        let refuse = |setting, reason: &str| DriverError::Setting {
            device: node.path().display().to_string(),
            setting,
            reason: reason.to_owned(),
        };
        if let Some(seconds) = seconds {
            let (control, unit) = self.time.as_ref().ok_or_else(|| {
                refuse(
                    "exposure_seconds",
                    "it has no exposure control in known units; leave it out, or give \
                     color.exposure_unit_seconds for one that counts lines",
                )
            })?;
            set_near(node, control, f64::from(seconds) / unit)?;
        }
        if let Some(gain) = gain {
            let (control, unit) = match &self.gain {
                Some((control, Some(unit))) => (control, unit),
                _ => {
                    return Err(refuse(
                        "gain",
                        "it has no gain control in known units; leave it out, or give \
                         color.gain_unit",
                    ));
                }
            };
            set_near(node, control, f64::from(gain) / unit)?;
        }
        self.read(node)
    }

    /// Reads exposure time and gain again.
    pub fn read(&mut self, node: &Node) -> Result<(), DriverError> {
        let value = |control: &Control| {
            node.value(control)
                .map_err(|error| refused(node.path(), "reading a control back", error))
        };
        let seconds = match &self.time {
            // A control that reads 0 tells no time.
            Some((control, unit)) => value(control)?.max(1) as f64 * unit,
            None => self.frame_seconds,
        };
        let gain = match &self.gain {
            Some((control, Some(unit))) => value(control)?.max(1) as f64 * unit,
            _ => 1.0,
        };
        self.granted = Exposure {
            seconds: seconds as f32,
            gain: gain as f32,
        };
        Ok(())
    }
}

fn settable(node: &Node, id: u32) -> Option<Control> {
    node.control(id).filter(|control| !control.fixed)
}

fn set_exactly(node: &Node, control: &Control, value: i64) -> Result<(), DriverError> {
    let got = node
        .set(control, value)
        .map_err(|error| refused(node.path(), "turning an automatic control off", error))?;
    if got == value {
        return Ok(());
    }
    Err(DriverError::Setting {
        device: node.path().display().to_string(),
        setting: "automatic controls",
        reason: format!(
            "{} stays {got} instead of {value}; frames of one shot must share it",
            control.name
        ),
    })
}

fn set_near(node: &Node, control: &Control, steps: f64) -> Result<i64, DriverError> {
    // Saturates, which the range then cuts.
    node.set(control, control.nearest(steps.round() as i64))
        .map_err(|error| refused(node.path(), "setting the exposure", error))
}
