//! A photograph with flash, one without, and a depth map in; the same photograph under any light out.
//!
//! The modules stand in the order a frame passes them, and each uses only those above it
//! (`tests/architecture.rs` holds that). Down to `develop` everything is pure: no clock, no file,
//! no thread of its own making, no environment. Below it is IO.
#![forbid(unsafe_code)]

pub mod shot;
pub mod timing;
pub mod radiometry;
pub mod registration;
pub mod scene;
pub mod relight;
pub mod infrared;
pub mod develop;
pub mod verdict;
pub mod parsimony;
pub mod corruption;
pub mod calibration;
// ---- above: pure; below: IO ----
pub mod output;
pub mod export;
pub mod folder;
pub mod eval;
pub mod inference;
pub mod costs;
pub mod config;
pub mod api;
pub mod darkroom;
pub mod session;
pub mod store;
pub mod daemon;
pub mod commands;
