//! Messages → frames: each held against its schema, the rig and the frame it announces.

use super::{
    COLOR_IMAGE, COLOR_JPEG, DEPTH_AMPLITUDE, DEPTH_IMAGE, DEPTH_SIGMA, FORMAT, FRAME, SESSION,
    container::Cursor,
    schema::{self, FrameMetadata, PixelFormat, RawImage, Session},
};
use crate::{
    admission,
    frame::{ColorFrame, DepthFrame, Frame, Pixels},
    plane::Plane,
};
use mcap::records::op;
use std::collections::{HashMap, VecDeque};

/// Most bytes of one of our JSON messages.
const MAX_JSON_BYTES: usize = 1 << 20;

/// What a channel carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Session,
    Frame,
    Image(Part),
    Other,
}

/// Which image of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Raw,
    Jpeg,
    Metres,
    Amplitude,
    Sigma,
}

/// A frame whose images have not all come yet.
pub(super) struct Pending {
    metadata: FrameMetadata,
    missing: VecDeque<Part>,
    planes: Vec<(Part, Plane<f32>)>,
    pixels: Option<Pixels>,
}

/// What was declared so far, and the frame being put together.
#[derive(Default)]
pub(super) struct Decoder {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Role>,
    /// The session, until it is taken.
    pub session: Option<Session>,
    opened: bool,
    /// A frame whose images have not all come.
    pub pending: Option<Pending>,
}

impl Decoder {
    /// Takes a record; gives the frame that it completes.
    pub fn record(
        &mut self,
        opcode: u8,
        body: &[u8],
        session: Option<&Session>,
    ) -> Result<Option<Frame>, String> {
        match opcode {
            op::SCHEMA => self.schema(body).map(|()| None),
            op::CHANNEL => self.channel(body).map(|()| None),
            op::MESSAGE => self.message(body, session),
            _ => Ok(None),
        }
    }

    fn schema(&mut self, body: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor(body);
        let parsed = (|| Some((cursor.u16()?, cursor.text()?)))();
        let (id, name) = parsed.ok_or("a schema is cut off")?;
        let name = std::str::from_utf8(name).map_err(|_| "a schema's name is not UTF-8")?;
        self.schemas.insert(id, name.to_owned());
        Ok(())
    }

    fn channel(&mut self, body: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor(body);
        let parsed = (|| Some((cursor.u16()?, cursor.u16()?, cursor.text()?, cursor.text()?)))();
        let (id, schema, topic, encoding) = parsed.ok_or("a channel is cut off")?;
        let topic = std::str::from_utf8(topic).map_err(|_| "a topic is not UTF-8")?;
        let (role, needed, needed_encoding) = match topic {
            SESSION => (Role::Session, "captured.Session", "json"),
            FRAME => (Role::Frame, "captured.FrameMetadata", "json"),
            COLOR_IMAGE => (Role::Image(Part::Raw), "foxglove.RawImage", "protobuf"),
            COLOR_JPEG => (
                Role::Image(Part::Jpeg),
                "foxglove.CompressedImage",
                "protobuf",
            ),
            DEPTH_IMAGE => (Role::Image(Part::Metres), "foxglove.RawImage", "protobuf"),
            DEPTH_AMPLITUDE => (
                Role::Image(Part::Amplitude),
                "foxglove.RawImage",
                "protobuf",
            ),
            DEPTH_SIGMA => (Role::Image(Part::Sigma), "foxglove.RawImage", "protobuf"),
            _ => (Role::Other, "", ""),
        };
        if role != Role::Other {
            let found = self.schemas.get(&schema).map_or("none", String::as_str);
            if found != needed || encoding != needed_encoding.as_bytes() {
                let encoding = String::from_utf8_lossy(encoding).into_owned();
                return Err(format!(
                    "topic {topic} has schema {found} in {encoding:?}, not {needed} in {needed_encoding}"
                ));
            }
        }
        self.channels.insert(id, role);
        Ok(())
    }

