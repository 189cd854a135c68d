//! File → frames, exactly as they were pushed.

use super::{
    container::{Container, Cursor, Found},
    decode::Decoder,
    malformed,
    schema::Session,
};
use crate::{
    calibration::Rig,
    device::{DeviceInfo, DriverError, Settings},
    frame::Frame,
};
use std::path::Path;

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

    /// Size of the file.
    pub(super) fn bytes(&self) -> u64 {
        self.messages.container.bytes()
    }

    /// Chunks read so far.
    pub(super) fn chunks(&self) -> u64 {
        self.messages.container.chunks
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
