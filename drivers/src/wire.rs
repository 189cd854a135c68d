//! What cameras say and deliver, without the cameras: the drivers' readers of bytes, for whoever has nothing
//! but bytes, such as a fuzzer.

pub use crate::depthai::transcript::Transcript;
#[cfg(target_os = "linux")]
pub use crate::v4l::claim::Claim;
