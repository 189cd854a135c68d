//! What a bridge said, without the bridge.

use super::{
    DepthAi, Options,
    bridge::{Bridge, shared_memory},
};
use crate::{
    device::{Device, DriverError, Settings},
    frame::Frame,
};
use std::{
    io::{self, Write},
    net::Shutdown,
    os::unix::net::UnixStream,
    path::Path,
    thread,
    time::Duration,
};

/// Longest wait for words that come as fast as they are read.
const PATIENCE: Duration = Duration::from_secs(10);

/// All that the bridge of an OAK camera said, and the memory it shared. Nothing of it is believed: it goes the
/// way of a running bridge's.
#[derive(Debug, Clone, Copy)]
pub struct Transcript<'a> {
    /// Messages, each four bytes of length, little-endian, and JSON.
    pub said: &'a [u8],
    /// The memory, as it lay while every frame was read.
    pub memory: &'a [u8],
}

impl Transcript<'_> {
    /// Opens the device it speaks for, streams, and hands over each frame of known light.
    ///
    /// # Errors
    /// What [`DepthAi::open`] and its stream give, but for the end of the words, which is none.
    pub fn play(
        &self,
        options: &Options,
        deliver: &mut dyn FnMut(Frame),
    ) -> Result<(), DriverError> {
        let device = options.address();
        let failed = |source| DriverError::Io {
            path: Path::new(&device).to_owned(),
            source,
        };
        let (line, theirs) = UnixStream::pair().map_err(failed)?;
        let mut memory = shared_memory().map_err(failed)?;
        memory.write_all(self.memory).map_err(failed)?;
        let bridge = Bridge::new(&device, None, line, memory);
        thread::scope(|scope| {
            // Both end with the bridge, which shuts its end when it is dropped.
            scope.spawn(|| {
                drop((&theirs).write_all(self.said));
                drop(theirs.shutdown(Shutdown::Write));
            });
            scope.spawn(|| drop(io::copy(&mut &theirs, &mut io::sink())));
            let mut device = DepthAi::through(bridge, options.clone())?;
            let mut stream = device.start(&Settings::default())?;
            loop {
                match stream.next_frame(PATIENCE) {
                    Ok(frame) => deliver(frame),
                    Err(DriverError::Ended { .. } | DriverError::Unplugged { .. }) => return Ok(()),
                    Err(error) => return Err(error),
                }
            }
        })
    }
}
