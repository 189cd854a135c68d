//! What the driver and its bridge say to each other: four bytes of length, little-endian, and JSON.

use crate::calibration::{DepthCamera, Distortion, FlashLamp, Intrinsics, Rig, RigidTransform};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// Longest message taken, bytes; the longest honest one is a rig of under two kilobytes.
pub(super) const LONGEST: usize = 1 << 16;

/// From the driver.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Order<'a> {
    /// Find and open the device.
    Open(Asked<'a>),
    /// Begin to deliver.
    Start {
        exposure_us: Option<u64>,
        iso: Option<u32>,
    },
    /// A slot was read.
    Release(usize),
    /// Fire the strobe line with every frame from now on, or not.
    Strobe(bool),
}

/// Which device, and how.
#[derive(Debug, Serialize)]
pub(super) struct Asked<'a> {
    pub id: &'a str,
    pub replay: Option<&'a str>,
    pub width: usize,
    pub height: usize,
    pub rate: f64,
    pub sync: &'a str,
    pub strobe: Option<u32>,
}

/// From the bridge.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Report {
    /// The device is open; what it is.
    Ready(Box<Ready>),
    /// A frame lies in a slot.
    Frame(FrameFacts),
    /// It ends here.
    Error { kind: String, message: String },
}

/// What the device is, from its EEPROM.
#[derive(Debug, Deserialize)]
pub(super) struct Ready {
    pub model: String,
    pub id: String,
    color: Lens,
    depth: Lens,
    rotation: [[f64; 3]; 3],
    translation_metres: [f64; 3],
    pub slots: usize,
    pub slot_bytes: usize,
}

#[derive(Debug, Deserialize)]
struct Lens {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: Rational,
}

#[derive(Debug, Deserialize)]
struct Rational {
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
    k3: f64,
    k4: f64,
    k5: f64,
    k6: f64,
}

impl Lens {
    fn intrinsics(&self) -> Intrinsics {
        let Rational {
            k1,
            k2,
            p1,
            p2,
            k3,
            k4,
            k5,
            k6,
        } = self.distortion;
        Intrinsics {
            width: self.width,
            height: self.height,
            fx: self.fx,
            fy: self.fy,
            cx: self.cx,
            cy: self.cy,
            distortion: Distortion::Rational {
                k1,
                k2,
                p1,
                p2,
                k3,
                k4,
                k5,
                k6,
            },
        }
    }
}

impl Ready {
    /// The rig as the EEPROM has it. Where the flash sits it does not know: at the lens.
    pub fn rig(&self) -> Rig {
        Rig {
            color: self.color.intrinsics(),
            depth: Some(DepthCamera {
                lens: self.depth.intrinsics(),
                to_color: RigidTransform {
                    rotation: DMat3::from_cols_array_2d(&self.rotation).transpose(),
                    translation_metres: DVec3::from_array(self.translation_metres),
                },
            }),
            flash: FlashLamp {
                position_metres: DVec3::ZERO,
                intensity: None,
                beam: crate::calibration::Beam::default(),
            },
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Which {
    Color,
    Depth,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Beside {
    Amplitude,
    Confidence,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Exposed {
    pub seconds: f32,
    pub gain: f32,
}

/// A frame without its pixels.
#[derive(Debug, Deserialize)]
pub(super) struct FrameFacts {
    pub camera: Which,
    pub slot: usize,
    pub bytes: usize,
    pub sequence: u64,
    /// Start of the exposure by the device's own clock.
    pub device_ns: u64,
    /// The same by ours as the vendor's library tells it, or when the frame came.
    pub stamp_ns: u64,
    /// Of a color frame.
    pub exposure: Option<Exposed>,
    /// What follows the distances of a depth frame.
    #[serde(default)]
    pub planes: Vec<Beside>,
}
