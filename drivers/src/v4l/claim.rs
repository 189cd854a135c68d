//! What a camera says and delivers, without the camera: for whoever has only its bytes.

use super::{
    format::Format,
    unpack::{Scale, Unpacker},
};
use crate::{
    frame::Pixels,
    node::{FourCc, Granted, PlaneLayout},
    plane::Plane,
};

/// A grant and one buffer of it. Nothing of it is believed: it goes the way of a running camera's.
#[derive(Debug, Clone)]
pub struct Claim<'a> {
    /// The format's four characters.
    pub code: [u8; 4],
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `V4L2_COLORSPACE_…`, `V4L2_XFER_FUNC_…`, `V4L2_YCBCR_ENC_…`, `V4L2_QUANTIZATION_…`; 0 = default.
    pub color: [u32; 4],
    /// Of each plane, the bytes from one row to the next and what the device wrote into it.
    pub planes: Vec<(usize, &'a [u8])>,
}

impl Claim<'_> {
    /// The picture of a color camera, as it enters a frame.
    ///
    /// # Errors
    /// A sentence that says which numbers cannot be.
    pub fn picture(&self) -> Result<Pixels, String> {
        self.unpacker()?.picture(&self.buffer())
    }

    /// Metres of a depth camera, `unit_metres` a step; NaN for 0 and for what lies beyond `farthest_metres`.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn depth(&self, unit_metres: f32, farthest_metres: f32) -> Result<Plane<f32>, String> {
        let scale = Scale {
            unit_metres,
            offset_metres: 0.0,
            nearest_metres: 0.0,
            farthest_metres,
        };
        self.unpacker()?.depth(&self.buffer(), &scale)
    }

    /// Amplitude of a depth camera, in its own steps.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn amplitude(&self) -> Result<Plane<f32>, String> {
        self.unpacker()?.amplitude(&self.buffer())
    }

    fn buffer(&self) -> Vec<&[u8]> {
        self.planes.iter().map(|(_, bytes)| *bytes).collect()
    }

    fn unpacker(&self) -> Result<Unpacker, String> {
        let code = FourCc(self.code);
        let format = Format::of(code).ok_or_else(|| format!("{code} is not understood"))?;
        let [colorspace, transfer, encoding, quantization] = self.color;
        let granted = Granted {
            format: code,
            width: self.width,
            height: self.height,
            planes: self
                .planes
                .iter()
                .map(|(stride, bytes)| PlaneLayout {
                    stride: *stride,
                    size: bytes.len(),
                })
                .collect(),
            colorspace,
            transfer,
            encoding,
            quantization,
        };
        format.check(&granted)?;
        Ok(Unpacker::new(format, granted))
    }
}
