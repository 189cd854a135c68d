//! MCAP's framing, read with suspicion: every length is held against the bytes that are there
//! before anything is allocated or skipped.
//!
//! The `mcap` crate writes our files; reading is done here because a cut file must still give what
//! was whole, with the offset of the cut, and because a recording may come from a stranger.

use super::{MAX_CHUNK_BYTES, io, malformed};
use crate::device::DriverError;
use mcap::{MAGIC, records::op};
use std::{
    fs::File,
    io::{BufReader, ErrorKind, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

const REMEDY: &str = "record again, or recover what is whole with `mcap recover`";

/// More than the counts of any file of ours.
const MAX_STATISTICS_BYTES: u64 = 1 << 16;

/// Records at the top level of a file, one at a time.
pub(super) struct Container {
    pub path: PathBuf,
    input: BufReader<File>,
    length: u64,
    /// Where the next record starts.
    offset: u64,
    /// Where the file stopped making sense, if it did before its end mark.
    pub truncated_at: Option<u64>,
    pub chunks: u64,
    /// Chunks there should be, as the writer counted them when it closed the file.
    counted: Option<u32>,
}

/// What [`Container::next`] found; the body is in the buffer given to it.
pub(super) enum Found {
    /// A record with messages in it (or a schema, a channel): its opcode and offset.
    Record(u8, u64),
    /// The data of a chunk, already checked: offset of the chunk.
    Chunk(u64),
    End,
}

impl Container {
    pub fn open(path: &Path) -> Result<Self, DriverError> {
        let file = File::open(path).map_err(|source| io(path, source))?;
        let metadata = file.metadata().map_err(|source| io(path, source))?;
        if !metadata.is_file() {
            return Err(malformed(
                path,
                "not an ordinary file",
                "name an .mcap file",
            ));
        }
        let mut input = BufReader::new(file);
        let mut magic = [0; 8];
        let read = input.read_exact(&mut magic);
        if read.is_err() || magic != MAGIC {
            return Err(malformed(
                path,
                "does not begin with MCAP's magic bytes",
                "name an .mcap file",
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            input,
            length: metadata.len(),
            offset: 8,
            truncated_at: None,
            chunks: 0,
            counted: None,
        })
    }

    /// Size of the file in bytes.
    pub fn bytes(&self) -> u64 {
        self.length
    }

    fn cut(&mut self) -> Result<Found, DriverError> {
        self.truncated_at = Some(self.offset);
        Ok(Found::End)
    }

    /// Moves to the next record that can hold messages.
    pub fn next(&mut self, body: &mut Vec<u8>) -> Result<Found, DriverError> {
        if self.truncated_at.is_some() {
            return Ok(Found::End);
        }
        loop {
            let mut head = [0; 9];
            match self.input.read_exact(&mut head) {
                Ok(()) => {}
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => return self.cut(),
                Err(source) => return Err(io(&self.path, source)),
            }
            let opcode = head[0];
            let size = u64::from_le_bytes(std::array::from_fn(|i| head[i + 1]));
            let start = self.offset;
            if opcode == 0 {
                let problem = format!("byte {start}: no record has opcode 0");
                return Err(malformed(&self.path, problem, REMEDY));
            }
            // An unfinished chunk carries an impossible size, so a crash ends up here too.
            if size > self.length.saturating_sub(start + 9) {
                return self.cut();
            }
            self.offset = start + 9 + size;
            match opcode {
                op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK => {
                    if !self.read_body(size, start, body)? {
                        self.offset = start;
                        return self.cut();
                    }
                    if opcode != op::CHUNK {
                        return Ok(Found::Record(opcode, start));
                    }
                    self.chunks += 1;
                    self.unwrap_chunk(start, body)?;
                    return Ok(Found::Chunk(start));
                }
                op::FOOTER => {
                    // Whole if the closing magic follows.
                    self.skip()?;
                    let mut magic = [0; 8];
                    if self.input.read_exact(&mut magic).is_err() || magic != MAGIC {
                        return self.cut();
                    }
                    self.input
                        .seek(SeekFrom::Start(start))
                        .map_err(|source| io(&self.path, source))?;
                    self.offset = start;
                    return self.end();
                }
                op::STATISTICS if size <= MAX_STATISTICS_BYTES => {
                    if !self.read_body(size, start, body)? {
                        self.offset = start;
                        return self.cut();
                    }
                    let mut cursor = Cursor(body);
                    // Before it: counts of messages, schemas, channels, attachments, metadata.
                    self.counted = cursor.take(8 + 2 + 4 + 4 + 4).and_then(|_| cursor.u32());
                }
                _ => self.skip()?,
            }
        }
    }

    /// The end of a file that was closed: nothing may be missing.
    fn end(&mut self) -> Result<Found, DriverError> {
        match self.counted {
            Some(counted) if u64::from(counted) != self.chunks => {
                let problem = format!("{} chunks of {counted} can be found", self.chunks);
                Err(malformed(&self.path, problem, REMEDY))
            }
            _ => Ok(Found::End),
        }
    }

    fn skip(&mut self) -> Result<(), DriverError> {
        self.input
            .seek(SeekFrom::Start(self.offset))
            .map(|_| ())
            .map_err(|source| io(&self.path, source))
    }

    /// False when the file ended early after all (it shrank while being read).
    fn read_body(
        &mut self,
        size: u64,
        start: u64,
        body: &mut Vec<u8>,
    ) -> Result<bool, DriverError> {
        if size > MAX_CHUNK_BYTES {
            let problem =
                format!("byte {start}: a record of {size} bytes, limit {MAX_CHUNK_BYTES}");
            return Err(malformed(
                &self.path,
                problem,
                "finish a bracket more often",
            ));
        }
        body.clear();
        let read = self
            .input
            .by_ref()
            .take(size)
            .read_to_end(body)
            .map_err(|source| io(&self.path, source))?;
        Ok(read as u64 == size)
    }

    /// Cuts `body` down to the chunk's records after checking size and checksum.
    fn unwrap_chunk(&self, start: u64, body: &mut Vec<u8>) -> Result<(), DriverError> {
        let wrong = |problem: String| {
            malformed(
                &self.path,
                format!("chunk at byte {start}: {problem}"),
                REMEDY,
            )
        };
        let mut cursor = Cursor(body);
        let header = (|| {
            let (_from, _to) = (cursor.u64()?, cursor.u64()?);
            let (size, crc) = (cursor.u64()?, cursor.u32()?);
            let compression = cursor.text()?.to_vec();
            Some((size, crc, compression, cursor.u64()?))
        })();
        let (size, crc, compression, stored) =
            header.ok_or_else(|| wrong("its header is cut off".into()))?;
        let records = cursor.0;
        if !compression.is_empty() {
            let name = String::from_utf8_lossy(&compression);
            return Err(malformed(
                &self.path,
                format!("chunk at byte {start}: compressed with {name:?}"),
                "unpack it first: mcap compress --compression none IN -o OUT",
            ));
        }
        if size != stored || stored != records.len() as u64 {
            let found = records.len();
            return Err(wrong(format!(
                "declares {size} and {stored} bytes, holds {found}"
            )));
        }
        let found = crc32fast::hash(records);
        if crc != 0 && crc != found {
            return Err(wrong(format!("checksum is {found:08x}, not {crc:08x}")));
        }
        let from = body.len() - records.len();
        body.drain(..from);
        Ok(())
    }
}

/// Bytes taken from the front, never beyond the end.
pub(super) struct Cursor<'a>(pub &'a [u8]);

impl<'a> Cursor<'a> {
    pub fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.take(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.take(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.take(8)?.try_into().ok().map(u64::from_le_bytes)
    }

    /// MCAP's string: a 32-bit length, then bytes.
    pub fn text(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(usize::try_from(length).ok()?)
    }

    /// One record inside a chunk: opcode and body.
    pub fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let opcode = *self.take(1)?.first()?;
        let length = self.u64()?;
        Some((opcode, self.take(usize::try_from(length).ok()?)?))
    }
}
