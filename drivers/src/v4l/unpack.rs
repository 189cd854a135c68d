//! Bytes of a buffer → pixels, each picture in one pass over its rows.

use super::{
    format::{Format, Layout, Meaning, Packing},
    packed::{TEN, TWELVE},
};
use crate::{
    frame::Pixels, jpeg::size_of_jpeg, node::Granted, plane::Plane, rig_file::without_offset,
};

/// Numbers of a depth camera → metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub unit_metres: f32,
    /// To be subtracted from every distance.
    pub offset_metres: f32,
    pub nearest_metres: f32,
    pub farthest_metres: f32,
}

impl Scale {
    /// NaN for 0, for what lies behind the camera, and for what lies out of range.
    fn metres(&self, number: u16) -> f32 {
        let metres = without_offset(f32::from(number) * self.unit_metres, self.offset_metres);
        let inside = self.nearest_metres <= metres && metres <= self.farthest_metres;
        if number > 0 && inside {
            metres
        } else {
            f32::NAN
        }
    }
}

/// Turns the buffers of one camera into pictures.
#[derive(Debug, Clone)]
pub(super) struct Unpacker {
    pub format: Format,
    pub granted: Granted,
    pub meaning: Meaning,
    needed: Vec<usize>,
}

impl Unpacker {
    pub fn new(format: Format, granted: Granted) -> Self {
        Self {
            meaning: Meaning::of(format, &granted),
            needed: format.needed(&granted),
            format,
            granted,
        }
    }

    /// Whether each plane holds what its picture needs.
    ///
    /// # Errors
    /// A sentence with the numbers.
    fn check(&self, planes: &[&[u8]]) -> Result<(), String> {
        if planes.len() < self.needed.len() {
            return Err(format!("{} planes of {}", planes.len(), self.needed.len()));
        }
        for (plane, needed) in planes.iter().zip(&self.needed) {
            if plane.len() < *needed {
                return Err(format!("{} bytes, and a picture has {needed}", plane.len()));
            }
        }
        Ok(())
    }

    /// The picture of a color camera.
    ///
    /// # Errors
    /// A sentence that says why these bytes are no picture of the granted format.
    pub fn picture(&self, planes: &[&[u8]]) -> Result<Pixels, String> {
        self.check(planes)?;
        let (width, height) = (self.granted.width, self.granted.height);
        let stride = self.granted.planes[0].stride;
        let first = planes[0];
        Ok(match self.format.layout {
            Layout::Jpeg => {
                let found = size_of_jpeg(first)?;
                if found != (width, height) {
                    return Err(format!(
                        "a JPEG of {}×{}, and {width}×{height} was granted",
                        found.0, found.1
                    ));
                }
                if first.len() > crate::admission::MAX_JPEG_BYTES {
                    return Err(format!("a JPEG of {} bytes", first.len()));
                }
                Pixels::Mjpg {
                    width,
                    height,
                    bytes: first.to_vec(),
                }
            }
            Layout::Yuyv if self.meaning.is_bt601_limited() => Pixels::Yuyv {
                width,
                height,
                bytes: tight(first, stride, 2 * width, height),
            },
            Layout::Nv12 if self.meaning.is_bt601_limited() => {
                let mut bytes = Vec::with_capacity(width * height * 3 / 2);
                append(&mut bytes, first, stride, width, height);
                let (chroma, stride) = self.chroma(planes);
                append(&mut bytes, chroma, stride, width, height / 2);
                Pixels::Nv12 {
                    width,
                    height,
                    bytes,
                }
            }
            Layout::Yuyv | Layout::Nv12 => Pixels::Rgb8(self.to_rgb(planes)?),
            Layout::Rgb { reversed } => {
                let mut samples = vec![[0; 3]; width * height];
                for (row, out) in
                    rows(first, stride, 3 * width).zip(samples.chunks_exact_mut(width))
                {
                    let (pixels, _) = row.as_chunks::<3>();
                    if reversed {
                        out.iter_mut()
                            .zip(pixels)
                            .for_each(|(out, [b, g, r])| *out = [*r, *g, *b]);
                    } else {
                        out.copy_from_slice(pixels);
                    }
                }
                Pixels::Rgb8(plane(width, height, samples)?)
            }
            Layout::Single(Packing::Bytes) => {
                let mut samples = vec![[0; 3]; width * height];
                for (row, out) in rows(first, stride, width).zip(samples.chunks_exact_mut(width)) {
                    out.iter_mut().zip(row).for_each(|(out, v)| *out = [*v; 3]);
                }
                Pixels::Rgb8(plane(width, height, samples)?)
            }
            Layout::Single(packing) => {
                let gray = full_scale(first, stride, width, height, packing);
                let samples = gray.into_iter().map(|v| [v; 3]).collect();
                Pixels::Rgb16(plane(width, height, samples)?)
            }
            Layout::Bayer(pattern, packing) => Pixels::Bayer {
                samples: plane(
                    width,
                    height,
                    full_scale(first, stride, width, height, packing),
                )?,
                pattern,
            },
        })
    }

