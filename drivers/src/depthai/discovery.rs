//! DepthAI devices on USB, as the kernel lists them.
//!
//! One device shows three faces: it waits for its firmware as 2485, runs a bootloader as f63c, and works
//! as f63b; opening it makes it go from one to the next. So that is no unplugging, and any of them is the
//! device. Read from sysfs, which tells serial numbers without opening a device, as libusb cannot.

use std::{fs, path::Path};

/// Movidius, whose chips they have.
const VENDOR: &str = "03e7";

/// What a device is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Face {
    /// Waits for its firmware.
    Unbooted,
    /// Runs its bootloader.
    Bootloader,
    /// Works, for us or for somebody else.
    Working,
}

/// A device on the bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Present {
    /// The serial number that is printed on it; empty where it tells none before it is booted.
    pub id: String,
    pub face: Face,
}

/// All devices below `bus`, which is `/sys/bus/usb/devices` but for tests.
pub(super) fn devices(bus: &Path) -> Vec<Present> {
    let Ok(entries) = fs::read_dir(bus) else {
        return Vec::new();
    };
    let mut found: Vec<Present> = entries
        .flatten()
        .filter_map(|entry| {
            let fact = |name: &str| {
                let text = fs::read_to_string(entry.path().join(name)).ok()?;
                Some(text.trim().to_owned())
            };
            if fact("idVendor")? != VENDOR {
                return None;
            }
            let face = match fact("idProduct")?.as_str() {
                "2485" => Face::Unbooted,
                "f63c" => Face::Bootloader,
                "f63b" => Face::Working,
                // The vendor's other chips: neural sticks.
                _ => return None,
            };
            // The boot rom gives all of them one serial.
            let id = fact("serial").filter(|id| !id.contains("MyriadX") && id.len() <= 64);
            Some(Present {
                id: id.unwrap_or_default(),
                face,
            })
        })
        .collect();
    found.sort_by(|a, b| a.id.cmp(&b.id));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_face_of_a_device_is_the_device_and_nothing_else_is() {
        let bus = tempfile::tempdir().unwrap();
        for (port, vendor, product, serial) in [
            ("1-1", "03e7", "2485", Some("03e72485")),
            ("1-2", "03e7", "f63b", Some("14442C10D13EABCE00")),
            ("1-3", "03e7", "f63c", None),
            ("1-4", "03e7", "2150", Some("a neural stick")),
            ("1-5", "046d", "0825", Some("a webcam")),
            ("2-0:1.0", "", "", None),
        ] {
            let folder = bus.path().join(port);
            fs::create_dir(&folder).unwrap();
            if !vendor.is_empty() {
                fs::write(folder.join("idVendor"), format!("{vendor}\n")).unwrap();
                fs::write(folder.join("idProduct"), format!("{product}\n")).unwrap();
            }
            if let Some(serial) = serial {
                fs::write(folder.join("serial"), format!("{serial}\n")).unwrap();
            }
        }
        let found = devices(bus.path());
        let faces: Vec<Face> = found.iter().map(|present| present.face).collect();
        assert_eq!(faces, [Face::Bootloader, Face::Unbooted, Face::Working]);
        assert_eq!(found[2].id, "14442C10D13EABCE00");
        assert!(devices(&bus.path().join("absent")).is_empty());
    }
}
