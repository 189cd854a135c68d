//! Whether a DepthAI device is there, over all of its faces.
//!
//! Where libusb tells of devices that come and go (feature `rusb`), the list of devices is read when it
//! does, and every second all the same; without, whenever somebody asks.

use super::discovery::{Present, devices};
use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// Longest time for which a device is away from the bus that starts anew or ends a session.
const RETURNING: Duration = Duration::from_secs(5);
/// Longest time for which the word of libusb is trusted: without a running udev a libusb that was built for
/// it tells nothing.
const TRUSTED: Duration = Duration::from_secs(1);

/// Follows devices on the bus.
#[derive(Debug)]
pub struct Watch {
    bus: PathBuf,
    found: Vec<Present>,
    read: Option<Instant>,
    /// `None` where nobody tells.
    #[cfg(feature = "rusb")]
    events: Option<super::hotplug::Events>,
}

impl Watch {
    /// Of the devices below `bus`, which is `/sys/bus/usb/devices` but for tests.
    pub fn new(bus: &Path) -> Self {
        Self {
            bus: bus.to_owned(),
            found: Vec::new(),
            read: None,
            #[cfg(feature = "rusb")]
            events: super::hotplug::Events::begin().ok(),
        }
    }

    /// Whether somebody tells of devices that come and go.
    pub fn is_told(&self) -> bool {
        #[cfg(feature = "rusb")]
        return self.events.is_some();
        #[cfg(not(feature = "rusb"))]
        false
    }

    fn has_changed(&mut self, now: Instant) -> bool {
        #[cfg(feature = "rusb")]
        if let Some(events) = &mut self.events {
            let old = |read| now.saturating_duration_since(read) >= TRUSTED;
            return events.have_come() || self.read.is_none_or(old);
        }
        let _ = (now, TRUSTED);
        true
    }

    /// Serial numbers of the devices that are there at `now`, in whatever face; empty where one tells none
    /// before it is booted.
    pub fn serials(&mut self, now: Instant) -> impl Iterator<Item = &str> {
        if self.has_changed(now) {
            self.found = devices(&self.bus);
            self.read = Some(now);
        }
        self.found.iter().map(|present| present.id.as_str())
    }
}

/// How long a device has been away. It comes and goes while it starts: unbooted, bootloader, working.
#[derive(Debug, Default)]
pub(super) struct Absence {
    since: Option<Instant>,
}

impl Absence {
    /// Takes whether it is there at `now`; true once it was away for longer than any start takes.
    pub fn is_unplugged(&mut self, there: bool, now: Instant) -> bool {
        self.since = match there {
            true => None,
            false => Some(self.since.unwrap_or(now)),
        };
        self.since
            .is_some_and(|since| now.saturating_duration_since(since) > RETURNING)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::fs;

    /// A device shows a face, or none.
    fn show(bus: &Path, product: Option<&str>) {
        let folder = bus.join("1-1");
        drop(fs::remove_dir_all(&folder));
        if let Some(product) = product {
            fs::create_dir(&folder).unwrap();
            fs::write(folder.join("idVendor"), "03e7\n").unwrap();
            fs::write(folder.join("idProduct"), format!("{product}\n")).unwrap();
        }
    }

    #[test]
    fn starting_anew_is_no_unplug_and_going_for_good_is_one() {
        let bus = tempfile::tempdir().unwrap();
        let mut watch = Watch::new(bus.path());
        let mut absence = Absence::default();
        let began = Instant::now();
        // Seconds, what is on the bus then, and whether that is an unplug.
        for (at, face, unplugged) in [
            (0, Some("2485"), false),
            (1, None, false),
            (3, Some("f63c"), false),
            (4, None, false),
            (8, None, false),
            (9, Some("f63b"), false),
            (10, None, false),
            (15, None, false),
            (16, None, true),
            (40, None, true),
            (41, Some("2485"), false),
            (42, Some("2150"), false),
            (48, Some("2150"), true),
        ] {
            show(bus.path(), face);
            let now = began + Duration::from_secs(at);
            let there = watch.serials(now).next().is_some();
            assert_eq!(absence.is_unplugged(there, now), unplugged, "at {at} s");
        }
    }

    proptest! {
        /// Whatever the order and the times: unplugged is who was last there more than five seconds ago.
        #[test]
        fn only_a_long_absence_is_an_unplug(
            steps in prop::collection::vec((0u64..4000, any::<bool>()), 1..60),
        ) {
            let began = Instant::now();
            let (mut now, mut absence) = (began, Absence::default());
            let mut missed = None;
            for (wait, there) in steps {
                now += Duration::from_millis(wait);
                if there {
                    missed = None;
                } else {
                    missed.get_or_insert(now);
                }
                let long = missed.is_some_and(|since: Instant| now - since > RETURNING);
                prop_assert_eq!(absence.is_unplugged(there, now), long);
            }
        }
    }
}
