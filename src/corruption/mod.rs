//! Captures made worse on purpose: pure functions of a clean shot, a severity and a seed, so that
//! what a method loses by them can be measured on any capture.
//!
//! All of them spoil what the sensors say and leave the scene alone, so the truth of a capture
//! stays true. [`CORRUPTIONS`] lists the eighteen of FlashToF-C; [`DepthNoise`] is the reference
//! method's own.

mod bright_ambient;
mod depth_grid;
mod depth_holes;
mod depth_noise;
mod depth_resolution;
mod field;
mod flash_saturation;
mod flying_pixels;
mod hand_shake;
mod infrared_black;
mod jpeg_artefacts;
mod mains_flicker;
mod mirror;
mod misalignment;
mod motion;
mod multipath;
mod phase_wrap;
mod photographs;
mod sensor_noise;
mod table;
#[cfg(test)]
mod tests;
mod thin_structures;
mod tof_noise;
mod wrong_transfer;

pub use depth_noise::DepthNoise;
pub use table::{CORRUPTIONS, Corruption, CorruptionError, MOST_SEVERE};
