//! The messages a recording is made of: Foxglove's, in protobuf, and two of ours, in JSON.
//!
//! Field numbers are those of Foxglove's published schemas; a viewer reads them from the
//! descriptor stored in the file, which [`descriptor`] builds from the same tables.

use super::protobuf::{Encoder, Fields, Value};
use crate::{
    calibration::{Distortion, Intrinsics, RigidTransform},
    frame::{BayerPattern, Exposure, Illumination, Timestamp, Transfer},
};
use serde::{Deserialize, Serialize};

/// One file, one session: what stands in the first message.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Session {
    /// Version of this layout.
    pub format: u32,
    pub device: crate::DeviceInfo,
    pub rig: crate::Rig,
    pub settings: crate::Settings,
}

/// What Foxglove's image messages cannot say about a frame; stands before its images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "camera", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum FrameMetadata {
    Color {
        at: Timestamp,
        sequence: u64,
        light: Illumination,
        exposure: Exposure,
        transfer: Transfer,
        black_level: f32,
        white_level: f32,
        pixels: PixelFormat,
    },
    Depth {
        at: Timestamp,
        sequence: u64,
        /// A plane of amplitude follows the depth.
        amplitude: bool,
        /// A plane of sigma follows those.
        sigma: bool,
    },
}

/// How the bytes of a color image are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum PixelFormat {
    Bayer(BayerPattern),
    Yuyv,
    Nv12,
    Mjpg,
    Rgb8,
    Rgb16,
    RgbF32,
}

impl PixelFormat {
    /// Encoding name in `foxglove.RawImage`. A mosaic is called a 16-bit gray picture, which every
    /// viewer shows, where `bayer_rggb16` is shown by none.
    pub fn encoding(self) -> &'static str {
        match self {
            Self::Bayer(_) => "16UC1",
            Self::Yuyv => "yuyv",
            Self::Nv12 => "nv12",
            Self::Mjpg => "jpeg",
            Self::Rgb8 => "rgb8",
            Self::Rgb16 => "rgb16",
            Self::RgbF32 => "32FC3",
        }
    }

    /// Bytes in one row of the first plane.
    pub fn step(self, width: usize) -> usize {
        width
            * match self {
                Self::Nv12 => 1,
                Self::Bayer(_) | Self::Yuyv => 2,
                Self::Rgb8 => 3,
                Self::Rgb16 => 6,
                Self::RgbF32 => 12,
                Self::Mjpg => 0,
            }
    }
}

/// Schema text of the two messages of ours.
pub(super) const SESSION_SCHEMA: &str = r#"{"title":"captured.Session","type":"object","required":["format","device","rig","settings"],"properties":{"format":{"type":"integer"},"device":{"type":"object"},"rig":{"type":"object"},"settings":{"type":"object"}}}"#;
pub(super) const METADATA_SCHEMA: &str = r#"{"title":"captured.FrameMetadata","type":"object","required":["camera","at","sequence"],"properties":{"camera":{"enum":["color","depth"]},"at":{"type":"integer","description":"nanoseconds, CLOCK_MONOTONIC, first row starts to expose"},"sequence":{"type":"integer"},"light":{"enum":["ambient","flash"]},"exposure":{"type":"object","properties":{"seconds":{"type":"number"},"gain":{"type":"number"}}},"black_level":{"type":"number"},"white_level":{"type":"number"},"amplitude":{"type":"boolean"},"sigma":{"type":"boolean"}}}"#;

/// A raw picture read back, borrowed from its message.
#[derive(Debug, Default)]
pub(super) struct RawImage<'a> {
    pub width: u32,
    pub height: u32,
    pub step: u32,
    pub encoding: &'a [u8],
    pub data: &'a [u8],
}

