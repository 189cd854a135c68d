//! The drivers against real kernel drivers. `tests/guest/run` boots a kernel that has them and runs
//! these tests there; elsewhere they are ignored, as no machine has this hardware.
#![cfg(target_os = "linux")]

mod daemon;
mod flash;
mod machine;
#[cfg(feature = "nokhwa")]
mod nokhwa;
mod oak;
mod endurance;
mod unit;
mod usb;
mod vivid;
