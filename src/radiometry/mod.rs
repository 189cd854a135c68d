//! Numbers → light: pixels to scene-linear light, and `flash − ambient` with its variance.

use drivers::Plane;

/// Scene-linear light, interleaved red, green, blue; white level 1.0 at unit exposure;
/// NaN (all three) = saturated or unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearImage(pub Plane<[f32; 3]>);

/// The light of the flash alone, on the color grid.
#[derive(Debug, Clone)]
pub struct FlashOnly {
    /// `flash − ambient`, unit exposure; negative noise is kept; NaN (all three) = clipped,
    /// moved or unknown.
    pub light: LinearImage,
    /// Variance of `light` (mean of the three channels), same size; NaN where `light` is NaN.
    pub variance: Plane<f32>,
    /// What was found on the way.
    pub report: SubtractionReport,
}

/// How well the room's light could be taken out.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct SubtractionReport {
    /// Shift of the ambient frame onto the flash frame, pixels (x, y); zero without an ambient frame.
    pub shift_pixels: [f32; 2],
    /// Fraction of pixels clipped in either frame.
    pub clipped_fraction: f32,
    /// Fraction of pixels that moved between the frames.
    pub moved_fraction: f32,
    /// Fraction of usable pixels where the difference is negative.
    pub negative_fraction: f32,
    /// Median of the ambient light divided by the flash's; 0 without an ambient frame.
    pub ambient_to_flash: f32,
    /// Median signal-to-noise ratio of the flash-only light, in decibel (20 log10).
    pub snr_db: f32,
    /// Fraction of usable pixels whose signal is under three standard deviations.
    pub weak_fraction: f32,
}
