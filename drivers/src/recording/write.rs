//! Frames → file, one chunk per bracket, synced.

use super::{
    COLOR_CALIBRATION, COLOR_IMAGE, COLOR_JPEG, DEPTH_AMPLITUDE, DEPTH_CALIBRATION, DEPTH_IMAGE,
    DEPTH_SIGMA, FORMAT, FRAME, SESSION, TRANSFORM, io, malformed,
    schema::{self, FrameMetadata, PixelFormat, RawImage, Session},
};
use crate::{
    admission,
    calibration::Rig,
    device::{DeviceInfo, DriverError, Settings},
    frame::{ColorFrame, DepthFrame, Frame, Pixels, Timestamp},
    plane::Plane,
};
use mcap::{WriteOptions, records::MessageHeader};
use std::{
    collections::BTreeMap,
    fs::File,
    io::BufWriter,
    path::{Path, PathBuf},
};

/// A recording being written.
pub struct Writer {
    path: PathBuf,
    rig: Rig,
    mcap: mcap::Writer<BufWriter<File>>,
    /// Stands below `mcap`, and so is dropped after it.
    tail: Tail,
    channels: BTreeMap<&'static str, u16>,
    messages: u32,
    calibrated: bool,
}

/// A second handle on the file being written: syncs it, and cuts off what was never finished.
///
/// A write that fails (a full disk) leaves a piece of a chunk behind, and whoever drops the writer
/// then has the rest of it written: no reader could make sense of that.
struct Tail {
    file: File,
    /// Length of the file up to the last bracket that is whole and synced.
    whole_bytes: u64,
    closed: bool,
}

impl Tail {
    fn sync(&mut self) -> std::io::Result<()> {
        self.file.sync_data()?;
        self.whole_bytes = self.file.metadata()?.len();
        Ok(())
    }
}

impl Drop for Tail {
    fn drop(&mut self) {
        if !self.closed {
            // Failing too, it leaves a file that may be refused: nothing more can be done.
            let _ = self.file.set_len(self.whole_bytes);
        }
    }
}

impl Writer {
    /// Starts a recording at `path`, which must not exist yet, and syncs its first message, so
    /// that the file is readable from here on.
    ///
    /// # Errors
    /// [`DriverError::Io`] when the file exists or cannot be written; [`DriverError::Malformed`]
    /// for a rig that [`admission::admit_rig`] refuses.
    pub fn create(
        path: impl AsRef<Path>,
        info: &DeviceInfo,
        rig: &Rig,
        settings: &Settings,
    ) -> Result<Self, DriverError> {
        let path = path.as_ref();
        admission::admit_rig(rig)
            .map_err(|refusal| malformed(path, refusal.to_string(), "correct the rig"))?;
        let output = File::create_new(path).map_err(|source| io(path, source))?;
        let file = output.try_clone().map_err(|source| io(path, source))?;
        let mcap = WriteOptions::new()
            .compression(None)
            .chunk_size(None)
            .profile("")
            .library(concat!("captured ", env!("CARGO_PKG_VERSION")))
            .create(BufWriter::with_capacity(1 << 16, output))
            .map_err(|error| refused(path, error))?;
        let mut writer = Self {
            path: path.to_owned(),
            rig: *rig,
            mcap,
            tail: Tail {
                file,
                whole_bytes: 0,
                closed: false,
            },
            channels: BTreeMap::new(),
            messages: 0,
            calibrated: false,
        };
        let session = Session {
            format: FORMAT,
            device: info.clone(),
            rig: *rig,
            settings: settings.clone(),
        };
        let json = writer.json(&session)?;
        writer.message(SESSION, Timestamp::from_nanos(0), &json)?;
        writer.finish_bracket()?;
        // The name of a new file is safe only once its folder is.
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        File::open(folder)
            .and_then(|folder| folder.sync_all())
            .map_err(|source| io(folder, source))?;
        Ok(writer)
    }