    /// The picture of a depth camera in metres; NaN where the scale has no answer.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn depth(&self, planes: &[&[u8]], scale: &Scale) -> Result<Plane<f32>, String> {
        let (words, down) = self.single(planes)?;
        let metres = words.into_iter().map(|word| scale.metres(word >> down));
        plane(self.granted.width, self.granted.height, metres.collect())
    }

    /// The amplitude of a depth camera, in its own steps.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn amplitude(&self, planes: &[&[u8]]) -> Result<Plane<f32>, String> {
        let (words, down) = self.single(planes)?;
        let steps = words.into_iter().map(|word| f32::from(word >> down));
        plane(self.granted.width, self.granted.height, steps.collect())
    }

    /// Words of full scale of a picture with one number per pixel, and how far down in a word that
    /// number stands.
    fn single(&self, planes: &[&[u8]]) -> Result<(Vec<u16>, u32), String> {
        self.check(planes)?;
        let (width, height) = (self.granted.width, self.granted.height);
        let Layout::Single(packing) = self.format.layout else {
            return Err(format!(
                "{} holds more than one number per pixel",
                self.format.code
            ));
        };
        let stride = self.granted.planes[0].stride;
        let words = full_scale(planes[0], stride, width, height, packing);
        Ok((words, 16 - packing.bits()))
    }

    fn chroma<'a>(&self, planes: &[&'a [u8]]) -> (&'a [u8], usize) {
        let luma = self.granted.planes[0].stride;
        match planes {
            [_, chroma, ..] if self.needed.len() > 1 => (chroma, self.granted.planes[1].stride),
            // `check` has seen that it is there.
            _ => (
                planes[0].get(luma * self.granted.height..).unwrap_or(&[]),
                luma,
            ),
        }
    }

    /// Luma and chroma of another matrix or range than frames promise, as red, green, blue.
    fn to_rgb(&self, planes: &[&[u8]]) -> Result<Plane<[u8; 3]>, String> {
        let (width, height) = (self.granted.width, self.granted.height);
        let (w, h) = (width as u32, height as u32);
        let range = if self.meaning.full_range {
            yuv::YuvRange::Full
        } else {
            yuv::YuvRange::Limited
        };
        let matrix = self.meaning.matrix;
        let mut rgb = vec![[0; 3]; width * height];
        let target = rgb.as_flattened_mut();
        let done = if self.format.layout == Layout::Yuyv {
            let tight = tight(planes[0], self.granted.planes[0].stride, 2 * width, height);
            let image = yuv::YuvPackedImage {
                yuy: &tight,
                yuy_stride: 2 * w,
                width: w,
                height: h,
            };
            yuv::yuyv422_to_rgb(&image, target, 3 * w, range, matrix)
        } else {
            let (chroma, stride) = self.chroma(planes);
            let luma = tight(planes[0], self.granted.planes[0].stride, width, height);
            let chroma = tight(chroma, stride, width, height / 2);
            let image = yuv::YuvBiPlanarImage {
                y_plane: &luma,
                y_stride: w,
                uv_plane: &chroma,
                uv_stride: w,
                width: w,
                height: h,
            };
            yuv::yuv_nv12_to_rgb(
                &image,
                target,
                3 * w,
                range,
                matrix,
                yuv::YuvConversionMode::Balanced,
            )
        };
        done.map_err(|error| error.to_string())?;
        plane(width, height, rgb)
    }
}

fn plane<T>(width: usize, height: usize, samples: Vec<T>) -> Result<Plane<T>, String> {
    Plane::new(width, height, samples).map_err(|error| error.to_string())
}

/// Rows without their padding; the last may end where the buffer does.
fn rows(bytes: &[u8], stride: usize, length: usize) -> impl Iterator<Item = &[u8]> {
    bytes
        .chunks(stride.max(1))
        .filter_map(move |row| row.get(..length))
}

fn append(to: &mut Vec<u8>, bytes: &[u8], stride: usize, length: usize, height: usize) {
    if stride == length {
        to.extend_from_slice(&bytes[..length * height]);
    } else {
        rows(bytes, stride, length)
            .take(height)
            .for_each(|row| to.extend_from_slice(row));
    }
}

fn tight(bytes: &[u8], stride: usize, length: usize, height: usize) -> Vec<u8> {
    let mut tight = Vec::with_capacity(length * height);
    append(&mut tight, bytes, stride, length, height);
    tight
}

