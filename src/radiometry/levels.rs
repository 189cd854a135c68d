//! Black, white and exposure of one frame: from a stored value to light, and where it clips.

use super::{RadiometryError, transfer};
use drivers::{ColorFrame, Pixels, Transfer};

/// How one frame's values (fractions of full scale) become light at unit exposure.
#[derive(Debug, Clone)]
pub(super) struct Levels<'a> {
    /// The curve between black and white level.
    pub transfer: &'a Transfer,
    /// Value of no light.
    pub black: f32,
    /// `white − black`, > 0.
    pub span: f32,
    /// Values from here on are clipped.
    pub clip: f32,
    /// Light is divided by this; > 0.
    pub factor: f32,
    /// Width of one step of the stored values; 0 for floating point.
    pub step: f32,
}

impl<'a> Levels<'a> {
    /// Reads and checks the metadata of `frame`, whose samples have `step` between two values.
    ///
    /// # Errors
    /// [`RadiometryError::OutOfRange`] for levels or an exposure outside their range, and what
    /// [`transfer::check`] finds.
    pub fn of(frame: &'a ColorFrame, step: f32) -> Result<Self, RadiometryError> {
        transfer::check(&frame.transfer)?;
        let (black, white) = (frame.black_level, frame.white_level);
        if !(0.0..1.0).contains(&black) {
            return Err(RadiometryError::OutOfRange {
                field: "black_level",
                value: black,
                range: "in [0, 1)",
            });
        }
        if !(white > black && white <= 1.0) {
            return Err(RadiometryError::OutOfRange {
                field: "white_level",
                value: white,
                range: "above black_level and at most 1",
            });
        }
        for (field, value) in [
            ("exposure seconds", frame.exposure.seconds),
            ("exposure gain", frame.exposure.gain),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(RadiometryError::OutOfRange {
                    field,
                    value,
                    range: "positive",
                });
            }
        }
        let factor = frame.exposure.factor();
        if !(factor.is_normal() && factor.recip().is_normal()) {
            return Err(RadiometryError::OutOfRange {
                field: "exposure seconds · gain",
                value: factor,
                range: "a factor that can be divided by",
            });
        }
        // Rounding, chroma conversion and JPEG leave a clipped 8-bit value one code short.
        let slack = if step >= 1.0 / 255.0 {
            1.25 * step
        } else {
            0.25 * step + 1e-6
        };
        // Floating point has no full scale to run into: without a stated white level a value over
        // 1 is bright, not clipped.
        let unbounded = matches!(frame.pixels, Pixels::RgbF32(_)) && white >= 1.0;
        // A frame of few steps keeps at least the upper half of its range.
        let clip = if unbounded {
            f32::INFINITY
        } else {
            (white - slack).max(0.5 * (black + white))
        };
        Ok(Self {
            transfer: &frame.transfer,
            black,
            span: white - black,
            clip,
            factor,
            step,
        })
    }

    /// Light of a stored value at unit exposure; NaN when clipped or not a number.
    pub fn light(&self, value: f32) -> f32 {
        if value < self.clip {
            self.relative(value) / self.factor
        } else {
            f32::NAN
        }
    }

    /// Light as a fraction of white, before division by the exposure; NaN when clipped.
    pub fn relative_unless_clipped(&self, value: f32) -> f32 {
        if value < self.clip {
            self.relative(value)
        } else {
            f32::NAN
        }
    }

    fn relative(&self, value: f32) -> f32 {
        transfer::decode(self.transfer, (value - self.black) / self.span)
    }

    /// Quantisation variance of the light of a stored value, as a fraction of white, squared.
    pub fn quantisation(&self, value: f32) -> f32 {
        let width = self.step / self.span
            * transfer::slope(self.transfer, (value - self.black) / self.span);
        width * width / 12.0
    }
}
