//! File → frames, exactly as they were pushed.

use super::{
    COLOR_IMAGE, COLOR_JPEG, DEPTH_AMPLITUDE, DEPTH_IMAGE, DEPTH_SIGMA, FORMAT, FRAME, SESSION,
    container::{Container, Cursor, Found},
    malformed,
    schema::{self, FrameMetadata, PixelFormat, RawImage, Session},
};
use crate::{
    admission,
    calibration::Rig,
    device::{DeviceInfo, DriverError, Settings},
    frame::{ColorFrame, DepthFrame, Frame, Illumination, Pixels, Timestamp},
    plane::Plane,
};
use mcap::records::op;
use serde::Serialize;
use std::{
    collections::{HashMap, VecDeque},
    path::Path,
};

/// Most bytes of one of our JSON messages.
const MAX_JSON_BYTES: usize = 1 << 20;
const REMEDY: &str = "record again with this version, or recover what is whole with `mcap recover`";

/// A recording being read: an iterator of frames in the order they were pushed.
///
/// After an error the iterator ends. After its end [`Self::truncated_at`] says whether the
/// recording was cut.
pub struct Reader {
    session: Session,
    messages: Messages,
    ended: bool,
}

impl Reader {
    /// Opens a recording and reads its session.
    ///
    /// # Errors
    /// [`DriverError::Io`] when the file cannot be read; [`DriverError::Malformed`] when it is not
    /// a recording of ours, or so cut or damaged that the session is not there.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, DriverError> {
        let path = path.as_ref();
        let mut messages = Messages {
            container: Container::open(path)?,
            decoder: Decoder::default(),
            chunk: Vec::new(),
            position: None,
            chunk_start: 0,
            waiting: None,
        };
        while messages.step(None)? {
            if let Some(session) = messages.decoder.session.take() {
                return Ok(Self {
                    session,
                    messages,
                    ended: false,
                });
            }
        }
        let problem = match messages.container.truncated_at {
            Some(byte) => format!("cut at byte {byte}, before its /session message"),
            None => "holds no /session message".into(),
        };
        Err(malformed(
            path,
            problem,
            "this is no recording of ours; see `capturectl import`",
        ))
    }

    /// The device it was recorded from.
    pub fn info(&self) -> &DeviceInfo {
        &self.session.device
    }

    /// The rig it was recorded with.
    pub fn rig(&self) -> &Rig {
        &self.session.rig
    }

    /// What was asked of the device.
    pub fn settings(&self) -> &Settings {
        &self.session.settings
    }

    /// Byte at which the file stops being whole; `None` for a recording that was closed. Known
    /// once the iterator has ended.
    pub fn truncated_at(&self) -> Option<u64> {
        self.messages.container.truncated_at
    }
}

/// The messages of a file and what they add up to.
struct Messages {
    container: Container,
    decoder: Decoder,
    chunk: Vec<u8>,
    /// How far into `chunk` reading has come; `None` = a new chunk is needed.
    position: Option<usize>,
    chunk_start: u64,
    /// A frame that is complete.
    waiting: Option<Frame>,
}

impl Messages {
    /// Reads one record; false at the end.
    fn step(&mut self, session: Option<&Session>) -> Result<bool, DriverError> {
        if let Some(position) = self.position {
            let mut cursor = Cursor(self.chunk.get(position..).unwrap_or_default());
            if cursor.0.is_empty() {
                self.position = None;
                return Ok(true);
            }
            let at = self.chunk_start;
            let Some((opcode, body)) = cursor.record() else {
                let problem = format!("chunk at byte {at}: a record's length exceeds the chunk");
                return Err(malformed(&self.container.path, problem, REMEDY));
            };
            self.position = Some(self.chunk.len() - cursor.0.len());
            self.waiting = self
                .decoder
                .record(opcode, body, session)
                .map_err(|problem| broken(&self.container.path, at, problem))?;
            return Ok(true);
        }
        match self.container.next(&mut self.chunk)? {
            Found::Chunk(start) => {
                self.chunk_start = start;
                self.position = Some(0);
                Ok(true)
            }
            Found::Record(opcode, start) => {
                self.waiting = self
                    .decoder
                    .record(opcode, &self.chunk, session)
                    .map_err(|problem| broken(&self.container.path, start, problem))?;
                Ok(true)
            }
            Found::End => {
                if self.decoder.pending.is_some() && self.container.truncated_at.is_none() {
                    let problem = "the last frame's images are missing";
                    return Err(malformed(&self.container.path, problem, REMEDY));
                }
                Ok(false)
            }
        }
    }
}