    fn message(&mut self, body: &[u8], session: Option<&Session>) -> Result<Option<Frame>, String> {
        let mut cursor = Cursor(body);
        let parsed = (|| Some((cursor.u16()?, cursor.take(4 + 8 + 8)?)))();
        let (channel, _) = parsed.ok_or("a message is cut off")?;
        let role = *self
            .channels
            .get(&channel)
            .ok_or_else(|| format!("a message of channel {channel}, which is not declared"))?;
        match role {
            Role::Other => Ok(None),
            Role::Session => self.open_session(cursor.0).map(|()| None),
            Role::Frame => self.open_frame(cursor.0).map(|()| None),
            Role::Image(part) => {
                self.image(part, cursor.0, session.ok_or("a frame before /session")?)
            }
        }
    }

    fn open_session(&mut self, json: &[u8]) -> Result<(), String> {
        if self.opened {
            return Err("a second /session".into());
        }
        let session: Session = parse_json(SESSION, json)?;
        if session.format != FORMAT {
            let found = session.format;
            return Err(format!(
                "/session: format is {found}, this version reads {FORMAT}"
            ));
        }
        admission::admit_rig(&session.rig).map_err(|refusal| format!("/session: {refusal}"))?;
        self.opened = true;
        self.session = Some(session);
        Ok(())
    }

    fn open_frame(&mut self, json: &[u8]) -> Result<(), String> {
        if self.pending.is_some() {
            return Err("/frame: the images of the frame before are missing".into());
        }
        let metadata: FrameMetadata = parse_json(FRAME, json)?;
        let missing = match metadata {
            FrameMetadata::Color {
                pixels: PixelFormat::Mjpg,
                ..
            } => vec![Part::Jpeg],
            FrameMetadata::Color { .. } => vec![Part::Raw],
            FrameMetadata::Depth {
                amplitude, sigma, ..
            } => {
                let parts = [
                    (true, Part::Metres),
                    (amplitude, Part::Amplitude),
                    (sigma, Part::Sigma),
                ];
                parts
                    .into_iter()
                    .filter(|(there, _)| *there)
                    .map(|(_, part)| part)
                    .collect()
            }
        };
        self.pending = Some(Pending {
            metadata,
            missing: missing.into(),
            planes: vec![],
            pixels: None,
        });
        Ok(())
    }

    fn image(
        &mut self,
        part: Part,
        message: &[u8],
        session: &Session,
    ) -> Result<Option<Frame>, String> {
        let Some(mut pending) = self.pending.take() else {
            return Err(format!("image {part:?} without a /frame before it"));
        };
        let needed = pending.missing.pop_front();
        if needed != Some(part) {
            return Err(format!("image {part:?} where {needed:?} belongs"));
        }
        match (&pending.metadata, part) {
            (FrameMetadata::Color { .. }, Part::Jpeg) => {
                let jpeg = schema::decode_jpeg(message)?;
                if jpeg.len() > admission::MAX_JPEG_BYTES {
                    return Err(format!("a jpeg of {} bytes", jpeg.len()));
                }
                let (width, height) = session.rig.color.size();
                pending.pixels = Some(Pixels::Mjpg {
                    width,
                    height,
                    bytes: jpeg.to_vec(),
                });
            }
            (FrameMetadata::Color { pixels, .. }, _) => {
                let format = *pixels;
                let image = checked(message, format, session.rig.color.size())?;
                pending.pixels = Some(unpack(format, session.rig.color.size(), image)?);
            }
            (FrameMetadata::Depth { .. }, _) => {
                let size = admission::depth_size(&session.rig);
                let plane = float_plane(message, size)?;
                pending.planes.push((part, plane));
            }
        }
        if !pending.missing.is_empty() {
            self.pending = Some(pending);
            return Ok(None);
        }
        let frame = pending.assemble().ok_or("a frame without its image")?;
        admission::admit(&frame, &session.rig).map_err(|refusal| refusal.to_string())?;
        Ok(Some(frame))
    }
}

impl Pending {
    fn assemble(self) -> Option<Frame> {
        let mut planes = self.planes;
        let mut plane = |part: Part| {
            let index = planes.iter().position(|(found, _)| *found == part)?;
            Some(planes.swap_remove(index).1)
        };
        Some(match self.metadata {
            FrameMetadata::Color {
                at,
                sequence,
                light,
                exposure,
                transfer,
                black_level,
                white_level,
                pixels: _,
            } => Frame::Color(ColorFrame {
                at,
                sequence,
                light,
                exposure,
                pixels: self.pixels?,
                transfer,
                black_level,
                white_level,
            }),
            FrameMetadata::Depth { at, sequence, .. } => Frame::Depth(DepthFrame {
                at,
                sequence,
                metres: plane(Part::Metres)?,
                amplitude: plane(Part::Amplitude),
                sigma: plane(Part::Sigma),
            }),
        })
    }
}

