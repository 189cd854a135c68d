//! The door: what a capture device can say, and the devices that say it.
//!
//! The first four modules are vocabulary. The drivers below them use the vocabulary and never
//! each other; this crate is the only place in the project where `unsafe` may live.

mod address;
pub mod admission;
pub mod calibration;
pub mod chance;
pub mod clock;
pub mod contract;
pub mod depthai;
pub mod device;
#[cfg(target_os = "linux")]
pub mod flash;
pub mod flaky;
pub mod frame;
mod jpeg;
pub mod lamp;
#[cfg(target_os = "linux")]
mod node;
#[cfg(feature = "nokhwa")]
pub mod nokhwa;
pub mod open;
pub mod plane;
pub mod recording;
pub mod replay;
pub mod rig_file;
pub mod synthetic;
pub mod trigger;
#[cfg(target_os = "linux")]
pub mod v4l;
pub mod wire;
pub mod witness;

pub use calibration::{Beam, DepthCamera, Distortion, FlashLamp, Intrinsics, Rig, RigidTransform};
pub use device::{Device, DeviceInfo, DriverError, Losses, Settings, Stream};
pub use frame::{
    BayerPattern, ColorFrame, DepthFrame, Exposure, Frame, Illumination, Pixels, Timestamp,
    Transfer,
};
pub use jpeg::{jpeg, luma_of_jpeg};
pub use open::{list, open};
pub use plane::{Plane, SizeMismatch};
