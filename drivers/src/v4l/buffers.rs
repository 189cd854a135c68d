//! The kernel's buffers in our memory, and the flow of pictures through them.

use crate::node::{Filled, Node};
use std::{
    ffi::c_void,
    io,
    os::fd::{AsFd, AsRawFd},
};
use v4l::v4l2::{mmap, munmap};

/// A flow of pictures; dropping it stops the device, unmaps and frees every buffer.
#[derive(Debug)]
pub(super) struct Buffers {
    node: Node,
    multiplanar: bool,
    /// Planes of each buffer.
    mapped: Vec<Vec<Mapping>>,
}

/// One plane of one buffer, readable.
#[derive(Debug)]
struct Mapping {
    start: *mut c_void,
    length: usize,
}

// SAFETY: the mapping belongs to this value alone, and memory may be read from any thread.
unsafe impl Send for Mapping {}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: start and length are those of a mapping this value made and alone refers to.
        let unmapped = unsafe { munmap(self.start, self.length) };
        debug_assert!(unmapped.is_ok(), "{unmapped:?}");
    }
}

impl Buffers {
    /// Maps `count` buffers, gives all to the device, and starts it.
    pub fn start(node: Node, multiplanar: bool, count: u32) -> io::Result<Self> {
        let got = node.request_buffers(multiplanar, count)?;
        // From here dropping frees what was granted.
        let mut buffers = Self {
            node,
            multiplanar,
            mapped: Vec::new(),
        };
        if got == 0 {
            return Err(io::ErrorKind::OutOfMemory.into());
        }
        for index in 0..got {
            let places = buffers.node.buffer_planes(multiplanar, index)?;
            let planes = places
                .into_iter()
                .map(|(offset, length)| Mapping::new(&buffers.node, offset, length))
                .collect::<io::Result<Vec<_>>>()?;
            buffers.mapped.push(planes);
            buffers.node.queue(multiplanar, index)?;
        }
        buffers.node.start(multiplanar)?;
        Ok(buffers)
    }

    /// The node.
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// Takes a filled buffer, hands its planes to `read`, and gives it back to the device.
    ///
    /// Each plane is cut to the bytes the device says it wrote. `Ok(None)` when none is filled.
    pub fn take<A>(&mut self, read: impl FnOnce(&Filled, &[&[u8]]) -> A) -> io::Result<Option<A>> {
        let filled = match self.node.take(self.multiplanar) {
            Ok(filled) => filled,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(error),
        };
        let planes: Vec<&[u8]> = match self.mapped.get(filled.index) {
            Some(planes) => planes
                .iter()
                .zip(&filled.used)
                .map(|(plane, (offset, length))| plane.part(*offset, *length))
                .collect(),
            None => return Err(io::ErrorKind::InvalidData.into()),
        };
        let answer = read(&filled, &planes);
        self.node.queue(self.multiplanar, filled.index as u32)?;
        Ok(Some(answer))
    }
}

impl Mapping {
    fn new(node: &Node, offset: u64, length: usize) -> io::Result<Self> {
        let offset = offset.try_into().map_err(|_| io::ErrorKind::InvalidData)?;
        // SAFETY: a new mapping at a place of the kernel's choice overlaps nothing.
        let start = unsafe {
            mmap(
                std::ptr::null_mut(),
                length,
                libc::PROT_READ,
                libc::MAP_SHARED,
                node.as_fd().as_raw_fd(),
                offset,
            )?
        };
        Ok(Self { start, length })
    }

    /// A part of the plane, cut to what is there.
    fn part(&self, offset: usize, length: usize) -> &[u8] {
        let offset = offset.min(self.length);
        let length = length.min(self.length - offset);
        // SAFETY: the range lies within the mapping, which lives as long as `self`. The driver does
        // not write to a buffer that has been taken and not been given back; `Buffers::take` gives
        // it back only after the slice is out of use, as `read` cannot keep it.
        unsafe { std::slice::from_raw_parts(self.start.cast::<u8>().add(offset), length) }
    }
}

impl Drop for Buffers {
    fn drop(&mut self) {
        // A device that has gone refuses all of this; there is nothing left to stop then.
        drop(self.node.stop(self.multiplanar));
        self.mapped.clear();
        drop(self.node.request_buffers(self.multiplanar, 0));
    }
}
