//! The camera file: which nodes make up a camera, and what is known of each.

use super::geometry;
use crate::{device::DriverError, flash, frame::Transfer, rig_file::Declared};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// The largest file that is read as a camera file, bytes.
const LARGEST_FILE: u64 = 1 << 20;

/// Where a timestamp of the kernel stands within a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stamp {
    /// As each buffer's flag says.
    #[default]
    Flag,
    /// At the start of the exposure, whatever the flag says.
    Start,
    /// When the picture was whole, whatever the flag says.
    End,
}

/// `[color]`, `[depth]` or `[amplitude]`: one node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraPlan {
    /// A path such as `/dev/video0`, or `card:NAME` or `bus:PLACE`, the first node that has it and
    /// the format.
    pub node: String,
    /// Four characters, such as YUYV; without it the best the node offers.
    pub format: Option<String>,
    /// Pixels per row to ask for; without it, and `height`, what is set.
    pub width: Option<u32>,
    /// Rows to ask for.
    pub height: Option<u32>,
    /// Frame rate to ask for.
    pub frames_per_second: Option<f64>,
    /// Buffers in the kernel, 2 to 32.
    pub buffers: u32,
    /// Where the kernel's timestamps stand.
    pub stamp: Stamp,
    /// Added to every timestamp, seconds in [−1, 1]; as measured for this device.
    pub offset_seconds: f64,
    /// From the start of the first row's exposure to that of the last, seconds in [0, 1]; 0 for a
    /// global shutter.
    pub readout_seconds: f64,
    /// Seconds of one step of the exposure control; without it 100 µs for `exposure_time_absolute`,
    /// and unknown for a sensor that counts lines.
    pub exposure_unit_seconds: Option<f64>,
    /// Linear gain of one step of the gain control; without it gain is locked, but unknown, and
    /// counts as 1.
    pub gain_unit: Option<f64>,
    /// How values relate to light; without it as the kernel says.
    pub transfer: Option<Transfer>,
    /// Value of no light, as a fraction of full scale.
    pub black_level: f32,
    /// Value at which the sensor clips, as a fraction of full scale.
    pub white_level: f32,
    /// Metres of one step of a depth picture.
    pub unit_metres: f64,
    /// Depth nearer than this is no answer, metres.
    pub nearest_metres: f64,
    /// Depth farther than this is no answer, metres.
    pub farthest_metres: f64,
    /// Other controls to set when the stream starts, by the names of `v4l2-ctl -L`.
    pub controls: BTreeMap<String, i64>,
}

impl Default for CameraPlan {
    fn default() -> Self {
        Self {
            node: String::new(),
            format: None,
            width: None,
            height: None,
            frames_per_second: None,
            buffers: 4,
            stamp: Stamp::Flag,
            offset_seconds: 0.0,
            readout_seconds: 0.0,
            exposure_unit_seconds: None,
            gain_unit: None,
            transfer: None,
            black_level: 0.0,
            white_level: 1.0,
            unit_metres: 0.001,
            nearest_metres: 0.0,
            farthest_metres: 1000.0,
            controls: BTreeMap::new(),
        }
    }
}

/// A whole camera file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Plan {
    /// The model, for people.
    pub model: Option<String>,
    /// A rig file, as `capturectl calibrate rig` writes it, relative to this file: its geometry, and
    /// the offset that every distance loses. Without it both cameras count as pinholes of 60° at one
    /// place.
    pub rig: Option<PathBuf>,
    /// The color camera.
    pub color: CameraPlan,
    /// The depth camera; a camera without one takes no shots.
    pub depth: Option<CameraPlan>,
    /// The node on which the depth camera delivers its amplitude (infrared), of the same size; for
    /// cameras that have one.
    pub amplitude: Option<CameraPlan>,
    /// The flash.
    pub flash: flash::Plan,
    /// When no exposure was asked for, look at flash and ambient frames first and choose one at
    /// which neither clips.
    pub metering: bool,
    /// Period of the room's flicker, seconds: 0.01 for mains of 50 Hz, 1/120 for 60 Hz. Metering
    /// chooses whole multiples.
    pub flicker_seconds: Option<f32>,
    /// What `rig` holds.
    #[serde(skip)]
    pub(super) geometry: Option<Declared>,
}

