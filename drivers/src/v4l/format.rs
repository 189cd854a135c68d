//! Formats that are understood, by their four characters.

use crate::{
    frame::{BayerPattern, Transfer},
    node::{FourCc, Granted},
};
use v4l::sys;

/// How samples stand in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// One byte each.
    Bytes,
    /// Two bytes each, little endian, the value in the low `bits`.
    Words {
        /// Bits that count.
        bits: u32,
    },
    /// Four samples in five bytes: their high bytes, then one byte of two low bits each (MIPI RAW10).
    Ten,
    /// Two samples in three bytes: their high bytes, then one byte of four low bits each (MIPI RAW12).
    Twelve,
}

/// What a picture is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// Packed `Y0 U Y1 V`.
    Yuyv,
    /// Y, then interleaved U and V at half size, in one plane or in two.
    Nv12,
    /// Three bytes: red, green, blue, or the other way round.
    Rgb { reversed: bool },
    /// A JPEG picture.
    Jpeg,
    /// One channel: gray for a color camera, depth for a depth camera.
    Single(Packing),
    /// One color per pixel.
    Bayer(BayerPattern, Packing),
}

/// One format of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    pub code: FourCc,
    pub layout: Layout,
    /// Buffers of the multi-planar interface hold each plane by itself.
    planes: usize,
}

const fn one(code: &[u8; 4], layout: Layout) -> Format {
    Format {
        code: FourCc(*code),
        layout,
        planes: 1,
    }
}

const fn words(bits: u32) -> Packing {
    Packing::Words { bits }
}

use BayerPattern::{Bggr, Gbrg, Grbg, Rggb};
use Layout::{Bayer, Single};

/// Every format, the preferred ones first: most bits, then least work, compressed last.
pub(super) const FORMATS: [Format; 38] = [
    one(b"BYR2", Bayer(Bggr, words(16))),
    one(b"GB16", Bayer(Gbrg, words(16))),
    one(b"GR16", Bayer(Grbg, words(16))),
    one(b"RG16", Bayer(Rggb, words(16))),
    one(b"BG12", Bayer(Bggr, words(12))),
    one(b"GB12", Bayer(Gbrg, words(12))),
    one(b"BA12", Bayer(Grbg, words(12))),
    one(b"RG12", Bayer(Rggb, words(12))),
    one(b"pBCC", Bayer(Bggr, Packing::Twelve)),
    one(b"pGCC", Bayer(Gbrg, Packing::Twelve)),
    one(b"pgCC", Bayer(Grbg, Packing::Twelve)),
    one(b"pRCC", Bayer(Rggb, Packing::Twelve)),
    one(b"BG10", Bayer(Bggr, words(10))),
    one(b"GB10", Bayer(Gbrg, words(10))),
    one(b"BA10", Bayer(Grbg, words(10))),
    one(b"RG10", Bayer(Rggb, words(10))),
    one(b"pBAA", Bayer(Bggr, Packing::Ten)),
    one(b"pGAA", Bayer(Gbrg, Packing::Ten)),
    one(b"pgAA", Bayer(Grbg, Packing::Ten)),
    one(b"pRAA", Bayer(Rggb, Packing::Ten)),
    one(b"BA81", Bayer(Bggr, Packing::Bytes)),
    one(b"GBRG", Bayer(Gbrg, Packing::Bytes)),
    one(b"GRBG", Bayer(Grbg, Packing::Bytes)),
    one(b"RGGB", Bayer(Rggb, Packing::Bytes)),
    one(b"RGB3", Layout::Rgb { reversed: false }),
    one(b"BGR3", Layout::Rgb { reversed: true }),
    one(b"YUYV", Layout::Yuyv),
    one(b"NV12", Layout::Nv12),
    Format {
        code: FourCc(*b"NM12"),
        layout: Layout::Nv12,
        planes: 2,
    },
    one(b"Z16 ", Single(words(16))),
    one(b"Y16 ", Single(words(16))),
    one(b"Y12 ", Single(words(12))),
    one(b"Y10 ", Single(words(10))),
    one(b"Y12P", Single(Packing::Twelve)),
    one(b"Y10P", Single(Packing::Ten)),
    one(b"GREY", Single(Packing::Bytes)),
    one(b"MJPG", Layout::Jpeg),
    one(b"JPEG", Layout::Jpeg),
];

