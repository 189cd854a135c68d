//! The road a shot takes, every stage by name.
//!
//! The callers know the time; this room does not: it only says which stage begins.

use crate::{radiometry::FlashOnly, registration::RegisteredDepth, scene::Scene};

/// The stages of [`Development`], in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Pixels to light, flash − ambient.
    Radiometry,
    /// Depth to the color grid.
    Registration,
    /// Light and depth to surfaces.
    Scene,
    /// What every light needs.
    Prepare,
}

/// A shot, understood.
#[derive(Debug, Clone)]
pub struct Development {
    /// The light of the flash alone, on the photograph's own grid.
    pub flash_only: FlashOnly,
    /// Depth on the working grid.
    pub registered: RegisteredDepth,
    /// Surfaces on the working grid (smaller than the photograph when that is very large).
    pub scene: Scene,
}