impl Plan {
    /// Reads what stands behind `v4l:`: a node or a camera file, then `?table.key=value&…` on top.
    ///
    /// # Errors
    /// [`DriverError::NoDevice`] for an address that cannot be read, naming key and remedy;
    /// [`DriverError::Io`] for a file that cannot.
    pub fn parse(address: &str) -> Result<Self, DriverError> {
        let refuse = |reason: String| DriverError::NoDevice {
            address: format!("v4l:{address}"),
            reason,
        };
        let (place, options) = address.split_once('?').unwrap_or((address, ""));
        let mut table = toml::Table::new();
        let mut folder = PathBuf::new();
        if place.ends_with(".toml") {
            let path = Path::new(place);
            table = read(path)?.parse().map_err(|error: toml::de::Error| {
                refuse(format!("{place}: {}", error.to_string().trim_end()))
            })?;
            folder = path.parent().unwrap_or(Path::new("")).to_owned();
        } else if !place.is_empty() {
            let color = toml::Table::from_iter([("node".to_owned(), place.into())]);
            table.insert("color".to_owned(), color.into());
        }
        for pair in options.split('&').filter(|pair| !pair.is_empty()) {
            let (key, value) = pair
                .split_once('=')
                .ok_or_else(|| refuse(format!("{pair:?} is no key=value")))?;
            insert(&mut table, key, value).map_err(refuse)?;
        }
        let mut plan: Self = table
            .try_into()
            .map_err(|error: toml::de::Error| refuse(error.to_string().trim_end().to_owned()))?;
        plan.check().map_err(refuse)?;
        if let Some(rig) = &plan.rig {
            let path = folder.join(rig);
            plan.geometry = Some(
                geometry::parse(&read(&path)?)
                    .map_err(|problem| refuse(format!("{}: {problem}", path.display())))?,
            );
        }
        Ok(plan)
    }

    fn check(&self) -> Result<(), String> {
        let cameras = [
            ("color", Some(&self.color)),
            ("depth", self.depth.as_ref()),
            ("amplitude", self.amplitude.as_ref()),
        ];
        for (table, camera) in cameras {
            if let Some(camera) = camera {
                camera
                    .check()
                    .map_err(|problem| format!("{table}.{problem}"))?;
            }
        }
        if self.amplitude.is_some() && self.depth.is_none() {
            return Err("amplitude stands without depth; give depth.node too".into());
        }
        if let Some(seconds) = self.flicker_seconds
            && !(0.001..=1.0).contains(&seconds)
        {
            return Err(format!(
                "flicker_seconds is {seconds}; it must be from 0.001 to 1"
            ));
        }
        self.flash.check()
    }
}

impl CameraPlan {
    fn check(&self) -> Result<(), String> {
        let rule = |kept: bool, key: &str, found: String, allowed: &str| {
            if kept {
                Ok(())
            } else {
                Err(format!("{key} is {found}; it must be {allowed}"))
            }
        };
        let above = |value: Option<f64>| value.is_none_or(|v| v > 0.0 && v.is_finite());
        rule(
            !self.node.is_empty(),
            "node",
            "missing".into(),
            "a path, card:NAME or bus:PLACE",
        )?;
        rule(
            self.format
                .as_ref()
                .is_none_or(|f| f.is_ascii() && (1..=4).contains(&f.len())),
            "format",
            format!("{:?}", self.format),
            "up to four characters, such as YUYV",
        )?;
        rule(
            self.width.is_some() == self.height.is_some(),
            "width",
            format!("{:?} and height {:?}", self.width, self.height),
            "given together with height",
        )?;
        rule(
            (2..=32).contains(&self.buffers),
            "buffers",
            self.buffers.to_string(),
            "from 2 to 32",
        )?;
        rule(
            self.frames_per_second
                .is_none_or(|fps| (0.01..=10_000.0).contains(&fps)),
            "frames_per_second",
            format!("{:?}", self.frames_per_second),
            "from 0.01 to 10000",
        )?;
        rule(
            (-1.0..=1.0).contains(&self.offset_seconds),
            "offset_seconds",
            self.offset_seconds.to_string(),
            "from -1 to 1",
        )?;
        rule(
            (0.0..=1.0).contains(&self.readout_seconds),
            "readout_seconds",
            self.readout_seconds.to_string(),
            "from 0 to 1",
        )?;
        rule(
            above(self.exposure_unit_seconds),
            "exposure_unit_seconds",
            format!("{:?}", self.exposure_unit_seconds),
            "above 0",
        )?;
        rule(
            above(self.gain_unit),
            "gain_unit",
            format!("{:?}", self.gain_unit),
            "above 0",
        )?;
        let levels = 0.0 <= self.black_level
            && self.black_level < self.white_level
            && self.white_level <= 1.0;
        rule(
            levels,
            "black_level",
            format!("{} and white_level {}", self.black_level, self.white_level),
            "such that 0 ≤ black < white ≤ 1",
        )?;
        rule(
            above(Some(self.unit_metres)) && self.unit_metres <= 1.0,
            "unit_metres",
            self.unit_metres.to_string(),
            "above 0 and at most 1",
        )?;
        rule(
            0.0 <= self.nearest_metres && self.nearest_metres < self.farthest_metres,
            "nearest_metres",
            format!(
                "{} and farthest_metres {}",
                self.nearest_metres, self.farthest_metres
            ),
            "at least 0, and below farthest_metres",
        )
    }
}

