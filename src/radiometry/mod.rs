//! Numbers → light: pixels to scene-linear light, and `flash − ambient` with its variance.

pub mod align;
pub mod burst;
pub mod decode;
mod demosaic;
pub mod difference;
pub mod exposure;
mod flow;
mod jpeg;
mod levels;
mod motion;
pub mod noise;
mod patch;
mod photograph;
mod report;
pub mod response;
pub mod subtract;
#[cfg(test)]
mod subtract_tests;
mod texture;
pub mod transfer;
pub mod warp;
mod window;

pub use align::{Alignment, AlignmentOutcome};
pub use decode::linearise;
pub use difference::{Tally, subtract_linear_into};
pub use noise::{NoiseModel, Sensor};
pub use photograph::photograph;
pub use response::{RecoveredResponse, ResponseError, recover_response};
pub use subtract::{SubtractOptions, subtract};

use drivers::Plane;
use thiserror::Error;

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
    /// Shift of the ambient frame onto the flash frame at the picture's centre, pixels (x, y);
    /// zero without an ambient frame. Of a bracket: the first ambient frame's.
    pub shift_pixels: [f32; 2],
    /// How far the alignment moves the corner it moves most, pixels.
    pub corner_shift_pixels: f32,
    /// Whether the pair was aligned, and why not.
    pub alignment: AlignmentOutcome,
    /// Fraction of pixels clipped in either frame.
    pub clipped_fraction: f32,
    /// Fraction of pixels that moved between the frames.
    pub moved_fraction: f32,
    /// Fraction of usable pixels where the difference (sum of the channels) is negative.
    pub negative_fraction: f32,
    /// Fraction of usable pixels where it is negative by more than three standard deviations;
    /// above a few per cent the exposures or the transfer curve do not fit the pictures.
    pub inconsistent_fraction: f32,
    /// Median of the ambient light divided by the flash's; 0 without an ambient frame.
    pub ambient_to_flash: f32,
    /// Factor by which the ambient pixel values were scaled to the flash frame's exposure, as
    /// the frames state it (or as it was estimated); 1 without an ambient frame.
    pub exposure_ratio: f32,
    /// True when `exposure_ratio` was estimated from the pictures.
    pub exposure_estimated: bool,
    /// Median signal-to-noise ratio of the flash-only light, in decibel (20 log10), no lower
    /// than −60.
    pub snr_db: f32,
    /// Fraction of usable pixels whose signal is under three standard deviations.
    pub weak_fraction: f32,
}

/// Why frames could not be turned into light.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RadiometryError {
    /// The samples do not fill the declared rectangle.
    #[error(
        "{layout} frame of {width}×{height} needs {expected} bytes but has {found}; \
         check the negotiated format"
    )]
    WrongLength {
        /// Pixel layout.
        layout: &'static str,
        /// Declared pixels per row.
        width: usize,
        /// Declared rows.
        height: usize,
        /// Bytes the rectangle takes.
        expected: usize,
        /// Bytes that were there.
        found: usize,
    },
    /// A size the layout cannot have.
    #[error("{layout} frame of {width}×{height}: {problem}")]
    UnusableSize {
        /// Pixel layout.
        layout: &'static str,
        /// Declared pixels per row.
        width: usize,
        /// Declared rows.
        height: usize,
        /// What is wrong and what would do.
        problem: &'static str,
    },
    /// A field of the frame is outside its range.
    #[error("{field} is {value}, but must be {range}; correct the frame's metadata")]
    OutOfRange {
        /// Field of [`drivers::ColorFrame`].
        field: &'static str,
        /// What it holds.
        value: f32,
        /// What it may hold.
        range: &'static str,
    },
    /// A measured response that is no response.
    #[error(
        "transfer response: {problem}; calibrate it again with `capturectl calibrate response`"
    )]
    BadResponse {
        /// What is wrong.
        problem: &'static str,
    },
    /// A JPEG whose header contradicts the frame.
    #[error(
        "JPEG says {found_width}×{found_height} but the frame {width}×{height}; \
         check the negotiated format"
    )]
    JpegSize {
        /// Declared pixels per row.
        width: usize,
        /// Declared rows.
        height: usize,
        /// Pixels per row in the JPEG's header.
        found_width: usize,
        /// Rows in the JPEG's header.
        found_height: usize,
    },
    /// A JPEG that cannot be decoded.
    #[error("JPEG frame: {problem}; the frame is damaged, take another")]
    Jpeg {
        /// The decoder's words.
        problem: String,
    },
    /// Frames of one shot that differ in size.
    #[error(
        "{frame} is {found_width}×{found_height} but the flash frame {width}×{height}; \
         all color frames of a shot must share one size"
    )]
    SizesDiffer {
        /// Which frame or output.
        frame: &'static str,
        /// Pixels per row of the flash frame.
        width: usize,
        /// Rows of the flash frame.
        height: usize,
        /// Pixels per row found.
        found_width: usize,
        /// Rows found.
        found_height: usize,
    },
    /// A layout the fused subtraction does not read.
    #[error("the fused subtraction reads Rgb8, Rgb16 and RgbF32, not {layout}; call `subtract`")]
    Layout {
        /// Pixel layout.
        layout: &'static str,
    },
    /// Not one pixel is left.
    #[error(
        "no usable pixel: {clipped_percent:.1} % clipped, the rest moved or unknown; \
         lower the exposure or the flash"
    )]
    NoUsablePixel {
        /// Share of clipped pixels, per cent.
        clipped_percent: f32,
    },
}
