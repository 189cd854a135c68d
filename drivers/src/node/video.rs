//! Video capture: capabilities, formats and buffers, single- and multi-planar alike.

use super::{Node, Plain, Request, plain, text};
use std::{fmt, io};
use v4l::{
    sys::{
        V4L2_BUF_FLAG_ERROR, V4L2_BUF_FLAG_TIMESTAMP_MASK, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
        V4L2_BUF_FLAG_TSTAMP_SRC_MASK, V4L2_BUF_FLAG_TSTAMP_SRC_SOE, V4L2_CAP_DEVICE_CAPS,
        V4L2_CAP_STREAMING, V4L2_CAP_TIMEPERFRAME, V4L2_CAP_VIDEO_CAPTURE,
        V4L2_CAP_VIDEO_CAPTURE_MPLANE, v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE as SINGLE,
        v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE as MULTI, v4l2_buffer, v4l2_capability,
        v4l2_fmtdesc, v4l2_format, v4l2_frmsizeenum, v4l2_memory_V4L2_MEMORY_MMAP as MEMORY_MMAP,
        v4l2_pix_format, v4l2_plane, v4l2_plane_pix_format, v4l2_requestbuffers, v4l2_streamparm,
    },
    v4l2::vidioc,
};

/// Most planes a picture may have (`VIDEO_MAX_PLANES`).
pub(crate) const MAX_PLANES: usize = 8;

/// Four characters that name a format.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct FourCc(pub [u8; 4]);

impl FourCc {
    /// The code as the kernel's number.
    pub const fn number(self) -> u32 {
        u32::from_le_bytes(self.0)
    }
}

impl fmt::Display for FourCc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Bit 31 marks a big-endian variant; it is no character.
        let visible = self.0.map(|byte| match byte & 0x7f {
            c @ 0x20..=0x7e => char::from(c),
            _ => '?',
        });
        let word: String = visible.iter().collect();
        f.write_str(word.trim_end())
    }
}

impl fmt::Debug for FourCc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// What a node is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Capabilities {
    /// Kernel driver.
    pub driver: String,
    /// Model as people know it.
    pub card: String,
    /// Where it is plugged in.
    pub bus: String,
    /// Buffers hold several planes.
    pub multiplanar: bool,
}

/// A picture format to ask for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked {
    pub format: FourCc,
    pub width: u32,
    pub height: u32,
}

/// One plane of a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct PlaneLayout {
    /// From one row to the next, bytes; 0 for compressed pictures.
    pub stride: usize,
    /// Whole plane, bytes.
    pub size: usize,
}

/// The picture format that was granted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Granted {
    pub format: FourCc,
    pub width: usize,
    pub height: usize,
    pub planes: Vec<PlaneLayout>,
    /// `V4L2_COLORSPACE_…`, `V4L2_XFER_FUNC_…`, `V4L2_YCBCR_ENC_…`, `V4L2_QUANTIZATION_…`; 0 = default.
    pub colorspace: u32,
    pub transfer: u32,
    pub encoding: u32,
    pub quantization: u32,
}

/// What the kernel says about a filled buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Flags {
    /// The data may be wrong.
    pub error: bool,
    /// The time is of `CLOCK_MONOTONIC`.
    pub monotonic: bool,
    /// The time is when the exposure started, rather than when the picture was whole.
    pub start_of_exposure: bool,
}

/// A filled buffer.
#[derive(Debug, Clone)]
pub(crate) struct Filled {
    /// Which of the buffers.
    pub index: usize,
    /// Bytes that are valid in each plane, from `offset` on.
    pub used: Vec<(usize, usize)>,
    pub flags: Flags,
    /// The device's count, which wraps.
    pub sequence: u32,
    /// Nanoseconds; of which clock, `flags` says.
    pub nanoseconds: u64,
}

plain!(
    v4l2_capability,
    v4l2_fmtdesc,
    v4l2_format,
    v4l2_frmsizeenum,
    v4l2_streamparm,
    v4l2_requestbuffers,
    v4l2_buffer,
    v4l2_plane,
    v4l2_pix_format,
    v4l2_plane_pix_format,
    i32
);

