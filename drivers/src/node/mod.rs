//! Device nodes of the Linux kernel: typed requests where the `v4l` crate has none.
//!
//! The crate's `sys` types and request codes are used; this layer adds what it lacks (multi-planar
//! buffers, media controller, subdevices, events, bitmask controls) and avoids what panics in it
//! (names that are no UTF-8, controls of unknown type, a stream that cannot be stopped).

mod control;
mod event;
mod failure;
mod media;
mod video;

pub(crate) use control::Control;
pub(crate) use event::{CONTROL_CHANGED, Event, SOURCE_CHANGED};
pub(crate) use failure::{is_gone, opening, refused};
pub(crate) use media::{FLASH, nodes_with_function};
#[cfg(test)]
pub(crate) use video::Flags;
pub(crate) use video::{Asked, Capabilities, Filled, FourCc, Granted, PlaneLayout};

use std::{
    fs::{File, OpenOptions},
    io,
    marker::PhantomData,
    mem::size_of,
    os::fd::{AsFd, AsRawFd, BorrowedFd, RawFd},
    os::unix::fs::OpenOptionsExt,
    path::{Path, PathBuf},
    time::Duration,
};
use v4l::v4l2::vidioc::_IOC_TYPE as Code;

/// An open device node; closed when dropped.
#[derive(Debug)]
pub(crate) struct Node {
    file: File,
    path: PathBuf,
}

impl AsRawFd for Node {
    fn as_raw_fd(&self) -> RawFd {
        self.file.as_raw_fd()
    }
}

/// The code of an ioctl together with the type the kernel reads and writes.
///
/// The kernel's own encoding holds the size of that type, so a pair that does not belong together
/// does not compile.
struct Request<T> {
    code: Code,
    argument: PhantomData<T>,
}

/// Where the size stands in an ioctl's code, and its mask (`asm-generic/ioctl.h`).
const SIZE_SHIFT: u32 = 16;
const SIZE_MASK: u32 = (1 << 14) - 1;

/// C types that are valid with all bits zero and after any bits the kernel writes.
///
/// # Safety
/// Only integers, arrays, raw pointers and unions of those, in C layout.
unsafe trait Plain: Sized {
    /// All bits zero, as the kernel wants every field that says nothing.
    fn zero() -> Self {
        // SAFETY: the trait promises that zero is valid.
        unsafe { std::mem::zeroed() }
    }
}

/// Declares that a type of `v4l::sys`, or one of ours, is [`Plain`].
macro_rules! plain {
    ($($name:ty),*) => {$(
        // SAFETY: declared in `repr(C)` from the kernel's header, of integers, arrays, raw pointers
        // and unions of those.
        unsafe impl crate::node::Plain for $name {}
    )*};
}
use plain;

impl<T: Plain> Request<T> {
    /// # Panics
    /// At compile time, when `code` does not name a type as large as `T`.
    pub const fn new(code: Code) -> Self {
        assert!((code as u32 >> SIZE_SHIFT) & SIZE_MASK == size_of::<T>() as u32);
        Self {
            code,
            argument: PhantomData,
        }
    }
}

impl Node {
    /// Opens `path` for reading and writing, without waiting, and not for children of this process.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32)
            .open(path)?;
        Ok(Self {
            file,
            path: path.to_owned(),
        })
    }

    /// Where it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Asks the kernel, again when a signal interrupted it.
    ///
    /// # Safety
    /// Every pointer inside `argument` must be null or point to memory that is as long as the
    /// request's fields say, and that nothing else uses meanwhile. A type without pointers is
    /// always safe.
    unsafe fn request<T: Plain>(&self, request: &Request<T>, argument: &mut T) -> io::Result<()> {
        loop {
            let pointer = std::ptr::from_mut(argument).cast();
            // SAFETY: the file is open; the code names a type of T's size, which T is (held by
            // `Request::new`); pointers inside are the caller's promise.
            match unsafe { v4l::v4l2::ioctl(self.file.as_raw_fd(), request.code, pointer) } {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                answer => return answer,
            }
        }
    }
}

impl AsFd for Node {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

/// What a node has for us.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ready {
    /// A picture, or the reason why there will be none.
    pub picture: bool,
    /// An event.
    pub event: bool,
}

/// Waits until one of the nodes has something, `patience` is over, or a signal came.
pub(crate) fn wait(nodes: &[&Node], patience: Duration) -> io::Result<Vec<Ready>> {
    let mut asked: Vec<libc::pollfd> = nodes
        .iter()
        .map(|node| libc::pollfd {
            fd: node.file.as_raw_fd(),
            events: libc::POLLIN | libc::POLLPRI,
            revents: 0,
        })
        .collect();
    // SAFETY: zero is valid for the kernel's C struct of two integers.
    let mut timeout: libc::timespec = unsafe { std::mem::zeroed() };
    timeout.tv_sec = patience.as_secs().try_into().unwrap_or(libc::time_t::MAX);
    timeout.tv_nsec = patience.subsec_nanos() as _;
    // SAFETY: the list has as many elements as its length says; the signal mask is left alone.
    let answer = unsafe {
        libc::ppoll(
            asked.as_mut_ptr(),
            asked.len() as libc::nfds_t,
            &timeout,
            std::ptr::null(),
        )
    };
    if answer < 0 {
        let error = io::Error::last_os_error();
        if error.kind() != io::ErrorKind::Interrupted {
            return Err(error);
        }
        asked.iter_mut().for_each(|asked| asked.revents = 0);
    }
    Ok(asked
        .iter()
        .map(|asked| Ready {
            picture: asked.revents & !libc::POLLPRI != 0,
            event: asked.revents & libc::POLLPRI != 0,
        })
        .collect())
}

/// Text of a fixed field: up to the first zero, whatever bytes a device put there.
fn text(field: &[u8]) -> String {
    let end = field.iter().position(|byte| *byte == 0);
    String::from_utf8_lossy(&field[..end.unwrap_or(field.len())])
        .trim()
        .chars()
        .filter(|c| !c.is_control())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_hostile_devices_become_text() {
        assert_eq!(text(b"Cam\xff\xfera\0garbage"), "Cam\u{fffd}\u{fffd}ra");
        assert_eq!(text(b"\x1b[2J\0"), "[2J");
        assert_eq!(text(b" whole field "), "whole field");
        assert_eq!(text(b""), "");
    }
}
