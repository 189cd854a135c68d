//! Addresses → devices: the one place that knows every driver.

use crate::{
    depthai::{self, DepthAi},
    device::{Device, DeviceInfo, DriverError},
    flaky::{Faults, Flaky},
    replay::Replay,
    synthetic::{Layout, Options, Synthetic},
};

/// What an address looks like, for errors and for `--help`.
pub const ADDRESSES: &str = "synthetic:LAYOUT?key=value&…, replay:FILE.mcap (or just FILE.mcap), \
                             v4l:/dev/videoN?table.key=value&… or v4l:CAMERA.toml, \
                             depthai:SERIAL?key=value&…, nokhwa:INDEX?key=value&…, \
                             flaky:key=value,…:ADDRESS";

/// Opens the device at `address`.
///
/// # Errors
/// [`DriverError::NoDevice`] for an address no driver knows, saying what is valid;
/// whatever the driver itself has to say otherwise.
pub fn open(address: &str) -> Result<Box<dyn Device>, DriverError> {
    let refuse = |reason: String| DriverError::NoDevice {
        address: address.to_owned(),
        reason,
    };
    // A bare path may hold a colon, so it is looked at first.
    if address.ends_with(".mcap")
        && !address.starts_with("replay:")
        && !address.starts_with("flaky:")
    {
        return Ok(Box::new(Replay::open(address)?));
    }
    let (scheme, rest) = address
        .split_once(':')
        .ok_or_else(|| refuse(format!("no such driver; valid addresses are {ADDRESSES}")))?;
    match scheme {
        "synthetic" => {
            let options = Options::parse(rest).map_err(refuse)?;
            Ok(Box::new(Synthetic::new(options)))
        }
        "depthai" => {
            let options = depthai::Options::parse(rest).map_err(refuse)?;
            Ok(Box::new(DepthAi::open(options)?))
        }
        #[cfg(feature = "nokhwa")]
        "nokhwa" => {
            let options = crate::nokhwa::Options::parse(rest).map_err(refuse)?;
            Ok(Box::new(crate::nokhwa::Webcam::open(options)?))
        }
        #[cfg(not(feature = "nokhwa"))]
        "nokhwa" => Err(refuse(
            "this program was built without nokhwa; build it with `--features nokhwa`, or on Linux \
             use v4l:"
                .into(),
        )),
        "replay" => Ok(Box::new(Replay::open(rest)?)),
        #[cfg(target_os = "linux")]
        "v4l" => Ok(Box::new(crate::v4l::V4l::open(rest)?)),
        "flaky" => {
            let (faults, inner) = rest.split_once(':').ok_or_else(|| {
                refuse("the device to be wrapped is missing; flaky:drop=0.1:ADDRESS".into())
            })?;
            if inner.starts_with("flaky:") {
                return Err(refuse(
                    "flaky wraps a device that is not itself flaky".into(),
                ));
            }
            let faults = Faults::parse(faults).map_err(refuse)?;
            Ok(Box::new(Flaky::new(open(inner)?, faults)))
        }
        _ => Err(refuse(format!(
            "no driver {scheme:?}; valid addresses are {ADDRESSES}"
        ))),
    }
}

/// Devices that can be opened here and now.
pub fn list() -> Vec<DeviceInfo> {
    #[cfg(target_os = "linux")]
    let cameras = crate::v4l::list();
    #[cfg(not(target_os = "linux"))]
    let cameras = Vec::new();
    let synthetic = Layout::ALL.iter().map(|layout| {
        Synthetic::new(Options {
            layout: *layout,
            ..Options::default()
        })
        .info()
    });
    #[cfg(feature = "nokhwa")]
    let webcams = crate::nokhwa::list();
    #[cfg(not(feature = "nokhwa"))]
    let webcams = Vec::new();
    cameras
        .into_iter()
        .chain(depthai::list())
        .chain(webcams)
        .chain(synthetic)
        .collect()
}