const CAPABILITIES: Request<v4l2_capability> = Request::new(vidioc::VIDIOC_QUERYCAP);
const LIST_FORMATS: Request<v4l2_fmtdesc> = Request::new(vidioc::VIDIOC_ENUM_FMT);
const LIST_SIZES: Request<v4l2_frmsizeenum> = Request::new(vidioc::VIDIOC_ENUM_FRAMESIZES);
const GET_FORMAT: Request<v4l2_format> = Request::new(vidioc::VIDIOC_G_FMT);
const SET_FORMAT: Request<v4l2_format> = Request::new(vidioc::VIDIOC_S_FMT);
const GET_RATE: Request<v4l2_streamparm> = Request::new(vidioc::VIDIOC_G_PARM);
const SET_RATE: Request<v4l2_streamparm> = Request::new(vidioc::VIDIOC_S_PARM);
const BUFFERS: Request<v4l2_requestbuffers> = Request::new(vidioc::VIDIOC_REQBUFS);
const DESCRIBE: Request<v4l2_buffer> = Request::new(vidioc::VIDIOC_QUERYBUF);
const QUEUE: Request<v4l2_buffer> = Request::new(vidioc::VIDIOC_QBUF);
const TAKE: Request<v4l2_buffer> = Request::new(vidioc::VIDIOC_DQBUF);
const START: Request<i32> = Request::new(vidioc::VIDIOC_STREAMON);
const STOP: Request<i32> = Request::new(vidioc::VIDIOC_STREAMOFF);

/// More formats or sizes than this are not asked for.
const MOST: u32 = 256;

fn kind(multiplanar: bool) -> u32 {
    if multiplanar { MULTI } else { SINGLE }
}

impl Node {
    /// What this node is; `None` when it cannot stream pictures to us.
    pub fn capabilities(&self) -> io::Result<Option<Capabilities>> {
        let mut raw = v4l2_capability::zero();
        // SAFETY: the type holds no pointers.
        unsafe { self.request(&CAPABILITIES, &mut raw)? };
        let of_node = if raw.capabilities & V4L2_CAP_DEVICE_CAPS != 0 {
            raw.device_caps
        } else {
            raw.capabilities
        };
        let captures = of_node & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0;
        Ok(
            (captures && of_node & V4L2_CAP_STREAMING != 0).then(|| Capabilities {
                driver: text(&raw.driver),
                card: text(&raw.card),
                bus: text(&raw.bus_info),
                multiplanar: of_node & V4L2_CAP_VIDEO_CAPTURE == 0,
            }),
        )
    }

    /// Formats the node offers.
    pub fn formats(&self, multiplanar: bool) -> Vec<FourCc> {
        let mut found = Vec::new();
        for index in 0..MOST {
            let mut raw = v4l2_fmtdesc {
                index,
                type_: kind(multiplanar),
                ..Plain::zero()
            };
            // SAFETY: the type holds no pointers.
            if unsafe { self.request(&LIST_FORMATS, &mut raw) }.is_err() {
                break;
            }
            found.push(FourCc(raw.pixelformat.to_le_bytes()));
        }
        found
    }

