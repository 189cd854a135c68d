//! A USB device of DepthAI's vendor that comes, changes its face and goes.

use crate::usb::Plugged;
use drivers::depthai::{self, Watch};
use std::{
    path::Path,
    time::{Duration, Instant},
};

/// Waits until so many devices are there, and answers how long that took.
fn until(watch: &mut Watch, count: usize) -> Duration {
    let since = Instant::now();
    while watch.serials(Instant::now()).count() != count {
        assert!(since.elapsed() < Duration::from_secs(5), "nobody noticed");
        std::thread::sleep(Duration::from_millis(1));
    }
    since.elapsed()
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_device_is_noticed_when_it_comes_changes_its_face_and_goes() {
    let mut watch = Watch::new(Path::new("/sys/bus/usb/devices"));
    assert_eq!(watch.serials(Instant::now()).count(), 0);
    for (face, model) in [
        ("03e7:2485", "not booted"),
        ("03e7:f63c", "bootloader"),
        ("03e7:f63b", "at work"),
    ] {
        let plugged = Plugged::new(&["-i", face]);
        let came = until(&mut watch, 1);
        let listed = depthai::list();
        assert!(listed[0].model.contains(model), "{listed:?}");
        drop(plugged);
        let went = until(&mut watch, 0);
        eprintln!(
            "{face}: noticed {came:?} after its node, and gone {went:?} after that (told by events: {})",
            watch.is_told()
        );
    }
    // Another vendor's device is none.
    let _webcam = Plugged::new(&[]);
    assert!(depthai::list().is_empty());
    assert_eq!(watch.serials(Instant::now()).count(), 0);
}
