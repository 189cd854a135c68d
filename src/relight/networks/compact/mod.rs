//! The compact tier: two small networks that correct closed forms instead of inventing surfaces.
//!
//! One corrects the surfaces of a shot, once; the other corrects what the sweep says of one lamp: which
//! light arrives and how much is bounced. What they are fed is made here, in training too
//! (`capturectl lessons`), so both sides are the same by construction.

mod doubt;
mod light;
mod sight;
mod surfaces;

pub use doubt::UNSHADOWED;
pub use light::{Correction, Ground, Swept};
pub use sight::Sight;
pub use surfaces::corrected;

use super::{Network, NetworkRecord, grid::Grid};

/// Both networks.
pub struct Compact {
    /// sight → factor, roughness.
    pub surfaces: Box<dyn Network>,
    /// lamp → weight, shadow, bounced.
    pub light: Box<dyn Network>,
}

impl Compact {
    /// Origins and costs.
    pub fn records(&self) -> [NetworkRecord; 2] {
        [self.surfaces.record(), self.light.record()]
    }
}

/// Pixels of the largest grid that the networks are asked on: those of the paper's pictures.
pub const MOST_PIXELS: usize = 65_536;

/// Both networks halve the picture four times.
const GRID: Grid = Grid {
    pixels: MOST_PIXELS as f64,
    multiple: 16.0,
};

/// NaN and infinities become 0: no network is fed what it could not learn from.
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// Depth over the median depth, as a logarithm, times this.
const DEPTH_GAIN: f32 = 2.0;

/// Relative sigma of depth as a network sees it: 0 at none, 1 at 5 %.
fn doubt_of(sigma: f32, metres: f32) -> f32 {
    finite((1e3 * sigma / metres).max(0.0).ln_1p() / 4.0)
}