    /// Sizes the node offers in a format: each, or the least and the greatest of a range.
    pub fn sizes(&self, format: FourCc) -> Vec<(u32, u32)> {
        let mut found = Vec::new();
        for index in 0..MOST {
            let mut raw = v4l2_frmsizeenum {
                index,
                pixel_format: format.number(),
                ..Plain::zero()
            };
            // SAFETY: the type holds no pointers.
            if unsafe { self.request(&LIST_SIZES, &mut raw) }.is_err() {
                break;
            }
            // SAFETY: `type_` says which member the kernel filled; both are plain integers.
            unsafe {
                if raw.type_ == v4l::sys::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
                    let size = raw.__bindgen_anon_1.discrete;
                    found.push((size.width, size.height));
                } else {
                    let range = raw.__bindgen_anon_1.stepwise;
                    found.push((range.min_width, range.min_height));
                    found.push((range.max_width, range.max_height));
                    break;
                }
            }
        }
        found
    }

    /// The format in force.
    pub fn format(&self, multiplanar: bool) -> io::Result<Granted> {
        let mut raw = v4l2_format {
            type_: kind(multiplanar),
            ..Plain::zero()
        };
        // SAFETY: the type holds no pointers that the kernel reads for capture formats.
        unsafe { self.request(&GET_FORMAT, &mut raw)? };
        Ok(granted(&raw, multiplanar))
    }

    /// Asks for a format and tells what was granted, which may be another one altogether.
    ///
    /// Strides start from 0: an old one would survive, and rows would be padded for nothing.
    pub fn set_format(&self, multiplanar: bool, asked: Asked) -> io::Result<Granted> {
        let mut raw = v4l2_format {
            type_: kind(multiplanar),
            ..Plain::zero()
        };
        if multiplanar {
            // SAFETY: the union was all zero, which is valid for every member.
            let pix = unsafe { &mut raw.fmt.pix_mp };
            pix.width = asked.width;
            pix.height = asked.height;
            pix.pixelformat = asked.format.number();
            pix.field = v4l::sys::v4l2_field_V4L2_FIELD_NONE;
        } else {
            raw.fmt.pix = v4l2_pix_format {
                width: asked.width,
                height: asked.height,
                pixelformat: asked.format.number(),
                field: v4l::sys::v4l2_field_V4L2_FIELD_NONE,
                ..Plain::zero()
            };
        }
        // SAFETY: as in `format`.
        unsafe { self.request(&SET_FORMAT, &mut raw)? };
        Ok(granted(&raw, multiplanar))
    }

    /// Seconds from frame to frame, after asking for `seconds` if given; `None` where the device
    /// does not tell.
    pub fn frame_time(&self, multiplanar: bool, seconds: Option<f64>) -> Option<f64> {
        let mut raw = v4l2_streamparm {
            type_: kind(multiplanar),
            ..Plain::zero()
        };
        // SAFETY: the type holds no pointers.
        unsafe { self.request(&GET_RATE, &mut raw) }.ok()?;
        // SAFETY: the kernel filled `capture`, of integers only.
        let able = unsafe { raw.parm.capture.capability } & V4L2_CAP_TIMEPERFRAME != 0;
        if let Some(seconds) = seconds.filter(|_| able) {
            raw = v4l2_streamparm {
                type_: kind(multiplanar),
                ..Plain::zero()
            };
            // SAFETY: the union is all zero, valid for every member.
            let time = unsafe { &mut raw.parm.capture.timeperframe };
            // In units of 10 µs, which are enough for any frame rate.
            time.numerator = (seconds * 1e5).round() as u32;
            time.denominator = 100_000;
            // SAFETY: the type holds no pointers.
            unsafe { self.request(&SET_RATE, &mut raw) }.ok()?;
        }
        // SAFETY: as above.
        let time = unsafe { raw.parm.capture.timeperframe };
        let seconds = f64::from(time.numerator) / f64::from(time.denominator);
        (seconds.is_finite() && seconds > 0.0).then_some(seconds)
    }

    /// Asks for `count` buffers in the kernel's memory and tells how many there are; 0 frees them.
    pub fn request_buffers(&self, multiplanar: bool, count: u32) -> io::Result<u32> {
        let mut raw = v4l2_requestbuffers {
            count,
            type_: kind(multiplanar),
            memory: MEMORY_MMAP,
            ..Plain::zero()
        };
        // SAFETY: the type holds no pointers.
        unsafe { self.request(&BUFFERS, &mut raw)? };
        Ok(raw.count)
    }

    /// Where each plane of a buffer can be mapped: offset and length.
    pub fn buffer_planes(&self, multiplanar: bool, index: u32) -> io::Result<Vec<(u64, usize)>> {
        self.with_buffer(&DESCRIBE, multiplanar, index, |raw, planes| {
            // SAFETY: for memory of kind MMAP the kernel fills the offsets.
            unsafe {
                if multiplanar {
                    let all = planes.iter().take(raw.length as usize);
                    all.map(|plane| (u64::from(plane.m.mem_offset), plane.length as usize))
                        .collect()
                } else {
                    vec![(u64::from(raw.m.offset), raw.length as usize)]
                }
            }
        })
    }

    /// Gives a buffer to the device to be filled.
    pub fn queue(&self, multiplanar: bool, index: u32) -> io::Result<()> {
        self.with_buffer(&QUEUE, multiplanar, index, |_, _| ())
    }

    /// Takes a filled buffer; an error of kind `WouldBlock` when none is.
    pub fn take(&self, multiplanar: bool) -> io::Result<Filled> {
        self.with_buffer(&TAKE, multiplanar, 0, |raw, planes| Filled {
            index: raw.index as usize,
            used: if multiplanar {
                planes
                    .iter()
                    .take(raw.length as usize)
                    .map(|plane| {
                        let offset = plane.data_offset as usize;
                        (offset, (plane.bytesused as usize).saturating_sub(offset))
                    })
                    .collect()
            } else {
                vec![(0, raw.bytesused as usize)]
            },
            flags: Flags {
                error: raw.flags & V4L2_BUF_FLAG_ERROR != 0,
                monotonic: raw.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK
                    == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
                start_of_exposure: raw.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK
                    == V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
            },
            sequence: raw.sequence,
            nanoseconds: nanoseconds(&raw.timestamp),
        })
    }

    fn with_buffer<A>(
        &self,
        request: &Request<v4l2_buffer>,
        multiplanar: bool,
        index: u32,
        read: impl FnOnce(&v4l2_buffer, &[v4l2_plane]) -> A,
    ) -> io::Result<A> {
        let mut planes = [v4l2_plane::zero(); MAX_PLANES];
        let mut raw = v4l2_buffer {
            index,
            type_: kind(multiplanar),
            memory: MEMORY_MMAP,
            ..Plain::zero()
        };
        if multiplanar {
            raw.m.planes = planes.as_mut_ptr();
            raw.length = MAX_PLANES as u32;
        }
        // SAFETY: `planes` has as many elements as `length` says and lives until after the call.
        unsafe { self.request(request, &mut raw)? };
        Ok(read(&raw, &planes))
    }

    /// Starts the flow of pictures.
    pub fn start(&self, multiplanar: bool) -> io::Result<()> {
        // SAFETY: the argument is a number.
        unsafe { self.request(&START, &mut (kind(multiplanar) as i32)) }
    }

    /// Stops it, and takes all buffers back.
    pub fn stop(&self, multiplanar: bool) -> io::Result<()> {
        // SAFETY: the argument is a number.
        unsafe { self.request(&STOP, &mut (kind(multiplanar) as i32)) }
    }
}

