//! Captures made worse on purpose: pure functions of a clean shot and a seed, so that what a
//! method loses by them can be measured on any capture.

mod depth_noise;

pub use depth_noise::DepthNoise;