/// Samples widened to full scale 65535 by repeating their high bits below, so that white stays white.
fn full_scale(
    bytes: &[u8],
    stride: usize,
    width: usize,
    height: usize,
    packing: Packing,
) -> Vec<u16> {
    let mut samples = vec![0; width * height];
    let length = packing.row_bytes(width).unwrap_or(0);
    for (row, out) in rows(bytes, stride, length).zip(samples.chunks_exact_mut(width)) {
        match packing {
            Packing::Bytes => out
                .iter_mut()
                .zip(row)
                .for_each(|(out, v)| *out = u16::from(*v) << 8 | u16::from(*v)),
            Packing::Words { bits } => {
                // What stands above the bits that count is not promised to be zero.
                let mask = ((1u32 << bits) - 1) as u16;
                let (up, down) = (16 - bits, 2 * bits - 16);
                let (words, _) = row.as_chunks::<2>();
                out.iter_mut().zip(words).for_each(|(out, word)| {
                    let number = u16::from_le_bytes(*word) & mask;
                    *out = number << up | if up > 0 { number >> down } else { 0 };
                });
            }
            Packing::Ten => TEN.unpack(row, out),
            Packing::Twelve => TWELVE.unpack(row, out),
        }
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::{FourCc, PlaneLayout};
    use proptest::prelude::*;

    fn unpacker(code: &[u8; 4], width: usize, height: usize, strides: &[usize]) -> Unpacker {
        let granted = Granted {
            format: FourCc(*code),
            width,
            height,
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
        };
        let format = Format::of(granted.format).unwrap();
        assert_eq!(format.check(&granted), Ok(()));
        Unpacker::new(format, granted)
    }

    fn bayer(pixels: Pixels) -> Vec<u16> {
        match pixels {
            Pixels::Bayer { samples, .. } => samples.into_samples(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn white_is_full_scale_in_every_depth() {
        let cases: [(&[u8; 4], &[u8]); 6] = [
            (b"RGGB", &[0xff; 4]),
            (b"RG10", &[0xff, 0x03, 0xff, 0x03, 0xff, 0x03, 0xff, 0x03]),
            // Bits above those that count are ignored.
            (b"RG12", &[0xff; 8]),
            (b"RG16", &[0xff; 8]),
            (b"pRAA", &[0xff; 5]),
            (b"pRCC", &[0xff; 6]),
        ];
        for (code, bytes) in cases {
            let unpacker = unpacker(code, 4, 1, &[bytes.len()]);
            assert_eq!(bayer(unpacker.picture(&[bytes]).unwrap()), [65535; 4]);
        }
    }

    #[test]
    fn padding_is_left_out_and_the_last_may_be_missing() {
        let rows: [u8; 14] = [1, 2, 3, 4, 0, 0, 5, 6, 7, 8, 0, 0, 9, 9];
        let unpacker = unpacker(b"YUYV", 2, 2, &[6]);
        match unpacker.picture(&[&rows[..10]]).unwrap() {
            Pixels::Yuyv { bytes, .. } => assert_eq!(bytes, [1, 2, 3, 4, 5, 6, 7, 8]),
            other => panic!("{other:?}"),
        }
        assert!(unpacker.picture(&[&rows[..9]]).is_err());
    }

    #[test]
    fn two_planes_give_the_picture_that_one_gives() {
        let whole: Vec<u8> = (0..24).collect();
        let single = unpacker(b"NV12", 4, 4, &[4]).picture(&[&whole]).unwrap();
        let multi = unpacker(b"NM12", 4, 4, &[4, 4]);
        assert_eq!(
            single,
            multi.picture(&[&whole[..16], &whole[16..]]).unwrap()
        );
        assert!(multi.picture(&[&whole]).is_err());
        assert!(multi.picture(&[&whole[..16], &whole[16..20]]).is_err());
    }

    #[test]
    fn luma_of_another_range_becomes_the_same_gray() {
        let mut other = unpacker(b"YUYV", 2, 1, &[4]);
        other.granted.quantization = v4l::sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE;
        let other = Unpacker::new(other.format, other.granted);
        match other.picture(&[&[0, 128, 255, 128]]).unwrap() {
            Pixels::Rgb8(plane) => assert_eq!(plane.samples(), [[0; 3], [255; 3]]),
            pixels => panic!("{pixels:?}"),
        }
    }

    #[test]
    fn zero_and_what_is_out_of_range_is_no_depth() {
        let unpacker = unpacker(b"Z16 ", 4, 1, &[8]);
        let bytes: Vec<u8> = [0u16, 100, 1500, 9000]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let mut scale = Scale {
            unit_metres: 0.001,
            offset_metres: 0.0,
            nearest_metres: 0.2,
            farthest_metres: 8.0,
        };
        let depth = unpacker.depth(&[&bytes], &scale).unwrap();
        assert!(depth[(0, 0)].is_nan() && depth[(1, 0)].is_nan() && depth[(3, 0)].is_nan());
        assert!((depth[(2, 0)] - 1.5).abs() < 1e-6);
        let amplitude = unpacker.amplitude(&[&bytes]).unwrap();
        assert_eq!(amplitude.samples(), [0.0, 100.0, 1500.0, 9000.0]);
        // What a rig file says is too much is taken off, and only then is the range looked at.
        scale.offset_metres = 1.35;
        let depth = unpacker.depth(&[&bytes], &scale).unwrap();
        assert!(depth[(2, 0)].is_nan() && (depth[(3, 0)] - 7.65).abs() < 1e-5);
    }

    #[test]
    fn a_jpeg_of_another_size_is_refused_before_anything_decodes_it() {
        let picture = Plane::from_fn(16, 8, |x, y| [x as u8, y as u8, 0]);
        let file = crate::jpeg(&picture, 90);
        let fits = unpacker(b"MJPG", 16, 8, &[0]);
        assert!(fits.picture(&[&file]).is_ok());
        let refused = unpacker(b"MJPG", 32, 8, &[0]).picture(&[&file]);
        assert!(refused.unwrap_err().contains("16×8"));
        for broken in [&b"\xff\xd8\xff\xd9"[..], b"garbage", &file[..20]] {
            assert!(fits.picture(&[broken]).is_err());
        }
    }

    /// Seconds of processor time of the fastest of several runs.
    fn seconds(mut work: impl FnMut()) -> f64 {
        let spent = || {
            let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
            now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
        };
        (0..25)
            .map(|_| {
                let since = spent();
                work();
                spent() - since
            })
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    #[ignore = "a measurement, for a quiet machine: cargo test -p drivers --release --lib -- --ignored --nocapture megapixels"]
    fn twelve_megapixels_are_unpacked_in_the_time_of_at_most_two_copies() {
        let (width, height) = (4032, 3024);
        let cases: [(&[u8; 4], usize, f64); 4] = [
            (b"NV12", width, 1.5),
            (b"RG10", 2 * width, 2.0),
            (b"pRAA", width / 4 * 5, 2.0),
            (b"pRCC", width / 2 * 3, 2.0),
        ];
        let mut told = Vec::new();
        for (code, stride, bytes_per_pixel) in cases {
            let rows = if code == b"NV12" {
                height * 3 / 2
            } else {
                height
            };
            let buffer: Vec<u8> = (0..stride * rows).map(|i| (i * 31) as u8).collect();
            let unpacker = unpacker(code, width, height, &[stride]);
            let unpacked = seconds(|| drop(std::hint::black_box(unpacker.picture(&[&buffer]))));
            // As many bytes as the picture has, to new memory as well.
            let same = vec![7u8; ((width * height) as f64 * bytes_per_pixel) as usize];
            let copied = seconds(|| drop(std::hint::black_box(same.clone())));
            let ratio = unpacked / copied;
            let (code, milliseconds) = (unpacker.format.code, 1e3 * unpacked);
            told.push(format!("{code} {ratio:.2} ({milliseconds:.1} ms)"));
            assert!(ratio <= 2.0, "{code}: {ratio}");
        }
        eprintln!(
            "figure | 12 MP unpacked, processor time as a multiple of a copy of the result | {}",
            told.join(", ")
        );
    }

    proptest! {
        /// No bytes of any length make a panic, whatever the format.
        #[test]
        fn hostile_buffers_are_pictures_or_errors(
            index in 0..super::super::format::FORMATS.len(),
            bytes in prop::collection::vec(any::<u8>(), 0..400),
            chroma in prop::collection::vec(any::<u8>(), 0..100),
            padding in 0usize..9,
        ) {
            let format = super::super::format::FORMATS[index];
            let granted = Granted {
                format: format.code,
                width: 8,
                height: 4,
                planes: vec![PlaneLayout { stride: 24 + padding, size: 0 }; 2],
                colorspace: 0,
                transfer: 0,
                encoding: 2,
                quantization: 0,
            };
            let unpacker = Unpacker::new(format, granted);
            let scale = Scale {
                unit_metres: 0.001,
                offset_metres: 0.0,
                nearest_metres: 0.0,
                farthest_metres: 10.0,
            };
            let planes: [&[u8]; 2] = [&bytes, &chroma];
            if let Ok(pixels) = unpacker.picture(&planes) {
                prop_assert_eq!(pixels.size(), (8, 4));
            }
            for plane in [unpacker.depth(&planes, &scale), unpacker.amplitude(&planes)] {
                prop_assert!(plane.is_err() || plane.is_ok_and(|plane| plane.size() == (8, 4)));
            }
        }
    }
}
