//! Luxonis' OAK cameras with a ToF sensor, through the vendor's own library.
//!
//! The library is C++ with a Python face; a small process of its own runs it (`bridge.py`), so that what
//! goes wrong in it takes nothing else along. It opens the device, reads the calibration in its EEPROM,
//! and hands frames over through shared memory and their facts through a socket pair.
//!
//! The strobe line is switched by messages that take effect some frames later; a frame is of known light
//! only when no message can have taken effect while it was open ([`crate::trigger`]). Depth frames of
//! that time are left out as well: they could belong to no shot.

mod bridge;
mod discovery;
#[cfg(feature = "rusb")]
mod hotplug;
mod message;
mod options;
#[cfg(test)]
mod tests;
pub(crate) mod transcript;
mod watch;

pub use options::{Options, Strobe, Sync};
pub use watch::Watch;

use crate::{
    admission,
    calibration::Rig,
    clock::{Tracker, monotonic},
    device::{Device, DeviceInfo, DriverError, Settings, Stream},
    frame::{ColorFrame, DepthFrame, Exposure, Frame, Illumination, Pixels, Timestamp, Transfer},
    plane::Plane,
    trigger::{Open, Switched},
};
use bridge::Bridge;
use discovery::Face;
use message::{Asked, Beside, FrameFacts, Order, Ready, Report, Which};
use std::{
    ffi::OsStr,
    path::Path,
    time::{Duration, Instant},
};
use watch::Absence;

/// Where the kernel lists USB devices.
const BUS: &str = "/sys/bus/usb/devices";
/// Longest time from starting the bridge to an open device: loading the library, sending firmware, and
/// two times of leaving the bus and coming back.
const OPENING: Duration = Duration::from_secs(30);
/// Most shared memory taken at its word, bytes.
const MOST_MEMORY: usize = 1 << 30;

/// The devices on this computer: their addresses, models and whether they were booted.
pub fn list() -> Vec<DeviceInfo> {
    discovery::devices(Path::new(BUS))
        .into_iter()
        .map(|present| DeviceInfo {
            address: format!("depthai:{}", present.id),
            driver: "depthai".into(),
            model: match present.face {
                Face::Unbooted => "DepthAI device, not booted".into(),
                Face::Bootloader => "DepthAI device in its bootloader".into(),
                Face::Working => "DepthAI device at work".to_string(),
            },
            finite: false,
        })
        .collect()
}

/// An OAK camera, or a recording of one.
pub struct DepthAi {
    options: Options,
    /// Open and not yet streaming. A session takes it along and ends it: the vendor's pipeline starts
    /// once, and a camera that runs on between sessions would see what nobody asked it to.
    bridge: Option<Bridge>,
    rig: Rig,
    info: DeviceInfo,
    slots: usize,
    slot_bytes: usize,
    /// `None` before somebody asks whether it is there.
    watch: Option<Watch>,
    absence: Absence,
}

impl DepthAi {
    /// Opens the device that `options` name.
    ///
    /// # Errors
    /// [`DriverError::NoDevice`] without such a device, without Python or without the package;
    /// [`DriverError::Malformed`] for a calibration that cannot be; [`DriverError::Timeout`] when the
    /// device does not come up.
    pub fn open(options: Options) -> Result<Self, DriverError> {
        // Before half a minute is spent on a device that is not there.
        if options.replay.is_none() && discovery::devices(Path::new(BUS)).is_empty() {
            return Err(DriverError::NoDevice {
                address: options.address(),
                reason:
                    "no USB device of vendor 03e7 is connected; check cable, power and the udev \
                         rule for it"
                        .into(),
            });
        }
        let python = OsStr::new(&options.python);
        let bridge = Bridge::start(&options.address(), python).map_err(|error| match error {
            DriverError::Io { path, source } => DriverError::NoDevice {
                address: options.address(),
                reason: format!(
                    "{} cannot be run ({source}); install Python 3 with the package depthai, or name it \
                     with python=PATH",
                    path.display()
                ),
            },
            other => other,
        })?;
        Self::through(bridge, options)
    }

    /// Opens a device through a bridge that was started.
    fn through(mut bridge: Bridge, options: Options) -> Result<Self, DriverError> {
        bridge.say(&Order::Open(Asked {
            id: &options.id,
            replay: options.replay.as_deref(),
            width: options.width,
            height: options.height,
            rate: options.rate,
            sync: options.sync.word(),
            strobe: options.strobe.and_then(|line| line.gpio),
        }))?;
        let ready = match bridge.hear(OPENING)? {
            Report::Ready(ready) => *ready,
            Report::Error { kind, message } => {
                return Err(said(&bridge, &options.address(), &kind, message, false));
            }
            Report::Frame(_) => return Err(bridge.nonsense("a frame before it was ready".into())),
        };
        Self::with(bridge, options, ready)
    }