impl Format {
    /// The format of this code.
    pub fn of(code: FourCc) -> Option<Self> {
        FORMATS.into_iter().find(|format| format.code == code)
    }

    /// Whether one sample per pixel is all there is, as in depth.
    pub fn is_single(self) -> bool {
        matches!(self.layout, Single(_))
    }

    /// Fewest bytes of a row; 0 for compressed pictures, and `None` for a width it cannot have.
    fn row_bytes(self, width: usize) -> Option<usize> {
        match self.layout {
            Layout::Yuyv => width.is_multiple_of(2).then_some(2 * width),
            Layout::Nv12 => width.is_multiple_of(2).then_some(width),
            Layout::Rgb { .. } => Some(3 * width),
            Layout::Jpeg => Some(0),
            Single(packing) | Bayer(_, packing) => packing.row_bytes(width),
        }
    }

    /// Checks that what was granted can hold a picture of this format.
    ///
    /// # Errors
    /// A sentence with the numbers.
    pub fn check(self, granted: &Granted) -> Result<(), String> {
        let (width, height) = (granted.width, granted.height);
        let pixels = width.saturating_mul(height);
        let most = crate::admission::MAX_SIDE;
        if pixels == 0 || width > most || height > most || pixels > crate::admission::MAX_PIXELS {
            return Err(format!("{width}×{height} pixels"));
        }
        let odd = || format!("{width}×{height} in {}, which cannot be", self.code);
        let row = self.row_bytes(width).ok_or_else(odd)?;
        if self.layout == Layout::Nv12 && !height.is_multiple_of(2) {
            return Err(odd());
        }
        if granted.planes.len() < self.planes {
            return Err(format!(
                "{} planes, and {} needs {}",
                granted.planes.len(),
                self.code,
                self.planes
            ));
        }
        for plane in granted.planes.iter().take(self.planes) {
            if row > 0 && plane.stride < row {
                return Err(format!(
                    "rows of {} bytes, and {width} pixels of {} need {row}",
                    plane.stride, self.code
                ));
            }
        }
        Ok(())
    }

    /// Fewest valid bytes of each plane; the last row's padding may be missing.
    pub fn needed(self, granted: &Granted) -> Vec<usize> {
        let row = self.row_bytes(granted.width).unwrap_or(0);
        let rows = |count: usize, stride: usize| count.saturating_sub(1) * stride + row;
        let planes = granted.planes.iter().take(self.planes).enumerate();
        planes
            .map(|(index, plane)| match (self.layout, self.planes, index) {
                (Layout::Jpeg, ..) => 4,
                (Layout::Nv12, 1, _) => rows(granted.height * 3 / 2, plane.stride),
                (Layout::Nv12, _, 1) => rows(granted.height / 2, plane.stride),
                _ => rows(granted.height, plane.stride),
            })
            .collect()
    }
}

impl Packing {
    /// Bytes of a row; `None` for a width it cannot have.
    pub fn row_bytes(self, width: usize) -> Option<usize> {
        match self {
            Self::Bytes => Some(width),
            Self::Words { .. } => Some(2 * width),
            Self::Ten => width.is_multiple_of(4).then_some(width / 4 * 5),
            Self::Twelve => width.is_multiple_of(2).then_some(width / 2 * 3),
        }
    }

    /// Bits of a sample.
    pub fn bits(self) -> u32 {
        match self {
            Self::Bytes => 8,
            Self::Words { bits } => bits,
            Self::Ten => 10,
            Self::Twelve => 12,
        }
    }
}