    /// Adds a frame to the bracket being written.
    ///
    /// # Errors
    /// [`DriverError::Malformed`] for a frame that [`admission::admit`] refuses: nothing is written
    /// then. [`DriverError::Io`] when the file cannot be written.
    pub fn push(&mut self, frame: &Frame) -> Result<(), DriverError> {
        admission::admit(frame, &self.rig).map_err(|refusal| {
            malformed(
                &self.path,
                refusal.to_string(),
                "record only what the contract allows",
            )
        })?;
        if !self.calibrated {
            self.calibrated = true;
            self.calibration(frame.at())?;
        }
        match frame {
            Frame::Color(frame) => self.color(frame),
            Frame::Depth(frame) => self.depth(frame),
        }
    }

    /// Ends the bracket: what was pushed so far is on the disk when this returns, and survives.
    ///
    /// # Errors
    /// [`DriverError::Io`] when writing or syncing fails; the bracket is then lost.
    pub fn finish_bracket(&mut self) -> Result<(), DriverError> {
        self.mcap
            .flush()
            .map_err(|error| refused(&self.path, error))?;
        self.tail.sync().map_err(|source| io(&self.path, source))
    }

    /// Ends the recording with its index. A writer that is dropped instead leaves what was
    /// finished.
    ///
    /// # Errors
    /// As [`Self::finish_bracket`].
    pub fn close(mut self) -> Result<(), DriverError> {
        self.finish_bracket()?;
        self.mcap
            .finish()
            .map_err(|error| refused(&self.path, error))?;
        self.tail
            .file
            .sync_all()
            .map_err(|source| io(&self.path, source))?;
        self.tail.closed = true;
        Ok(())
    }

    fn json(&self, message: &impl serde::Serialize) -> Result<Vec<u8>, DriverError> {
        serde_json::to_vec(message)
            .map_err(|error| malformed(&self.path, error.to_string(), "report this as a bug"))
    }

    fn channel(&mut self, topic: &'static str) -> Result<u16, DriverError> {
        if let Some(id) = self.channels.get(topic) {
            return Ok(*id);
        }
        let (schema, encoding) = match topic {
            SESSION => ("captured.Session", "json"),
            FRAME => ("captured.FrameMetadata", "json"),
            COLOR_JPEG => ("foxglove.CompressedImage", "protobuf"),
            COLOR_CALIBRATION | DEPTH_CALIBRATION => ("foxglove.CameraCalibration", "protobuf"),
            TRANSFORM => ("foxglove.FrameTransform", "protobuf"),
            _ => ("foxglove.RawImage", "protobuf"),
        };
        let text = match topic {
            SESSION => schema::SESSION_SCHEMA.as_bytes().to_vec(),
            FRAME => schema::METADATA_SCHEMA.as_bytes().to_vec(),
            _ => schema::descriptor(schema).unwrap_or_default(),
        };
        let schema_encoding = if encoding == "json" {
            "jsonschema"
        } else {
            encoding
        };
        let id = self
            .mcap
            .add_schema(schema, schema_encoding, &text)
            .and_then(|schema| {
                self.mcap
                    .add_channel(schema, topic, encoding, &BTreeMap::new())
            })
            .map_err(|error| refused(&self.path, error))?;
        self.channels.insert(topic, id);
        Ok(id)
    }

    fn message(
        &mut self,
        topic: &'static str,
        at: Timestamp,
        data: &[u8],
    ) -> Result<(), DriverError> {
        let channel_id = self.channel(topic)?;
        let header = MessageHeader {
            channel_id,
            sequence: self.messages,
            log_time: at.as_nanos(),
            publish_time: at.as_nanos(),
        };
        self.messages = self.messages.wrapping_add(1);
        self.mcap
            .write_to_known_channel(&header, data)
            .map_err(|error| refused(&self.path, error))
    }

    fn calibration(&mut self, at: Timestamp) -> Result<(), DriverError> {
        let color = schema::encode_calibration(at, "color", &self.rig.color);
        self.message(COLOR_CALIBRATION, at, &color)?;
        if let Some(depth) = self.rig.depth {
            let lens = schema::encode_calibration(at, "depth", &depth.lens);
            self.message(DEPTH_CALIBRATION, at, &lens)?;
            self.message(
                TRANSFORM,
                at,
                &schema::encode_transform(at, &depth.to_color),
            )?;
        }
        Ok(())
    }

