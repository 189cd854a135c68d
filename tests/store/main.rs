//! The store of shots on disks that fail, in processes that are killed and on machines that lose
//! power.
//!
//! The short forms run in CI; the long ones with `cargo test --release --test store -- --ignored`.

mod crash_disk;
mod errno;
mod kill;
mod power_loss;
mod salvage;
mod scenario;