/// How the numbers of a picture relate to color and light, with the kernel's defaults resolved
/// (`V4L2_MAP_…_DEFAULT` of `videodev2.h`).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Meaning {
    /// Relation of values to light.
    pub transfer: Transfer,
    /// Matrix of luma and chroma.
    pub matrix: yuv::YuvStandardMatrix,
    /// Whether values use all of their range; Y′CbCr usually does not.
    pub full_range: bool,
}

impl Meaning {
    /// Of a format as granted.
    pub fn of(format: Format, granted: &Granted) -> Self {
        let colorspace = granted.colorspace;
        let transfer = match granted.transfer {
            sys::v4l2_xfer_func_V4L2_XFER_FUNC_DEFAULT => match colorspace {
                sys::v4l2_colorspace_V4L2_COLORSPACE_REC709
                | sys::v4l2_colorspace_V4L2_COLORSPACE_SMPTE170M
                | sys::v4l2_colorspace_V4L2_COLORSPACE_BT878
                | sys::v4l2_colorspace_V4L2_COLORSPACE_470_SYSTEM_M
                | sys::v4l2_colorspace_V4L2_COLORSPACE_470_SYSTEM_BG
                | sys::v4l2_colorspace_V4L2_COLORSPACE_BT2020 => {
                    sys::v4l2_xfer_func_V4L2_XFER_FUNC_709
                }
                sys::v4l2_colorspace_V4L2_COLORSPACE_OPRGB => {
                    sys::v4l2_xfer_func_V4L2_XFER_FUNC_OPRGB
                }
                sys::v4l2_colorspace_V4L2_COLORSPACE_DCI_P3 => {
                    sys::v4l2_xfer_func_V4L2_XFER_FUNC_DCI_P3
                }
                sys::v4l2_colorspace_V4L2_COLORSPACE_RAW => sys::v4l2_xfer_func_V4L2_XFER_FUNC_NONE,
                _ => sys::v4l2_xfer_func_V4L2_XFER_FUNC_SRGB,
            },
            named => named,
        };
        let matrix = match granted.encoding {
            sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_709
            | sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_XV709 => yuv::YuvStandardMatrix::Bt709,
            sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_BT2020
            | sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_BT2020_CONST_LUM => {
                yuv::YuvStandardMatrix::Bt2020
            }
            sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_SMPTE240M => yuv::YuvStandardMatrix::Smpte240,
            sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_DEFAULT => match colorspace {
                sys::v4l2_colorspace_V4L2_COLORSPACE_REC709
                | sys::v4l2_colorspace_V4L2_COLORSPACE_DCI_P3 => yuv::YuvStandardMatrix::Bt709,
                sys::v4l2_colorspace_V4L2_COLORSPACE_BT2020 => yuv::YuvStandardMatrix::Bt2020,
                sys::v4l2_colorspace_V4L2_COLORSPACE_SMPTE240M => yuv::YuvStandardMatrix::Smpte240,
                _ => yuv::YuvStandardMatrix::Bt601,
            },
            _ => yuv::YuvStandardMatrix::Bt601,
        };
        let luma = matches!(format.layout, Layout::Yuyv | Layout::Nv12);
        Self {
            transfer: match (format.layout, transfer) {
                (Bayer(..), _) | (_, sys::v4l2_xfer_func_V4L2_XFER_FUNC_NONE) => Transfer::Linear,
                (_, sys::v4l2_xfer_func_V4L2_XFER_FUNC_709) => Transfer::Bt709,
                // Adobe RGB: 563/256.
                (_, sys::v4l2_xfer_func_V4L2_XFER_FUNC_OPRGB) => Transfer::Gamma(2.199_218_8),
                (_, sys::v4l2_xfer_func_V4L2_XFER_FUNC_DCI_P3) => Transfer::Gamma(2.6),
                _ => Transfer::Srgb,
            },
            matrix,
            full_range: match granted.quantization {
                sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE => true,
                sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE => false,
                _ => !luma || colorspace == sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG,
            },
        }
    }