/// Puts `value` at `a.b` of a table; a value that is no TOML by itself is text.
fn insert(table: &mut toml::Table, key: &str, value: &str) -> Result<(), String> {
    let (group, name) = match key.rsplit_once('.') {
        Some((group, name)) => (Some(group), name),
        None => (None, key),
    };
    let mut place = table;
    for part in group.into_iter().flat_map(|group| group.split('.')) {
        place = place
            .entry(part)
            .or_insert_with(|| toml::Table::new().into())
            .as_table_mut()
            .ok_or_else(|| format!("{key}: {part} is no table"))?;
    }
    let value = format!("value = {value}")
        .parse::<toml::Table>()
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .unwrap_or_else(|| value.into());
    place.insert(name.to_owned(), value);
    Ok(())
}

fn read(path: &Path) -> Result<String, DriverError> {
    let io = |source| DriverError::Io {
        path: path.to_owned(),
        source,
    };
    if std::fs::metadata(path).map_err(io)?.len() > LARGEST_FILE {
        return Err(DriverError::Malformed {
            path: path.to_owned(),
            problem: format!("larger than {LARGEST_FILE} bytes"),
            remedy: "this is no camera or rig file; name another",
        });
    }
    std::fs::read_to_string(path).map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_camera_file_in_short() {
        let plan = Plan::parse(
            "/dev/video0?color.format=YUYV&color.width=640&color.height=480&depth.node=card:ToF&\
             depth.unit_metres=0.00025&flash.kind=control&flash.control=brightness&\
             color.controls.power_line_frequency=1&color.transfer=bt709",
        )
        .unwrap();
        assert_eq!(plan.color.node, "/dev/video0");
        assert_eq!(plan.color.width, Some(640));
        assert_eq!(plan.color.transfer, Some(Transfer::Bt709));
        assert_eq!(plan.color.controls["power_line_frequency"], 1);
        assert_eq!(plan.depth.unwrap().unit_metres, 0.00025);
        assert_eq!(plan.flash.kind, flash::Kind::Control);
    }

    #[test]
    fn what_stands_in_an_address_overrides_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.toml");
        std::fs::write(
            &path,
            "[color]\nnode = \"/dev/video0\"\nformat = \"YUYV\"\n",
        )
        .unwrap();
        let address = format!("{}?color.format=NV12", path.display());
        let plan = Plan::parse(&address).unwrap();
        assert_eq!(plan.color.format.as_deref(), Some("NV12"));
        assert_eq!(plan.color.node, "/dev/video0");
    }

    #[test]
    fn every_shipped_camera_file_is_valid_and_says_what_is_not_known() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/cameras");
        let mut found = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let plan = Plan::parse(path.to_str().unwrap()).unwrap();
            assert!(
                plan.model.is_some() && plan.depth.is_some(),
                "{}",
                path.display()
            );
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains("# Not known"), "{}", path.display());
            found += 1;
        }
        assert!(found >= 4);
    }

    #[test]
    fn mistakes_are_named() {
        struct Case(&'static str, &'static str);
        let cases = [
            Case("", "color.node"),
            Case("/dev/video0?color.fromat=YUYV", "fromat"),
            Case("/dev/video0?color.format=YUYV2", "color.format"),
            Case("/dev/video0?color.width=640", "height"),
            Case("/dev/video0?color.buffers=1", "from 2 to 32"),
            Case("/dev/video0?color.black_level=1", "black"),
            Case("/dev/video0?color.readout_seconds=nan", "readout_seconds"),
            Case(
                "/dev/video0?depth.unit_metres=0&depth.node=x",
                "unit_metres",
            ),
            Case("/dev/video0?depth.unit_metres=1", "depth.node"),
            Case("/dev/video0?amplitude.node=/dev/video1", "depth.node"),
            Case("/dev/video0?color.node.deeper=1", "no table"),
            Case("/dev/video0?color", "no key=value"),
            Case("/dev/video0?flash.kind=sun", "sun"),
            Case("/dev/video0?flash.kind=control", "flash.control"),
            Case("/nowhere/at/all.toml", "/nowhere/at/all.toml"),
        ];
        for Case(address, says) in cases {
            let message = Plan::parse(address).unwrap_err().to_string();
            assert!(message.contains(says), "{address}: {message}");
        }
    }
}
