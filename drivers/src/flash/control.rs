//! A control of the camera as its lamp: a UVC camera's light, or any control that changes the light.

use super::{Plan, during, guard::Darkness, latency, lit_by_switch, reach_of_switch};
use crate::{
    device::DriverError,
    lamp::{Lamp, Lit, Moment, Reach},
    node::{Control, Node, opening, refused},
};
use std::{os::fd::AsRawFd, path::Path, time::Duration};

/// The lamp. It has a file of its own, so that it works whatever the stream does.
struct ControlLamp {
    node: Node,
    control: Control,
    plan: Plan,
}

/// Opens the lamp, dark, and says how it is kept so.
pub(super) fn open(plan: &Plan, camera: &Path) -> Result<(Box<dyn Lamp>, Darkness), DriverError> {
    let lamp = ControlLamp::open(plan, camera)?;
    let darkness = Darkness::Control {
        node: lamp.node.as_raw_fd(),
        id: lamp.control.id,
        // Within the control's range, which the kernel holds in as many bits.
        value: plan.off as i32,
    };
    Ok((Box::new(lamp), darkness))
}

impl ControlLamp {
    /// Opens the node and finds the control by its name; sets it to dark.
    fn open(plan: &Plan, camera: &Path) -> Result<Self, DriverError> {
        let path = plan.node.as_deref().unwrap_or(camera);
        let node = Node::open(path).map_err(|error| opening(path, error))?;
        let wanted = plan.control.as_deref().unwrap_or_default();
        let controls = node.controls();
        let refuse = |reason: String| DriverError::Setting {
            device: path.display().to_string(),
            setting: "flash.control",
            reason,
        };
        let Some(control) = controls.iter().find(|control| control.key() == wanted) else {
            let names: Vec<String> = controls.iter().map(Control::key).collect();
            return Err(refuse(format!(
                "no control {wanted:?}; there are {}",
                names.join(", ")
            )));
        };
        let inside = |value: i64| (control.least..=control.greatest).contains(&value);
        if control.fixed || !inside(plan.on) || !inside(plan.off) {
            return Err(refuse(format!(
                "{wanted} takes {} to {}{}; flash.on is {} and flash.off {}",
                control.least,
                control.greatest,
                if control.fixed { ", and not now" } else { "" },
                plan.on,
                plan.off
            )));
        }
        let mut lamp = Self {
            control: control.clone(),
            node,
            plan: plan.clone(),
        };
        lamp.put_out()?;
        Ok(lamp)
    }

    fn set(&self, value: i64) -> Result<(), DriverError> {
        let got = self
            .node
            .set(&self.control, value)
            .map_err(|error| refused(self.node.path(), "setting the flash control", error))?;
        if got == value {
            return Ok(());
        }
        Err(DriverError::Hardware {
            device: self.node.path().display().to_string(),
            problem: format!("{} was set to {value} and is {got}", self.control.name),
            remedy: "choose values of flash.on and flash.off that the control keeps",
        })
    }
}

impl Lamp for ControlLamp {
    fn reach(&self) -> Reach {
        reach_of_switch(&self.plan)
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        let (on, off) = (|| self.set(self.plan.on), || self.set(self.plan.off));
        lit_by_switch(&self.plan, flash, on, off)
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        Ok(during(latency(&self.plan), || self.set(self.plan.off))?.0)
    }
}

impl Drop for ControlLamp {
    fn drop(&mut self) {
        // Nobody is left to hear of a failure; a camera that has gone is dark.
        drop(self.set(self.plan.off));
    }
}