    /// Whether luma and chroma are what frames promise them to be.
    pub fn is_bt601_limited(&self) -> bool {
        !self.full_range && matches!(self.matrix, yuv::YuvStandardMatrix::Bt601)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::PlaneLayout;

    pub(crate) fn granted(code: &[u8; 4], size: (usize, usize), strides: &[usize]) -> Granted {
        Granted {
            format: FourCc(*code),
            width: size.0,
            height: size.1,
            planes: strides
                .iter()
                .map(|stride| PlaneLayout {
                    stride: *stride,
                    size: 0,
                })
                .collect(),
            colorspace: 0,
            transfer: 0,
            encoding: 0,
            quantization: 0,
        }
    }

    #[test]
    fn every_format_has_its_own_code() {
        for (index, format) in FORMATS.iter().enumerate() {
            assert!(
                FORMATS[..index]
                    .iter()
                    .all(|other| other.code != format.code)
            );
            assert_eq!(Format::of(format.code), Some(*format));
        }
    }

    #[test]
    fn the_least_number_of_bytes_leaves_out_only_the_last_padding() {
        struct Case(&'static [u8; 4], &'static [usize], &'static [usize]);
        let cases = [
            Case(b"YUYV", &[20], &[7 * 20 + 16]),
            Case(b"NV12", &[10], &[11 * 10 + 8]),
            Case(b"NM12", &[10, 12], &[7 * 10 + 8, 3 * 12 + 8]),
            Case(b"RGB3", &[24], &[8 * 24]),
            Case(b"pRAA", &[16], &[7 * 16 + 10]),
            Case(b"pRCC", &[16], &[7 * 16 + 12]),
            Case(b"Z16 ", &[16], &[8 * 16]),
            Case(b"MJPG", &[0], &[4]),
        ];
        for Case(code, strides, needed) in cases {
            let granted = granted(code, (8, 8), strides);
            let format = Format::of(granted.format).unwrap();
            assert_eq!(format.check(&granted), Ok(()));
            assert_eq!(format.needed(&granted), needed, "{}", granted.format);
        }
    }

    #[test]
    fn a_grant_that_cannot_hold_its_picture_is_refused() {
        struct Case(&'static [u8; 4], (usize, usize), &'static [usize]);
        let cases = [
            Case(b"YUYV", (8, 8), &[15]),
            Case(b"YUYV", (7, 8), &[16]),
            Case(b"NV12", (8, 7), &[8]),
            Case(b"NM12", (8, 8), &[8]),
            Case(b"pRAA", (6, 8), &[100]),
            Case(b"Z16 ", (0, 8), &[100]),
            Case(b"GREY", (20_000, 8), &[20_000]),
            Case(b"GREY", (16_000, 16_000), &[16_000]),
        ];
        for Case(code, size, strides) in cases {
            let granted = granted(code, size, strides);
            let format = Format::of(granted.format).unwrap();
            assert!(format.check(&granted).is_err(), "{granted:?}");
        }
    }

    #[test]
    fn defaults_mean_what_the_kernel_says_they_mean() {
        let format = Format::of(FourCc(*b"YUYV")).unwrap();
        let mut plain = granted(b"YUYV", (8, 8), &[16]);
        assert!(Meaning::of(format, &plain).is_bt601_limited());
        assert_eq!(Meaning::of(format, &plain).transfer, Transfer::Srgb);
        plain.colorspace = sys::v4l2_colorspace_V4L2_COLORSPACE_REC709;
        assert!(!Meaning::of(format, &plain).is_bt601_limited());
        assert_eq!(Meaning::of(format, &plain).transfer, Transfer::Bt709);
        plain.colorspace = sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG;
        assert!(Meaning::of(format, &plain).full_range);
        let bayer = Format::of(FourCc(*b"RG10")).unwrap();
        assert_eq!(Meaning::of(bayer, &plain).transfer, Transfer::Linear);
    }
}
