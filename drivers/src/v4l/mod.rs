//! V4L2 cameras: a color node, a depth node, perhaps one of its amplitude, and a flash as one device.
//!
//! A camera file (`config/cameras/*.toml`, or the short form in the address) says which nodes
//! belong together. Nothing stays open between sessions: every start opens, negotiates, maps and
//! locks anew, so a device that was unplugged works again as soon as its node is back.

mod bracket;
mod buffers;
mod camera;
pub(crate) mod claim;
mod clock;
mod exposure;
mod flow;
mod format;
mod geometry;
mod packed;
mod pairs;
mod plan;
mod stream;
mod unpack;

pub use plan::{CameraPlan, Plan, Stamp};

use crate::{
    calibration::Rig,
    device::{Device, DeviceInfo, DriverError, Settings, Stream},
};
use camera::Camera;
use std::path::{Path, PathBuf};

/// A camera made of V4L2 nodes.
#[derive(Debug)]
pub struct V4l {
    plan: Plan,
    info: DeviceInfo,
    rig: Rig,
    /// The nodes as they were found.
    nodes: Vec<PathBuf>,
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
        let cameras = Cameras::open(&plan)?;
        let rig = cameras.rig(&plan)?;
        let model = plan.model.clone().unwrap_or_else(|| {
            let cards = cameras.all().map(|c| c.capabilities.card.as_str());
            let mut cards: Vec<&str> = cards.collect();
            cards.dedup();
            cards.join(" and ")
        });
        let nodes = cameras.all().map(|camera| camera.node.path().to_owned());
        Ok(Self {
            nodes: nodes.collect(),
            info: DeviceInfo {
                address: format!("v4l:{address}"),
                driver: format!("v4l ({})", cameras.color.capabilities.driver),
                model,
                finite: false,
            },
            plan,
            rig,
        })
    }
}

/// The nodes of a plan, negotiated, before they stream.
struct Cameras {
    color: Camera,
    depth: Option<Camera>,
    amplitude: Option<Camera>,
}

impl Cameras {
    fn open(plan: &Plan) -> Result<Self, DriverError> {
        let single = |plan: &Option<CameraPlan>| {
            let camera = plan.as_ref().map(|plan| Camera::open(plan, true));
            camera.transpose()
        };
        let cameras = Self {
            color: Camera::open(&plan.color, false)?,
            depth: single(&plan.depth)?,
            amplitude: single(&plan.amplitude)?,
        };
        if let (Some(depth), Some(amplitude)) = (&cameras.depth, &cameras.amplitude)
            && depth.size() != amplitude.size()
        {
            let ((dw, dh), (aw, ah)) = (depth.size(), amplitude.size());
            return Err(DriverError::Setting {
                device: amplitude.node.path().display().to_string(),
                setting: "amplitude",
                reason: format!(
                    "it delivers {aw}×{ah}, and depth is {dw}×{dh}; ask for the same size of both"
                ),
            });
        }
        Ok(cameras)
    }

    fn all(&self) -> impl Iterator<Item = &Camera> {
        std::iter::once(&self.color)
            .chain(&self.depth)
            .chain(&self.amplitude)
    }

    fn rig(&self, plan: &Plan) -> Result<Rig, DriverError> {
        geometry::rig(
            plan.geometry.as_ref().map(|known| &known.rig),
            self.color.size(),
            self.depth.as_ref().map(Camera::size),
        )
        .map_err(|reason| DriverError::Setting {
            device: self.color.node.path().display().to_string(),
            setting: "rig",
            reason,
        })
    }
}

impl Device for V4l {
    fn info(&self) -> DeviceInfo {
        self.info.clone()
    }

    fn rig(&self) -> Rig {
        self.rig
    }

    fn rig_file(&self) -> Option<&Path> {
        self.plan.rig.as_deref()
    }

    fn presence(&mut self) -> Result<(), DriverError> {
        // The kernel takes a node away with its device. Opening one could wake a camera up.
        match self.nodes.iter().find(|node| !node.exists()) {
            None => Ok(()),
            Some(gone) => Err(DriverError::Unplugged {
                device: gone.display().to_string(),
            }),
        }
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        exposure::check(settings, &self.info.address)?;
        let cameras = Cameras::open(&self.plan)?;
        if cameras.rig(&self.plan)? != self.rig {
            return Err(DriverError::Setting {
                device: self.info.address.clone(),
                setting: "width",
                reason: "another size was granted than when the device was opened; open it again"
                    .into(),
            });
        }
        let stream = stream::Running::start(&self.plan, &self.info.address, settings, cameras)?;
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
