//! What to doubt about a shot, asked of the shot itself: one finding per way a shot can fail, and
//! how far each pixel is to be trusted.
//!
//! Nothing here knows the truth. Each detector measures one physical quantity of the pixels, of the
//! depth samples, or of how they agree, and divides it by the amount from which it does harm.

mod bends;
mod blocks;
mod blur;
mod confidence;
mod contradicted;
mod depth_samples;
mod finding;
mod light;
mod look;
mod pair;
mod shading;
mod steps;
#[cfg(test)]
mod tests;
mod thin;
mod wrapped;

pub use contradicted::contradicted;
pub use finding::Finding;
pub use wrapped::Wrapped;

use crate::{develop::Development, shot::Shot};
use drivers::Plane;
use look::Look;
use rayon::prelude::*;

/// What a shot says about itself.
#[derive(Debug, Clone)]
pub struct Verdict {
    /// One for each failure mode, in the order of the corruptions' table, then occluders outside
    /// the picture.
    pub findings: Vec<Finding>,
    /// How far to trust a pixel of the working grid, 0 (a guess) to 1; NaN = neither light nor depth
    /// is known.
    pub confidence: Plane<f32>,
    /// Pixels of the working grid whose depth the photograph contradicts; `None` without any.
    pub contradicted: Option<Plane<bool>>,
    /// Depth that lies a range further away than it says; `None` without any.
    pub wrapped: Option<Wrapped>,
}

impl Verdict {
    /// How bad one failure mode is, as a share of what does harm; 0 of one that is not judged.
    pub fn score(&self, mode: &str) -> f32 {
        let found = self.findings.iter().find(|finding| finding.mode == mode);
        found.map_or(0.0, |finding| finding.score)
    }

    /// What is harmful, worst first.
    pub fn harmful(&self) -> Vec<&Finding> {
        let mut harmful: Vec<&Finding> = self.findings.iter().filter(|f| f.is_harmful()).collect();
        harmful.sort_by(|a, b| b.score.total_cmp(&a.score));
        harmful
    }
}

/// Judges a shot by itself and by what became of it. `development` is that of `shot`, its variance
/// still there.
pub fn judge(shot: &Shot, development: &Development) -> Verdict {
    let look = Look::of(shot, development);
    let ((steps, speckle), (pair, shading)) = rayon::join(
        || (steps::Steps::of(&look), depth_samples::Samples::of(&look)),
        || (pair::Pair::of(&look), shading::Shading::of(&look)),
    );
    let detectors: [&(dyn Fn() -> Finding + Sync); 19] = [
        &|| speckle.noise(),
        &|| speckle.holes(),
        &|| speckle.flying(),
        &|| bends::multipath(&look, &steps),
        &|| steps.phase_wrap(&look),
        &|| steps.misalignment(&look),
        &|| depth_samples::resolution(&look),
        &|| pair.bright_ambient(&look),
        &|| light::flash_saturation(&look),
        &|| pair.motion(),
        &|| blur::hand_shake(&look, &steps),
        &|| pair.mains_flicker(),
        &|| shading.wrong_transfer(),
        &|| light::sensor_noise(&look),
        &|| blocks::jpeg(&look),
        &|| speckle.infrared_black(),
        &|| steps.mirror(&look),
        &|| thin::thin_structures(&look),
        &|| steps.occluders_outside(&look),
    ];
    let findings = detectors.par_iter().map(|detect| detect()).collect();
    let confidence = confidence::confidence(&look, &steps);
    Verdict {
        findings,
        confidence,
        contradicted: contradicted::of(&look, &steps),
        wrapped: wrapped::of(&look, &steps),
    }
}
