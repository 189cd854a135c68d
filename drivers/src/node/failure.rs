//! What the kernel's refusals mean for whoever owns the device.

use crate::device::DriverError;
use rustix::io::Errno;
use std::{io, path::Path};

fn errno(error: &io::Error) -> Option<Errno> {
    Errno::from_io_error(error)
}

/// True for an answer that only a device that has gone gives.
pub(crate) fn is_gone(error: &io::Error) -> bool {
    matches!(
        errno(error),
        Some(Errno::NODEV | Errno::NXIO | Errno::SHUTDOWN)
    )
}

/// Why a node could not be opened, in words.
pub(crate) fn opening(path: &Path, error: io::Error) -> DriverError {
    let refuse = |reason: &str| DriverError::NoDevice {
        address: path.display().to_string(),
        reason: reason.to_owned(),
    };
    match errno(&error) {
        Some(Errno::NOENT) => refuse("there is no such file; plug the device in"),
        Some(Errno::ACCESS | Errno::PERM) => {
            let group = if path.starts_with("/dev/gpiochip0") || gpio(path) {
                "gpio"
            } else {
                "video"
            };
            refuse(&format!(
                "permission denied; join the group that `ls -l` shows for it (`sudo usermod -aG \
                 {group} $USER`, then log in again), or let udev give it to you (TAG+=\"uaccess\")"
            ))
        }
        Some(Errno::BUSY) => refuse(&format!(
            "busy: another program uses it (`fuser -v {}` says which)",
            path.display()
        )),
        _ if is_gone(&error) => DriverError::Unplugged {
            device: path.display().to_string(),
        },
        _ => DriverError::Io {
            path: path.to_owned(),
            source: error,
        },
    }
}

fn gpio(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.to_string_lossy().starts_with("gpiochip"))
}

/// Why an open node refused to do `what`.
pub(crate) fn refused(path: &Path, what: &'static str, error: io::Error) -> DriverError {
    if is_gone(&error) {
        return DriverError::Unplugged {
            device: path.display().to_string(),
        };
    }
    let problem = match errno(&error) {
        Some(Errno::BUSY) => format!(
            "{what}: busy; another program uses it (`fuser -v {}` says which)",
            path.display()
        ),
        Some(Errno::IO) => format!("{what}: the device reports a fatal error (EIO)"),
        Some(Errno::INVAL) => format!("{what}: the device refuses it (EINVAL)"),
        Some(Errno::NOTTY) => format!("{what}: not this kind of device (ENOTTY)"),
        _ => format!("{what}: {error}"),
    };
    DriverError::Hardware {
        device: path.display().to_string(),
        problem,
        remedy: "start again; if it comes back, unplug the device and plug it in",
    }
}