    fn with(bridge: Bridge, options: Options, ready: Ready) -> Result<Self, DriverError> {
        let rig = ready.rig();
        admission::admit_rig(&rig).map_err(|refusal| bridge.nonsense(refusal.to_string()))?;
        let (color, depth) = (rig.color, admission::depth_size(&rig));
        let needed = (3 * color.width * color.height).max(6 * depth.0 * depth.1);
        let total = ready.slots.checked_mul(ready.slot_bytes);
        if ready.slot_bytes < needed
            || total.is_none_or(|total| total > MOST_MEMORY)
            || ready.slots == 0
        {
            return Err(bridge.nonsense(format!(
                "{} slots of {} bytes for frames of {needed}",
                ready.slots, ready.slot_bytes
            )));
        }
        let info = DeviceInfo {
            address: options.address_of(&ready.id),
            driver: "depthai".into(),
            model: format!("{} {}", ready.model, ready.id)
                .trim()
                .chars()
                .take(80)
                .collect(),
            finite: options.replay.is_some(),
        };
        Ok(Self {
            options,
            bridge: Some(bridge),
            rig,
            info,
            slots: ready.slots,
            slot_bytes: ready.slot_bytes,
            watch: None,
            absence: Absence::default(),
        })
    }
}

/// What the bridge's last words mean.
fn said(bridge: &Bridge, device: &str, kind: &str, message: String, running: bool) -> DriverError {
    let message: String = message.chars().take(500).collect();
    match kind {
        "ended" => DriverError::Ended {
            device: device.to_owned(),
        },
        "malformed" => bridge.nonsense(message),
        "setting" => DriverError::Setting {
            device: device.to_owned(),
            setting: "device",
            reason: message,
        },
        _ if running => bridge.gone(&message),
        _ => DriverError::NoDevice {
            address: device.to_owned(),
            reason: message,
        },
    }
}

impl Device for DepthAi {
    fn info(&self) -> DeviceInfo {
        self.info.clone()
    }

    fn rig(&self) -> Rig {
        self.rig
    }

    fn presence(&mut self) -> Result<(), DriverError> {
        if self.options.replay.is_some() {
            return Ok(());
        }
        let now = Instant::now();
        let watch = self.watch.get_or_insert_with(|| Watch::new(Path::new(BUS)));
        let address = &self.info.address;
        let there = watch.serials(now).any(|serial| address.contains(serial));
        match self.absence.is_unplugged(there, now) {
            true => Err(DriverError::Unplugged {
                device: self.info.address.clone(),
            }),
            false => Ok(()),
        }
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        let (exposure_us, iso) = self.options.exposure(settings, &self.info.address)?;
        let mut bridge = match self.bridge.take() {
            Some(bridge) => bridge,
            None => {
                let mut fresh = Self::open(self.options.clone())?;
                let bridge = fresh.bridge.take();
                *self = fresh;
                bridge.ok_or_else(|| DriverError::Unplugged {
                    device: self.info.address.clone(),
                })?
            }
        };
        bridge.say(&Order::Start { exposure_us, iso })?;
        let flash = self.options.strobe.map(|line| {
            let latency =
                Duration::from_secs_f64(f64::from(line.latency_frames) / self.options.rate);
            Switched::new(
                latency,
                (settings.flash_run, settings.flash_every),
                monotonic(),
            )
        });
        Ok(Box::new(Running {
            readout: Duration::from_secs_f64(self.options.readout_ms * 1e-3),
            clocks: [Tracker::new(Duration::ZERO), Tracker::new(Duration::ZERO)],
            last: [None, None],
            settings: settings.clone(),
            device: self,
            bridge,
            flash,
        }))
    }
}

struct Running<'a> {
    device: &'a DepthAi,
    bridge: Bridge,
    settings: Settings,
    /// `None` = there is none, and all light is the room's.
    flash: Option<Switched>,
    readout: Duration,
    /// The device's clock as color frames and as depth frames tell it.
    clocks: [Tracker; 2],
    /// Time and count of the last frame of each camera.
    last: [Option<(Timestamp, u64)>; 2],
}