fn broken(path: &Path, at: u64, problem: String) -> DriverError {
    malformed(
        path,
        format!("record or chunk at byte {at}: {problem}"),
        REMEDY,
    )
}

impl Iterator for Reader {
    type Item = Result<Frame, DriverError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(frame) = self.messages.waiting.take() {
                return Some(Ok(frame));
            }
            if self.ended {
                return None;
            }
            match self.messages.step(Some(&self.session)) {
                Ok(true) => {}
                Ok(false) => self.ended = true,
                Err(error) => {
                    self.ended = true;
                    return Some(Err(error));
                }
            }
        }
    }
}

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
struct Pending {
    metadata: FrameMetadata,
    missing: VecDeque<Part>,
    planes: Vec<(Part, Plane<f32>)>,
    pixels: Option<Pixels>,
}

#[derive(Default)]
struct Decoder {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Role>,
    session: Option<Session>,
    opened: bool,
    pending: Option<Pending>,
}

impl Decoder {
    fn record(
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
fn checked<'a>(
    message: &'a [u8],
    format: PixelFormat,
    (width, height): (usize, usize),
) -> Result<&'a [u8], String> {
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

/// What is in a recording, for `capturectl info`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The device it was recorded from.
    pub device: DeviceInfo,
    /// What was asked of it.
    pub settings: Settings,
    /// Color camera, `(width, height)` in pixels.
    pub color_size: (usize, usize),
    /// Depth camera, `(width, height)` in pixels.
    pub depth_size: (usize, usize),
    /// Color frames in the room's light alone.
    pub ambient_frames: u64,
    /// Color frames with the flash.
    pub flash_frames: u64,
    /// Depth frames.
    pub depth_frames: u64,
    /// Color frames the device counted and the recording lacks.
    pub color_gaps: u64,
    /// Depth frames the device counted and the recording lacks.
    pub depth_gaps: u64,
    /// Time of the earliest frame; `None` without frames.
    pub first: Option<Timestamp>,
    /// Time of the latest frame.
    pub last: Option<Timestamp>,
    /// From the earliest frame to the latest, seconds.
    pub duration_seconds: f64,
    /// Chunks: one for the session, then one per bracket.
    pub chunks: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Byte at which the file is cut; `None` = it was closed properly.
    pub truncated_at: Option<u64>,
}

/// Reads a recording to its end, frame by frame, and sums it up.
///
/// # Errors
/// As [`Reader::open`] and its iterator.
pub fn summarize(path: impl AsRef<Path>) -> Result<Summary, DriverError> {
    let mut reader = Reader::open(path)?;
    let mut summary = Summary {
        device: reader.info().clone(),
        settings: reader.settings().clone(),
        color_size: reader.rig().color.size(),
        depth_size: admission::depth_size(reader.rig()),
        ambient_frames: 0,
        flash_frames: 0,
        depth_frames: 0,
        color_gaps: 0,
        depth_gaps: 0,
        first: None,
        last: None,
        duration_seconds: 0.0,
        chunks: 0,
        bytes: reader.messages.container.bytes(),
        truncated_at: None,
    };
    let (mut color, mut depth): (Span, Span) = Default::default();
    for frame in reader.by_ref() {
        let frame = frame?;
        let at = frame.at();
        summary.first = Some(summary.first.map_or(at, |first| first.min(at)));
        summary.last = Some(summary.last.map_or(at, |last| last.max(at)));
        match &frame {
            Frame::Color(frame) => {
                color.add(frame.sequence);
                match frame.light {
                    Illumination::Ambient => summary.ambient_frames += 1,
                    Illumination::Flash => summary.flash_frames += 1,
                }
            }
            Frame::Depth(frame) => {
                depth.add(frame.sequence);
                summary.depth_frames += 1;
            }
        }
    }
    summary.color_gaps = color.gaps();
    summary.depth_gaps = depth.gaps();
    if let (Some(first), Some(last)) = (summary.first, summary.last) {
        summary.duration_seconds = last.distance(first).as_secs_f64();
    }
    summary.chunks = reader.messages.container.chunks;
    summary.truncated_at = reader.truncated_at();
    Ok(summary)
}

/// Sequence numbers seen, however they were ordered.
#[derive(Default)]
struct Span {
    range: Option<(u64, u64)>,
    count: u64,
}

impl Span {
    fn add(&mut self, sequence: u64) {
        let (low, high) = self.range.unwrap_or((sequence, sequence));
        self.range = Some((low.min(sequence), high.max(sequence)));
        self.count += 1;
    }

    fn gaps(&self) -> u64 {
        self.range.map_or(0, |(low, high)| {
            (high - low).saturating_add(1).saturating_sub(self.count)
        })
    }
}