impl<'a> RawImage<'a> {
    pub fn encode(&self, at: Timestamp, frame_id: &str) -> Vec<u8> {
        // Room for the fields that are not the data.
        Encoder::with_capacity(self.data.len() + 128)
            .message(1, timestamp(at))
            .fixed32(2, self.width)
            .fixed32(3, self.height)
            .bytes(4, self.encoding)
            .fixed32(5, self.step)
            .bytes(6, self.data)
            .string(7, frame_id)
            .finish()
    }

    pub fn decode(message: &'a [u8]) -> Result<Self, &'static str> {
        let mut image = Self::default();
        for field in Fields::of(message) {
            match field? {
                (2, Value::Fixed32(value)) => image.width = value,
                (3, Value::Fixed32(value)) => image.height = value,
                (4, Value::Bytes(value)) => image.encoding = value,
                (5, Value::Fixed32(value)) => image.step = value,
                (6, Value::Bytes(value)) => image.data = value,
                _ => {}
            }
        }
        Ok(image)
    }
}

/// `foxglove.CompressedImage` around a JPEG.
pub(super) fn encode_jpeg(at: Timestamp, frame_id: &str, jpeg: &[u8]) -> Vec<u8> {
    Encoder::with_capacity(jpeg.len() + 128)
        .message(1, timestamp(at))
        .bytes(2, jpeg)
        .string(3, "jpeg")
        .string(4, frame_id)
        .finish()
}

/// The JPEG inside a `foxglove.CompressedImage`.
pub(super) fn decode_jpeg(message: &[u8]) -> Result<&[u8], &'static str> {
    let (mut data, mut format) = (&[][..], &[][..]);
    for field in Fields::of(message) {
        match field? {
            (2, Value::Bytes(value)) => data = value,
            (3, Value::Bytes(value)) => format = value,
            _ => {}
        }
    }
    if format == b"jpeg" {
        Ok(data)
    } else {
        Err("the compressed picture is not a jpeg")
    }
}

