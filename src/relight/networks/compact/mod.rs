//! The compact tier: two small networks that correct closed forms instead of inventing surfaces.
//!
//! One corrects the surfaces of a shot, once; the other corrects what the sweep says of one lamp: which
//! light arrives and how much is bounced. What they are fed is made here, in training too
//! (`capturectl lessons`), so both sides are the same by construction.

mod doubt;
mod light;
mod sight;
mod surfaces;
mod told;

pub use doubt::UNSHADOWED;
pub use light::{Correction, Ground, Swept};
pub use sight::{Sight, toward_camera};
pub use surfaces::corrected;

use super::{Network, NetworkRecord, grid::Grid};
use crate::scene::Scene;

/// Both networks.
pub struct Compact {
    /// sight → normal, factor, roughness.
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

/// Pixels, nearly, of the largest grid that the networks are asked on: those of the paper's pictures.
pub const MOST_PIXELS: usize = 65_536;

/// One network halves the picture four times, the other makes one pixel of four by four and halves it three times.
const GRID: Grid = Grid {
    pixels: MOST_PIXELS as f64,
    multiple: 32.0,
};

/// The least of [`doubt_of`] at which depth is wholly in doubt, inverted; `networks.py` has the same.
const DOUBT_GAIN: f32 = 8.0;

/// How far a scene's depth is in doubt, 0 (exact) to 1, the mean over what is known.
pub fn doubtful(scene: &Scene) -> f32 {
    let sigmas = scene.depth_sigma_metres.samples().iter();
    let known = sigmas.zip(scene.depth_metres.samples());
    let (mut sum, mut count) = (0.0f64, 0.0f64);
    for (sigma, metres) in known.filter(|(_, metres)| metres.is_finite()) {
        sum += f64::from((DOUBT_GAIN * doubt_of(*sigma, *metres)).min(1.0));
        count += 1.0;
    }
    (sum / count.max(1.0)) as f32
}

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