    fn color(&mut self, frame: &ColorFrame) -> Result<(), DriverError> {
        let (format, data) = packed(&frame.pixels);
        let metadata = self.json(&FrameMetadata::Color {
            at: frame.at,
            sequence: frame.sequence,
            light: frame.light,
            exposure: frame.exposure,
            transfer: frame.transfer.clone(),
            black_level: frame.black_level,
            white_level: frame.white_level,
            pixels: format,
        })?;
        self.message(FRAME, frame.at, &metadata)?;
        if format == PixelFormat::Mjpg {
            let jpeg = schema::encode_jpeg(frame.at, "color", &data);
            return self.message(COLOR_JPEG, frame.at, &jpeg);
        }
        let (width, height) = frame.pixels.size();
        let image = RawImage {
            width: width as u32,
            height: height as u32,
            step: format.step(width) as u32,
            encoding: format.encoding().as_bytes(),
            data: &data,
        };
        self.message(COLOR_IMAGE, frame.at, &image.encode(frame.at, "color"))
    }

    fn depth(&mut self, frame: &DepthFrame) -> Result<(), DriverError> {
        let metadata = self.json(&FrameMetadata::Depth {
            at: frame.at,
            sequence: frame.sequence,
            amplitude: frame.amplitude.is_some(),
            sigma: frame.sigma.is_some(),
        })?;
        self.message(FRAME, frame.at, &metadata)?;
        let planes = [
            (DEPTH_IMAGE, Some(&frame.metres)),
            (DEPTH_AMPLITUDE, frame.amplitude.as_ref()),
            (DEPTH_SIGMA, frame.sigma.as_ref()),
        ];
        for (topic, plane) in planes {
            let Some(plane) = plane else { continue };
            let image = float_image(plane);
            let frame_id = if self.rig.depth.is_some() {
                "depth"
            } else {
                "color"
            };
            let message = RawImage {
                width: plane.width() as u32,
                height: plane.height() as u32,
                step: 4 * plane.width() as u32,
                encoding: b"32FC1",
                data: &image,
            };
            self.message(topic, frame.at, &message.encode(frame.at, frame_id))?;
        }
        Ok(())
    }
}

fn refused(path: &Path, error: mcap::McapError) -> DriverError {
    match error {
        mcap::McapError::Io(source) => io(path, source),
        other => io(path, std::io::Error::other(other)),
    }
}

fn float_image(plane: &Plane<f32>) -> Vec<u8> {
    plane
        .samples()
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

/// Samples as the bytes of an image message, little endian.
fn packed(pixels: &Pixels) -> (PixelFormat, std::borrow::Cow<'_, [u8]>) {
    use std::borrow::Cow::{Borrowed, Owned};
    match pixels {
        Pixels::Bayer { samples, pattern } => (
            PixelFormat::Bayer(*pattern),
            Owned(
                samples
                    .samples()
                    .iter()
                    .flat_map(|value| value.to_le_bytes())
                    .collect(),
            ),
        ),
        Pixels::Yuyv { bytes, .. } => (PixelFormat::Yuyv, Borrowed(bytes)),
        Pixels::Nv12 { bytes, .. } => (PixelFormat::Nv12, Borrowed(bytes)),
        Pixels::Mjpg { bytes, .. } => (PixelFormat::Mjpg, Borrowed(bytes)),
        Pixels::Rgb8(plane) => (PixelFormat::Rgb8, Borrowed(plane.samples().as_flattened())),
        Pixels::Rgb16(plane) => {
            let samples = plane.samples().as_flattened();
            (
                PixelFormat::Rgb16,
                Owned(
                    samples
                        .iter()
                        .flat_map(|value| value.to_le_bytes())
                        .collect(),
                ),
            )
        }
        Pixels::RgbF32(plane) => {
            let samples = plane.samples().as_flattened();
            (
                PixelFormat::RgbF32,
                Owned(
                    samples
                        .iter()
                        .flat_map(|value| value.to_le_bytes())
                        .collect(),
                ),
            )
        }
    }
}