/// `foxglove.CameraCalibration` of a lens, for viewers.
pub(super) fn encode_calibration(at: Timestamp, frame_id: &str, lens: &Intrinsics) -> Vec<u8> {
    let (model, length) = match lens.distortion {
        Distortion::None {} => ("", 0),
        Distortion::BrownConrady { .. } => ("plumb_bob", 5),
        Distortion::Rational { .. } => ("rational_polynomial", 8),
    };
    let coefficients = &lens.distortion.coefficients()[..length];
    let Intrinsics { fx, fy, cx, cy, .. } = *lens;
    Encoder::default()
        .message(1, timestamp(at))
        .fixed32(2, lens.width as u32)
        .fixed32(3, lens.height as u32)
        .string(4, model)
        .doubles(5, coefficients)
        .doubles(6, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        .doubles(7, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .doubles(8, &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
        .string(9, frame_id)
        .finish()
}

/// `foxglove.FrameTransform` from the depth camera to the color camera, for viewers.
pub(super) fn encode_transform(at: Timestamp, to_color: &RigidTransform) -> Vec<u8> {
    let shift = to_color.translation_metres;
    let turn = glam::DQuat::from_mat3(&to_color.rotation).normalize();
    let vector = Encoder::default()
        .double(1, shift.x)
        .double(2, shift.y)
        .double(3, shift.z);
    let quaternion = Encoder::default()
        .double(1, turn.x)
        .double(2, turn.y)
        .double(3, turn.z)
        .double(4, turn.w);
    Encoder::default()
        .message(1, timestamp(at))
        .string(2, "color")
        .string(3, "depth")
        .message(4, vector)
        .message(5, quaternion)
        .finish()
}

fn timestamp(at: Timestamp) -> Encoder {
    const SECOND: u64 = 1_000_000_000;
    Encoder::default()
        .varint(1, at.as_nanos() / SECOND)
        .varint(2, at.as_nanos() % SECOND)
}

/// Kind of a field in a descriptor.
enum Kind {
    Double,
    Doubles,
    Int32,
    Int64,
    Fixed32,
    Text,
    Bytes,
    Message(&'static str),
}

type Field = (&'static str, u32, Kind);
const TIME: Kind = Kind::Message(".google.protobuf.Timestamp");

/// `FileDescriptorSet` of one of Foxglove's messages and all it uses, as MCAP asks for.
pub(super) fn descriptor(name: &str) -> Option<Vec<u8>> {
    use Kind::{Bytes, Double, Doubles, Fixed32, Message, Text};
    let fields: Vec<Field> = match name {
        "foxglove.RawImage" => vec![
            ("timestamp", 1, TIME),
            ("width", 2, Fixed32),
            ("height", 3, Fixed32),
            ("encoding", 4, Text),
            ("step", 5, Fixed32),
            ("data", 6, Bytes),
            ("frame_id", 7, Text),
        ],
        "foxglove.CompressedImage" => vec![
            ("timestamp", 1, TIME),
            ("data", 2, Bytes),
            ("format", 3, Text),
            ("frame_id", 4, Text),
        ],
        "foxglove.CameraCalibration" => vec![
            ("timestamp", 1, TIME),
            ("width", 2, Fixed32),
            ("height", 3, Fixed32),
            ("distortion_model", 4, Text),
            ("D", 5, Doubles),
            ("K", 6, Doubles),
            ("R", 7, Doubles),
            ("P", 8, Doubles),
            ("frame_id", 9, Text),
        ],
        "foxglove.FrameTransform" => vec![
            ("timestamp", 1, TIME),
            ("parent_frame_id", 2, Text),
            ("child_frame_id", 3, Text),
            ("translation", 4, Message(".foxglove.Vector3")),
            ("rotation", 5, Message(".foxglove.Quaternion")),
        ],
        _ => return None,
    };
    let time = file(
        "google/protobuf/timestamp.proto",
        "google.protobuf",
        &[],
        &[(
            "Timestamp",
            vec![("seconds", 1, Kind::Int64), ("nanos", 2, Kind::Int32)],
        )],
    );
    let mut messages = vec![(name.trim_start_matches("foxglove."), fields)];
    if name == "foxglove.FrameTransform" {
        let axes = |names: &[&'static str]| -> Vec<Field> {
            names
                .iter()
                .zip(1..)
                .map(|(axis, number)| (*axis, number, Double))
                .collect()
        };
        messages.push(("Vector3", axes(&["x", "y", "z"])));
        messages.push(("Quaternion", axes(&["x", "y", "z", "w"])));
    }
    let path = format!("{}.proto", name.replace('.', "/"));
    let own = file(
        &path,
        "foxglove",
        &["google/protobuf/timestamp.proto"],
        &messages,
    );
    Some(Encoder::default().message(1, time).message(1, own).finish())
}

/// A `FileDescriptorProto`.
fn file(path: &str, package: &str, needs: &[&str], messages: &[(&str, Vec<Field>)]) -> Encoder {
    let mut file = Encoder::default().string(1, path).string(2, package);
    for needed in needs {
        file = file.string(3, needed);
    }
    for (name, fields) in messages {
        let mut message = Encoder::default().string(1, name);
        for (name, number, kind) in fields {
            // Type numbers of google.protobuf.FieldDescriptorProto; label 1 = single, 3 = repeated.
            let (label, kind_number) = match kind {
                Kind::Double => (1, 1),
                Kind::Doubles => (3, 1),
                Kind::Int64 => (1, 3),
                Kind::Int32 => (1, 5),
                Kind::Fixed32 => (1, 7),
                Kind::Text => (1, 9),
                Kind::Message(_) => (1, 11),
                Kind::Bytes => (1, 12),
            };
            let mut field = Encoder::default()
                .string(1, name)
                .varint(3, u64::from(*number))
                .varint(4, label)
                .varint(5, kind_number);
            if let Kind::Message(target) = kind {
                field = field.string(6, target);
            }
            message = message.message(2, field);
        }
        file = file.message(4, message);
    }
    file.string(12, "proto3")
}