impl Running<'_> {
    /// Reads a frame out of its slot; `None` for one of no known light, and for one out of order.
    fn take(&mut self, facts: &FrameFacts) -> Result<Option<Frame>, DriverError> {
        let device = self.device;
        let (color, depth) = (device.rig.color, admission::depth_size(&device.rig));
        let expected = match facts.camera {
            Which::Color => 3 * color.width * color.height,
            Which::Depth => 2 * depth.0 * depth.1 * (1 + facts.planes.len()),
        };
        if facts.slot >= device.slots || facts.bytes != expected || expected > device.slot_bytes {
            return Err(self.bridge.nonsense(format!(
                "{:?} frame of {} bytes in slot {}; {expected} expected",
                facts.camera, facts.bytes, facts.slot
            )));
        }
        let mut bytes = vec![0; expected];
        self.bridge
            .copy(facts.slot * device.slot_bytes, &mut bytes)?;
        let camera = facts.camera as usize;
        let stamp = Timestamp::from_nanos(facts.stamp_ns);
        // A jump begins a new relation: the frame that showed it has no time of its own.
        let Ok(at) = self.clocks[camera].note(facts.device_ns, stamp) else {
            return Ok(None);
        };
        if self.last[camera].is_some_and(|(time, count)| at <= time || facts.sequence <= count) {
            return Ok(None);
        }
        self.last[camera] = Some((at, facts.sequence));
        let frame = match facts.camera {
            Which::Color => self.color(facts, at, &bytes)?,
            Which::Depth => self.depth(facts, at, &bytes),
        };
        if let Some(frame) = &frame {
            admission::admit(frame, &self.device.rig)
                .map_err(|refusal| self.bridge.nonsense(refusal.to_string()))?;
        }
        Ok(frame)
    }

    fn color(
        &mut self,
        facts: &FrameFacts,
        at: Timestamp,
        bytes: &[u8],
    ) -> Result<Option<Frame>, DriverError> {
        let stated = facts.exposure;
        let exposure = stated.map(|stated| Exposure {
            seconds: stated.seconds,
            gain: stated.gain,
        });
        let exposure = exposure.ok_or_else(|| {
            self.bridge
                .nonsense("a color frame without exposure".into())
        })?;
        let Some(light) = self.light(Open::new(at, exposure, self.readout))? else {
            return Ok(None);
        };
        let lens = self.device.rig.color;
        let pixels = Plane::from_fn(lens.width, lens.height, |x, y| {
            let at = 3 * (y * lens.width + x);
            [bytes[at], bytes[at + 1], bytes[at + 2]]
        });
        Ok(Some(Frame::Color(ColorFrame {
            at,
            sequence: facts.sequence,
            light,
            exposure,
            pixels: Pixels::Rgb8(pixels),
            transfer: Transfer::Srgb,
            black_level: 0.0,
            white_level: 1.0,
        })))
    }

    /// The light of a color frame; switches the flash where its turn has come.
    fn light(&mut self, open: Open) -> Result<Option<Illumination>, DriverError> {
        let Some(flash) = &mut self.flash else {
            return Ok(Some(Illumination::Ambient));
        };
        let light = flash.light(open);
        if let Some(on) = flash.next_command(light) {
            flash.commanded(on, monotonic());
            self.bridge.say(&Order::Strobe(on))?;
        }
        Ok(light)
    }

    fn depth(&self, facts: &FrameFacts, at: Timestamp, bytes: &[u8]) -> Option<Frame> {
        if let Some(flash) = &self.flash {
            flash.light(Open {
                from: at,
                until: at,
            })?;
        }
        let (width, height) = admission::depth_size(&self.device.rig);
        let plane = |index: usize| {
            let start = 2 * width * height * index;
            Plane::from_fn(width, height, |x, y| {
                let at = start + 2 * (y * width + x);
                u16::from_le_bytes([bytes[at], bytes[at + 1]])
            })
        };
        let beside = |which| facts.planes.iter().position(|beside| *beside == which);
        let confidence = beside(Beside::Confidence).map(|index| plane(1 + index));
        let millimetres = plane(0);
        let metres = Plane::from_fn(width, height, |x, y| {
            let trusted = confidence.as_ref().is_none_or(|plane| plane[(x, y)] > 0);
            match millimetres[(x, y)] {
                0 => f32::NAN,
                value if trusted => f32::from(value) / 1000.0,
                _ => f32::NAN,
            }
        });
        let amplitude =
            beside(Beside::Amplitude).map(|index| plane(1 + index).map(|v| f32::from(*v)));
        Some(Frame::Depth(DepthFrame {
            at,
            sequence: facts.sequence,
            metres,
            amplitude,
            sigma: None,
        }))
    }
}

impl Stream for Running<'_> {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let asked = Instant::now();
        loop {
            let left = patience.saturating_sub(asked.elapsed());
            match self.bridge.hear(left) {
                Ok(Report::Frame(facts)) => {
                    let frame = self.take(&facts)?;
                    self.bridge.say(&Order::Release(facts.slot))?;
                    if let Some(frame) = frame {
                        return Ok(frame);
                    }
                    // Frames of no known light may come for as long as the flash is being switched.
                    if asked.elapsed() >= patience {
                        return Err(DriverError::Timeout {
                            device: self.device.info.address.clone(),
                            patience,
                        });
                    }
                }
                Ok(Report::Error { kind, message }) => {
                    let address = self.device.info.address.clone();
                    return Err(said(&self.bridge, &address, &kind, message, true));
                }
                Ok(Report::Ready(_)) => {
                    return Err(self.bridge.nonsense("ready twice".into()));
                }
                Err(DriverError::Timeout { device, .. }) => {
                    return Err(DriverError::Timeout { device, patience });
                }
                Err(error) => return Err(error),
            }
        }
    }
}
