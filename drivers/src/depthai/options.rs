//! `depthai:ID?key=value&…`.

use crate::{
    address,
    device::{DriverError, Settings},
};

/// What the pin FSIN/FSYNC does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sync {
    /// Nothing.
    #[default]
    Off,
    /// A pulse from outside starts each exposure.
    Input,
    /// Each exposure gives a pulse to others.
    Output,
}

impl Sync {
    const NAMES: [(&'static str, Self); 3] = [
        ("off", Self::Off),
        ("input", Self::Input),
        ("output", Self::Output),
    ];

    pub(super) fn word(self) -> &'static str {
        let found = Self::NAMES.iter().find(|(_, sync)| *sync == self);
        found.map_or("off", |(name, _)| name)
    }
}

/// A strobe line, and a flash on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Strobe {
    /// The processor's pin; `None` = the sensor's own strobe output.
    pub gpio: Option<u32>,
    /// Longest time from a command to its effect, color frames.
    pub latency_frames: u32,
}

/// Everything that can be chosen about a DepthAI device.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Serial number; empty = the first that is found.
    pub id: String,
    /// Folder of a recording to play instead of a device.
    pub replay: Option<String>,
    /// Color picture, pixels; even.
    pub width: usize,
    /// Color picture, pixels; even.
    pub height: usize,
    /// Frames per second of both cameras.
    pub rate: f64,
    /// What the pin FSIN/FSYNC does.
    pub sync: Sync,
    /// The flash; `None` = there is none.
    pub strobe: Option<Strobe>,
    /// Time from the first row of the color sensor to the last, milliseconds; 0 for a global shutter.
    pub readout_ms: f64,
    /// The Python that has the package depthai.
    pub python: String,
}

const KNOWN: [address::Known; 9] = [
    ("replay", "folder of a recording, none"),
    ("width", "even pixels, 1280"),
    ("height", "even pixels, 800"),
    ("rate", "frames per second, 30"),
    ("sync", "off, input or output; off"),
    ("strobe", "none, sensor or the number of a GPIO; none"),
    (
        "latency",
        "color frames from a strobe command to its effect at most, 6",
    ),
    ("readout", "milliseconds from the first row to the last, 30"),
    ("python", "program, python3"),
];

impl Options {
    /// Reads `ID?key=value&key=value`; all of it may be left out.
    ///
    /// # Errors
    /// A sentence that says what is valid.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (id, rest) = text.split_once('?').unwrap_or((text, ""));
        if id.len() > 64 || !id.chars().all(|c| c.is_ascii_alphanumeric()) {
            return Err(format!("{id:?} is no serial number of a DepthAI device"));
        }
        let mut options = Self {
            id: id.to_owned(),
            replay: None,
            width: 1280,
            height: 800,
            rate: 30.0,
            sync: Sync::Off,
            strobe: None,
            readout_ms: 30.0,
            python: "python3".to_owned(),
        };
        let mut latency_frames = 6;
        for (key, value) in address::pairs(rest, '&', &KNOWN)? {
            match key {
                "replay" => options.replay = Some(value.to_owned()),
                "width" => options.width = even(key, value)?,
                "height" => options.height = even(key, value)?,
                "rate" => options.rate = address::number(key, value, 1.0..=120.0)?,
                "sync" => options.sync = address::choice(key, value, &Sync::NAMES)?,
                "strobe" => options.strobe = strobe(key, value)?,
                "latency" => latency_frames = address::number(key, value, 1..=60)?,
                "readout" => options.readout_ms = address::number(key, value, 0.0..=1000.0)?,
                _ => options.python = value.to_owned(),
            }
        }
        if let Some(strobe) = &mut options.strobe {
            strobe.latency_frames = latency_frames;
        }
        Ok(options)
    }

    /// The address that opens it again.
    pub(super) fn address(&self) -> String {
        self.address_of(&self.id)
    }

    /// The same of the device of this serial number.
    pub(super) fn address_of(&self, id: &str) -> String {
        let id: String = id
            .chars()
            .filter(char::is_ascii_alphanumeric)
            .take(64)
            .collect();
        let mut text = format!(
            "depthai:{id}?width={}&height={}&rate={}&sync={}&readout={}&python={}",
            self.width,
            self.height,
            self.rate,
            self.sync.word(),
            self.readout_ms,
            self.python
        );
        if let Some(Strobe {
            gpio,
            latency_frames,
        }) = self.strobe
        {
            let line = gpio.map_or("sensor".to_owned(), |gpio| gpio.to_string());
            text += &format!("&strobe={line}&latency={latency_frames}");
        }
        if let Some(folder) = &self.replay {
            text += &format!("&replay={folder}");
        }
        text
    }

    /// Microseconds and ISO to ask for.
    pub(super) fn exposure(
        &self,
        settings: &Settings,
        device: &str,
    ) -> Result<(Option<u64>, Option<u32>), DriverError> {
        let refuse = |setting: &'static str, reason: String| DriverError::Setting {
            device: device.to_owned(),
            setting,
            reason,
        };
        if settings.flash_every < 2 {
            let reason = format!(
                "{} leaves no ambient frame; 2 or more",
                settings.flash_every
            );
            return Err(refuse("flash_every", reason));
        }
        settings.check_pattern(device)?;
        let longest = 1.0 / self.rate;
        let seconds = settings.exposure_seconds.map(f64::from);
        if let Some(seconds) = seconds.filter(|s| !(1e-6..=longest).contains(s)) {
            let reason = format!(
                "{seconds} s; from 0.000001 to {longest:.6} at {} frames per second",
                self.rate
            );
            return Err(refuse("exposure_seconds", reason));
        }
        let gain = settings.gain.map(f64::from);
        // The library takes ISO 100 to 1600.
        if let Some(gain) = gain.filter(|gain| !(1.0..=16.0).contains(gain)) {
            return Err(refuse("gain", format!("{gain}; from 1 to 16")));
        }
        // The library sets both or neither.
        let asked = seconds.is_some() || gain.is_some();
        let microseconds = seconds.unwrap_or(0.01_f64.min(longest)) * 1e6;
        let iso = gain.unwrap_or(1.0) * 100.0;
        Ok((
            asked.then_some(microseconds.round() as u64),
            asked.then_some(iso.round() as u32),
        ))
    }
}

fn even(key: &str, value: &str) -> Result<usize, String> {
    let pixels: usize = address::number(key, value, 16..=8192)?;
    if pixels.is_multiple_of(2) {
        Ok(pixels)
    } else {
        Err(format!("{key}={value}: an even number"))
    }
}

fn strobe(key: &str, value: &str) -> Result<Option<Strobe>, String> {
    let gpio = match value {
        "none" => return Ok(None),
        "sensor" => None,
        number => Some(address::number(key, number, 0..=255).map_err(|_| {
            format!("{key}={value}: none, sensor, or the number of a GPIO from 0 to 255")
        })?),
    };
    Ok(Some(Strobe {
        gpio,
        latency_frames: 0,
    }))
}