fn granted(raw: &v4l2_format, multiplanar: bool) -> Granted {
    // SAFETY: the kernel filled the member that belongs to the type asked for; both are integers.
    unsafe {
        if multiplanar {
            let pix = raw.fmt.pix_mp;
            let all = pix.plane_fmt;
            Granted {
                format: FourCc(pix.pixelformat.to_le_bytes()),
                width: pix.width as usize,
                height: pix.height as usize,
                planes: all
                    .iter()
                    .take(pix.num_planes as usize)
                    .map(|plane| PlaneLayout {
                        stride: plane.bytesperline as usize,
                        size: plane.sizeimage as usize,
                    })
                    .collect(),
                colorspace: pix.colorspace,
                transfer: u32::from(pix.xfer_func),
                encoding: u32::from(pix.__bindgen_anon_1.ycbcr_enc),
                quantization: u32::from(pix.quantization),
            }
        } else {
            let pix = raw.fmt.pix;
            Granted {
                format: FourCc(pix.pixelformat.to_le_bytes()),
                width: pix.width as usize,
                height: pix.height as usize,
                planes: vec![PlaneLayout {
                    stride: pix.bytesperline as usize,
                    size: pix.sizeimage as usize,
                }],
                colorspace: pix.colorspace,
                transfer: pix.xfer_func,
                encoding: pix.__bindgen_anon_1.ycbcr_enc,
                quantization: pix.quantization,
            }
        }
    }
}

/// Nanoseconds of a kernel time; a time before zero becomes 0, which no camera gives.
fn nanoseconds(time: &v4l::sys::timeval) -> u64 {
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    let micros = u64::try_from(time.tv_usec).unwrap_or(0);
    seconds
        .saturating_mul(1_000_000_000)
        .saturating_add(micros.saturating_mul(1000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_shown_as_people_write_them() {
        assert_eq!(FourCc(*b"Z16 ").to_string(), "Z16");
        assert_eq!(FourCc([b'Y', b'1', b'6', b' ' | 0x80]).to_string(), "Y16");
        assert_eq!(FourCc([0, 1, 2, 3]).to_string(), "????");
        assert_eq!(FourCc(*b"YUYV").number(), 0x5659_5559);
    }
}
