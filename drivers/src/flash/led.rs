//! An LED of the kernel's LED class: a flash LED by its strobe, any other by a kernel timer or by hand.

use super::{Mode, Plan, during, guard::Darkness, latency, longest};
use crate::{
    device::DriverError,
    lamp::{Lamp, Lit, Moment, Reach},
    node::{opening, refused},
};
use std::{
    fs, io,
    os::fd::AsRawFd,
    path::{Path, PathBuf},
    time::Duration,
};

/// Kernel timers end up to three ticks of a 250 Hz kernel late.
const TICKS: Duration = Duration::from_millis(12);

/// How an LED is lit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// `flash_strobe`, ended by `flash_timeout`.
    Strobe,
    /// The trigger `transient`, ended by a kernel timer.
    Transient,
    /// `brightness`, ended by us.
    Brightness,
}

struct Led {
    folder: PathBuf,
    way: Way,
    plan: Plan,
    brightness: u64,
    longest: Duration,
    /// Its `brightness`, open: zero makes an LED dark in every way of lighting it.
    switch: fs::File,
}

/// Opens `/sys/class/leds/NAME`, or a folder like it, dark, and says how it is kept so.
pub(super) fn open(plan: &Plan) -> Result<(Box<dyn Lamp>, Darkness), DriverError> {
    let node = plan.node.as_deref().unwrap_or(Path::new(""));
    // An absolute path replaces the folder it is joined to.
    let folder = Path::new("/sys/class/leds").join(node);
    let greatest = read(&folder, "max_brightness").map_err(|error| opening(&folder, error))?;
    let flash = folder.join("flash_strobe").exists();
    let wants_full = plan
        .intensity
        .is_none_or(|wanted| wanted as u64 >= greatest);
    let way = if flash && plan.mode == Mode::Strobe {
        Way::Strobe
    } else if wants_full && triggers(&folder).iter().any(|name| name == "transient") {
        Way::Transient
    } else {
        Way::Brightness
    };
    let bound = match way {
        Way::Strobe => {
            let micros = read(&folder, "max_flash_timeout")
                .map_err(|error| refused(&folder, "reading max_flash_timeout", error))?;
            Duration::from_micros(micros)
        }
        _ => Duration::MAX,
    };
    let wanted = plan.intensity.and_then(|wanted| u64::try_from(wanted).ok());
    let path = folder.join("brightness");
    let switch = fs::File::options().write(true).open(&path);
    let switch = switch.map_err(|error| opening(&path, error))?;
    let mut led = Led {
        switch,
        brightness: wanted.unwrap_or(greatest).clamp(1, greatest.max(1)),
        longest: longest(plan).min(bound),
        plan: plan.clone(),
        folder,
        way,
    };
    match way {
        Way::Strobe => {
            if let Some(wanted) = wanted {
                led.write("flash_brightness", &wanted.to_string())?;
            }
        }
        Way::Transient => {
            led.write("trigger", "transient")?;
            led.write("state", "1")?;
        }
        Way::Brightness => led.write("trigger", "none")?,
    }
    led.put_out()?;
    let darkness = Darkness::Written(led.switch.as_raw_fd());
    Ok((Box::new(led), darkness))
}

fn read(folder: &Path, name: &str) -> io::Result<u64> {
    let text = fs::read_to_string(folder.join(name))?;
    text.trim()
        .parse()
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, format!("{name} is {text:?}")))
}

/// Names of the triggers the kernel has; the one in force stands in brackets.
fn triggers(folder: &Path) -> Vec<String> {
    fs::read_to_string(folder.join("trigger"))
        .unwrap_or_default()
        .split_whitespace()
        .map(|name| name.trim_matches(['[', ']']).to_owned())
        .collect()
}

impl Led {
    fn write(&self, name: &'static str, value: &str) -> Result<(), DriverError> {
        let path = self.folder.join(name);
        let write = || {
            let mut file = fs::OpenOptions::new().write(true).open(&path)?;
            io::Write::write_all(&mut file, value.as_bytes())
        };
        write().map_err(|error| match error.kind() {
            io::ErrorKind::PermissionDenied => opening(&path, error),
            _ => refused(&path, "setting an LED", error),
        })
    }

    fn check_faults(&self) -> Result<(), DriverError> {
        if self.way != Way::Strobe {
            return Ok(());
        }
        // A chip without faults has no such file.
        let faults = fs::read_to_string(self.folder.join("flash_fault")).unwrap_or_default();
        let faults: Vec<&str> = faults
            .split_whitespace()
            // What ends every flash here is no fault.
            .filter(|fault| !fault.contains("timeout") && *fault != "0x0")
            .collect();
        if faults.is_empty() {
            return Ok(());
        }
        Err(DriverError::Hardware {
            device: self.folder.display().to_string(),
            problem: format!("flash fault: {}", faults.join(" ")),
            remedy: "let it cool, and check its supply and its LED",
        })
    }

    fn light(&self, flash: Duration) -> Result<(), DriverError> {
        match self.way {
            Way::Strobe => {
                self.write("flash_timeout", &flash.as_micros().to_string())?;
                self.write("flash_strobe", "1")
            }
            Way::Transient => {
                self.write("duration", &flash.as_millis().max(1).to_string())?;
                self.write("activate", "1")
            }
            Way::Brightness => self.write("brightness", &self.brightness.to_string()),
        }
    }
}

impl Lamp for Led {
    fn reach(&self) -> Reach {
        Reach {
            longest: self.longest,
            bounded_by_kernel: self.way != Way::Brightness,
            latency: latency(&self.plan),
        }
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        self.check_faults()?;
        // Whole milliseconds, which is what the kernel's timers take, and up.
        let flash = Duration::from_millis(flash.as_micros().div_ceil(1000) as u64);
        let fired = during(latency(&self.plan), || self.light(flash));
        match fired.and_then(|(from, ())| self.check_faults().map(|()| from)) {
            Ok(from) => Ok(Lit {
                from,
                until: Moment {
                    earliest: from.earliest.after(flash),
                    latest: from.latest.after(flash + TICKS),
                },
            }),
            Err(error) => {
                // The first error is the one to tell.
                drop(self.put_out());
                Err(error)
            }
        }
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        let out = during(latency(&self.plan), || match self.way {
            Way::Strobe => self.write("flash_strobe", "0"),
            Way::Transient => self.write("activate", "0"),
            Way::Brightness => self.write("brightness", "0"),
        })?;
        Ok(out.0)
    }
}

impl Drop for Led {
    fn drop(&mut self) {
        // Nobody is left to hear of a failure; a kernel timer holds where there is one.
        drop(self.put_out());
        if self.way == Way::Transient {
            drop(self.write("trigger", "none"));
        }
    }
}
