//! A device whose rig was measured: what it says of itself gives way to what was found.

use super::SessionError;
use crate::folder::RigFile;
use drivers::{
    Device, DeviceInfo, DriverError, Frame, Rig, Settings, Stream, admission::depth_size,
    rig_file::without_offset,
};
use std::{path::Path, time::Duration};

/// Opens the device at `address`, with the rig of `rig.toml` where one is named.
///
/// # Errors
/// [`SessionError::Device`] as [`drivers::open()`], [`SessionError::Rig`] for a file that cannot be
/// used, [`SessionError::ForeignRig`] for one of another rig, and [`SessionError::TwoRigs`] where the
/// device applies a rig file of its own.
pub fn open(address: &str, rig: Option<&Path>) -> Result<Box<dyn Device>, SessionError> {
    let device = drivers::open(address)?;
    match rig {
        None => Ok(device),
        Some(path) => measured(device, address, path),
    }
}

fn measured(
    device: Box<dyn Device>,
    address: &str,
    path: &Path,
) -> Result<Box<dyn Device>, SessionError> {
    if let Some(own) = device.rig_file() {
        return Err(SessionError::TwoRigs {
            path: path.to_owned(),
            own: own.to_owned(),
            device: address.to_owned(),
        });
    }
    let found = RigFile::read(path)?;
    let sizes = |rig: &Rig| (rig.color.size(), depth_size(rig), rig.depth.is_some());
    let (stated, measured) = (sizes(&device.rig()), sizes(&found.rig));
    if stated != measured {
        let words = |((w, h), (dw, dh), apart): ((usize, usize), (usize, usize), bool)| {
            let grid = if apart { "its own" } else { "the color" };
            format!("color {w}×{h}, depth {dw}×{dh} on {grid} grid")
        };
        return Err(SessionError::ForeignRig {
            path: path.to_owned(),
            device: address.to_owned(),
            found: words(measured),
            expected: words(stated),
        });
    }
    Ok(Box::new(Calibrated {
        device,
        rig: found.rig,
        offset: found.depth_offset_metres as f32,
    }))
}

struct Calibrated {
    device: Box<dyn Device>,
    rig: Rig,
    /// Metres too much in every distance.
    offset: f32,
}

impl Device for Calibrated {
    fn info(&self) -> DeviceInfo {
        self.device.info()
    }

    fn rig(&self) -> Rig {
        self.rig
    }

    fn presence(&mut self) -> Result<(), DriverError> {
        self.device.presence()
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        Ok(Box::new(Corrected {
            stream: self.device.start(settings)?,
            offset: self.offset,
        }))
    }
}

struct Corrected<'a> {
    stream: Box<dyn Stream + 'a>,
    offset: f32,
}

impl Stream for Corrected<'_> {
    fn settings(&self) -> &Settings {
        self.stream.settings()
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let mut frame = self.stream.next_frame(patience)?;
        if let Frame::Depth(depth) = &mut frame {
            for metres in depth.metres.samples_mut() {
                *metres = without_offset(*metres, self.offset);
            }
        }
        Ok(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::Transfer;

    /// A rig file of the synthetic desk with another focal length and an offset.
    fn file(folder: &Path, width: usize) -> std::path::PathBuf {
        let mut rig = drivers::open("synthetic:desk?width=64&depth_width=32")
            .unwrap()
            .rig();
        rig.color.fx += 1.5;
        rig.color.width = width;
        let file = RigFile {
            rig,
            depth_offset_metres: 0.025,
            transfer: Transfer::Srgb,
            black_level: 0.0,
            white_level: 1.0,
        };
        let path = folder.join("rig.toml");
        std::fs::write(&path, file.text(&path).unwrap()).unwrap();
        assert_eq!(RigFile::read(&path).unwrap().depth_offset_metres, 0.025);
        path
    }

    fn first_depth(device: &mut dyn Device) -> Frame {
        let mut stream = device.start(&Settings::default()).unwrap();
        loop {
            let frame = stream.next_frame(Duration::ZERO).unwrap();
            if matches!(frame, Frame::Depth(_)) {
                return frame;
            }
        }
    }

    #[test]
    fn a_measured_rig_replaces_the_stated_one_and_corrects_distances() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), 64);
        let address = "synthetic:desk?width=64&depth_width=32&noise=0";
        let (mut plain, mut measured) = (
            open(address, None).unwrap(),
            open(address, Some(&path)).unwrap(),
        );
        assert_eq!(measured.rig().color.fx, plain.rig().color.fx + 1.5);
        let (Frame::Depth(stated), Frame::Depth(corrected)) =
            (first_depth(plain.as_mut()), first_depth(measured.as_mut()))
        else {
            unreachable!("first_depth gives depth");
        };
        let mut known = 0;
        for (stated, corrected) in stated
            .metres
            .samples()
            .iter()
            .zip(corrected.metres.samples())
        {
            assert_eq!(stated.is_nan(), corrected.is_nan());
            if !stated.is_nan() {
                assert!(
                    (stated - corrected - 0.025).abs() < 1e-5,
                    "{stated} {corrected}"
                );
                known += 1;
            }
        }
        assert!(known > 100);
    }

    /// A camera whose own file names its rig.
    struct OfItsOwn(Box<dyn Device>);

    impl Device for OfItsOwn {
        fn info(&self) -> DeviceInfo {
            self.0.info()
        }

        fn rig(&self) -> Rig {
            self.0.rig()
        }

        fn rig_file(&self) -> Option<&Path> {
            Some(Path::new("beside-the-camera.toml"))
        }

        fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
            self.0.start(settings)
        }
    }

    #[test]
    fn distances_never_lose_two_offsets() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), 64);
        let address = "synthetic:desk?width=64&depth_width=32";
        let device = Box::new(OfItsOwn(drivers::open(address).unwrap()));
        let refused = measured(device, address, &path).err().unwrap();
        let message = refused.to_string();
        for named in [
            address,
            "beside-the-camera.toml",
            "rig.toml",
            "captured.toml",
        ] {
            assert!(message.contains(named), "{named}: {message}");
        }
    }

    #[test]
    fn the_rig_of_other_cameras_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), 128);
        let refused = open("synthetic:desk?width=64&depth_width=32", Some(&path))
            .err()
            .unwrap();
        let message = refused.to_string();
        assert!(
            message.contains("rig.toml") && message.contains("64×48"),
            "{message}"
        );
    }
}