fn parse_json<T: serde::de::DeserializeOwned>(topic: &str, json: &[u8]) -> Result<T, String> {
    if json.len() > MAX_JSON_BYTES {
        return Err(format!(
            "{topic}: {} bytes of JSON, limit {MAX_JSON_BYTES}",
            json.len()
        ));
    }
    serde_json::from_slice(json).map_err(|error| format!("{topic}: {error}"))
}

/// The bytes of a raw image whose size, row length and encoding are what they must be.
fn checked(
    message: &[u8],
    format: PixelFormat,
    (width, height): (usize, usize),
) -> Result<&[u8], String> {
    image_bytes(
        message,
        format.encoding(),
        format.step(width),
        (width, height),
    )
}

fn image_bytes<'a>(
    message: &'a [u8],
    encoding: &str,
    step: usize,
    (width, height): (usize, usize),
) -> Result<&'a [u8], String> {
    let image = RawImage::decode(message)?;
    if (image.width as usize, image.height as usize) != (width, height) {
        let (w, h) = (image.width, image.height);
        return Err(format!(
            "an image of {w}×{h}, but the rig says {width}×{height}"
        ));
    }
    if image.encoding != encoding.as_bytes() || image.step as usize != step {
        let found = String::from_utf8_lossy(image.encoding);
        return Err(format!(
            "encoding {found:?}, step {}; not {encoding:?}, {step}",
            image.step
        ));
    }
    Ok(image.data)
}

fn float_plane(message: &[u8], (width, height): (usize, usize)) -> Result<Plane<f32>, String> {
    let data = image_bytes(message, "32FC1", 4 * width, (width, height))?;
    let (values, []) = data.as_chunks::<4>() else {
        return Err("a plane is no whole number of samples".into());
    };
    let values = values
        .iter()
        .map(|bytes| f32::from_le_bytes(*bytes))
        .collect();
    Plane::new(width, height, values).map_err(|error| error.to_string())
}

fn unpack(
    format: PixelFormat,
    (width, height): (usize, usize),
    data: &[u8],
) -> Result<Pixels, String> {
    let short = || {
        format!(
            "{} bytes do not make a {width}×{height} {format:?}",
            data.len()
        )
    };
    fn triples<const BYTES: usize, T: Copy>(
        data: &[u8],
        from: fn([u8; BYTES]) -> T,
    ) -> Vec<[T; 3]> {
        let samples: Vec<T> = data
            .as_chunks::<BYTES>()
            .0
            .iter()
            .map(|bytes| from(*bytes))
            .collect();
        samples.as_chunks::<3>().0.to_vec()
    }
    // The packed formats are held to their length by admission; the planes here.
    let pixels = match format {
        PixelFormat::Yuyv => Pixels::Yuyv {
            width,
            height,
            bytes: data.to_vec(),
        },
        PixelFormat::Nv12 => Pixels::Nv12 {
            width,
            height,
            bytes: data.to_vec(),
        },
        PixelFormat::Mjpg => return Err("a jpeg is no raw image".into()),
        _ if data.len() != format.step(width) * height => return Err(short()),
        PixelFormat::Bayer(pattern) => {
            let samples = data
                .as_chunks::<2>()
                .0
                .iter()
                .map(|bytes| u16::from_le_bytes(*bytes));
            let samples = Plane::new(width, height, samples.collect()).map_err(|_| short())?;
            Pixels::Bayer { samples, pattern }
        }
        PixelFormat::Rgb8 => Pixels::Rgb8(
            Plane::new(width, height, data.as_chunks::<3>().0.to_vec()).map_err(|_| short())?,
        ),
        PixelFormat::Rgb16 => {
            let samples = triples(data, u16::from_le_bytes);
            Pixels::Rgb16(Plane::new(width, height, samples).map_err(|_| short())?)
        }
        PixelFormat::RgbF32 => {
            let samples = triples(data, f32::from_le_bytes);
            Pixels::RgbF32(Plane::new(width, height, samples).map_err(|_| short())?)
        }
    };
    Ok(pixels)
}
