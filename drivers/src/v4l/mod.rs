//! V4L2 cameras: a color node, a depth node and a flash as one device.
//!
//! A camera file (`config/cameras/*.toml`, or the short form in the address) says which nodes
//! belong together. Nothing stays open between sessions: every start opens, negotiates, maps and
//! locks anew, so a device that was unplugged works again as soon as its node is back.

mod bracket;
mod buffers;
mod camera;
mod clock;
mod exposure;
mod flow;
mod format;
mod geometry;
mod plan;
mod stream;
mod unpack;

pub use plan::{CameraPlan, Plan, Stamp};

use crate::{
    calibration::Rig,
    device::{Device, DeviceInfo, DriverError, Settings, Stream},
};
use camera::Camera;

/// A camera made of V4L2 nodes.
#[derive(Debug)]
pub struct V4l {
    plan: Plan,
    info: DeviceInfo,
    rig: Rig,
}

impl V4l {
    /// Opens what stands behind `v4l:`, negotiates with its nodes, and lets go of them again.
    ///
    /// # Errors
    /// As [`Plan::parse`]; [`DriverError::NoDevice`] for a node that is missing, busy or not ours to
    /// open, saying what to do; [`DriverError::Setting`] for a format or size it does not offer, with
    /// those it does; [`DriverError::Malformed`] for one that cannot be what it claims.
    pub fn open(address: &str) -> Result<Self, DriverError> {
        let plan = Plan::parse(address)?;
        let color = Camera::open(&plan.color, false)?;
        let depth = plan
            .depth
            .as_ref()
            .map(|plan| Camera::open(plan, true))
            .transpose()?;
        let rig = rig_of(&plan, &color, depth.as_ref())?;
        let model = plan.model.clone().unwrap_or_else(|| {
            let cards = [Some(&color), depth.as_ref()].into_iter().flatten();
            let mut cards: Vec<&str> = cards.map(|c| c.capabilities.card.as_str()).collect();
            cards.dedup();
            cards.join(" and ")
        });
        Ok(Self {
            info: DeviceInfo {
                address: format!("v4l:{address}"),
                driver: format!("v4l ({})", color.capabilities.driver),
                model,
                finite: false,
            },
            plan,
            rig,
        })
    }
}

fn rig_of(plan: &Plan, color: &Camera, depth: Option<&Camera>) -> Result<Rig, DriverError> {
    geometry::rig(
        plan.geometry.as_ref(),
        color.size(),
        depth.map(Camera::size),
    )
    .map_err(|reason| DriverError::Setting {
        device: color.node.path().display().to_string(),
        setting: "rig",
        reason,
    })
}

impl Device for V4l {
    fn info(&self) -> DeviceInfo {
        self.info.clone()
    }

    fn rig(&self) -> Rig {
        self.rig
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        exposure::check(settings, &self.info.address)?;
        let color = Camera::open(&self.plan.color, false)?;
        let depth = self
            .plan
            .depth
            .as_ref()
            .map(|plan| Camera::open(plan, true))
            .transpose()?;
        if rig_of(&self.plan, &color, depth.as_ref())? != self.rig {
            return Err(DriverError::Setting {
                device: self.info.address.clone(),
                setting: "width",
                reason: "another size was granted than when the device was opened; open it again"
                    .into(),
            });
        }
        let stream =
            stream::Running::start(&self.plan, &self.info.address, settings, color, depth)?;
        Ok(Box::new(stream))
    }
}

/// Cameras that are plugged in: each color node, with the depth node of the same device.
pub fn list() -> Vec<DeviceInfo> {
    let nodes = camera::nodes();
    let depth_of = |wanted: &str| {
        nodes.iter().find(|(path, found)| {
            found.bus == wanted
                && camera::understood(path, found)
                    .iter()
                    .any(|format| format.code.0 == *b"Z16 ")
        })
    };
    nodes
        .iter()
        .filter(|(path, found)| {
            camera::understood(path, found)
                .iter()
                .any(|format| !format.is_single())
        })
        .filter_map(|(path, found)| {
            let depth = depth_of(&found.bus).filter(|(depth, _)| depth != path);
            let address = match depth {
                Some((depth, _)) => {
                    format!("{}?depth.node={}", path.display(), depth.display())
                }
                None => path.display().to_string(),
            };
            // What cannot be opened now cannot be listed as something that can.
            V4l::open(&address).ok().map(|device| device.info)
        })
        .collect()
}
