//! `capture.toml` and `lights.toml`: their keys, and the rules a parser cannot know.

use super::FolderError;
use drivers::admission::MAX_SIDE;
use drivers::{
    Beam, DepthCamera, Distortion, Exposure, FlashLamp, Intrinsics, Rig, RigidTransform, Transfer,
};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{io::Read as _, path::Path};

/// Far more than any capture needs; a larger file is not one.
const MAX_TOML_BYTES: u64 = 1 << 20;
/// How far a typed-in rotation may be from orthonormal before it is taken for a mistake.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// All of `capture.toml`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CaptureToml {
    pub format: u32,
    pub color: ColorTable,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthTable>,
    #[serde(default)]
    pub flash: FlashTable,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ColorTable {
    pub width: usize,
    pub height: usize,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    #[serde(default = "pinhole")]
    pub distortion: Distortion,
    pub transfer: Transfer,
    #[serde(default)]
    pub black_level: f32,
    #[serde(default = "one")]
    pub white_level: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flash_exposure: Option<Exposure>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient_exposure: Option<Exposure>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DepthTable {
    pub width: usize,
    pub height: usize,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    #[serde(default = "pinhole")]
    pub distortion: Distortion,
    #[serde(default = "millimetre")]
    pub depth_unit_metres: f64,
    #[serde(default = "no_rotation")]
    pub rotation: [[f64; 3]; 3],
    #[serde(default)]
    pub translation_metres: [f64; 3],
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_metres: f64,
}

#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FlashTable {
    #[serde(default)]
    pub position_metres: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity: Option<f32>,
    #[serde(default, skip_serializing_if = "is_even")]
    pub beam: Beam,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_even(beam: &Beam) -> bool {
    *beam == Beam::default()
}

/// All of `truth/lights.toml`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightsToml {
    #[serde(default)]
    pub scale: Scale,
    #[serde(default)]
    pub light: Vec<LightTable>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Scale {
    #[default]
    Known,
    Unknown,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightTable {
    pub direction: [f32; 3],
    pub image: String,
    pub shadow: Option<String>,
    pub intensity: Option<[f32; 3]>,
}

fn pinhole() -> Distortion {
    Distortion::None {}
}

fn one() -> f32 {
    1.0
}

/// Millimetres, as nearly every ToF camera writes them.
pub(super) fn millimetre() -> f64 {
    0.001
}

fn no_rotation() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

/// Reads and parses one TOML file.
pub(super) fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, FolderError> {
    let (file, bytes) = super::decode::open_regular(path)?;
    if bytes > MAX_TOML_BYTES {
        return Err(FolderError::Toml {
            path: path.into(),
            problem: format!("is {bytes} bytes, more than the {MAX_TOML_BYTES} allowed"),
        });
    }
    let mut text = String::new();
    file.take(MAX_TOML_BYTES)
        .read_to_string(&mut text)
        .map_err(|source| FolderError::Io {
            path: path.into(),
            source,
        })?;
    ::toml::from_str(&text).map_err(|error| FolderError::Toml {
        path: path.into(),
        problem: error.to_string().trim_end().to_owned(),
    })
}

/// One file's fields being checked.
pub(super) struct Fields<'a>(pub &'a Path);

impl Fields<'_> {
    pub fn wrong(&self, field: &str, problem: impl Into<String>, remedy: &str) -> FolderError {
        FolderError::Field {
            path: self.0.into(),
            field: field.into(),
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    pub fn finite(&self, field: &str, values: &[f64]) -> Result<(), FolderError> {
        match values.iter().find(|value| !value.is_finite()) {
            Some(value) => {
                Err(self.wrong(field, format!("holds {value}"), "give finite numbers there"))
            }
            None => Ok(()),
        }
    }

    pub fn positive(&self, field: &str, value: f64) -> Result<(), FolderError> {
        if value.is_finite() && value > 0.0 {
            Ok(())
        } else {
            Err(self.wrong(
                field,
                format!("is {value}"),
                "give a finite number above zero",
            ))
        }
    }

    fn side(&self, field: &str, pixels: usize) -> Result<(), FolderError> {
        if (1..=MAX_SIDE).contains(&pixels) {
            Ok(())
        } else {
            Err(self.wrong(
                field,
                format!("is {pixels}"),
                "give the image's size in pixels, 1 to 16384",
            ))
        }
    }

    fn exposure(&self, field: &str, exposure: Exposure) -> Result<Exposure, FolderError> {
        self.positive(&format!("{field}.seconds"), f64::from(exposure.seconds))?;
        self.positive(&format!("{field}.gain"), f64::from(exposure.gain))?;
        self.positive(field, f64::from(exposure.factor()))?;
        Ok(exposure)
    }

    fn lens(&self, table: &str, lens: Intrinsics) -> Result<Intrinsics, FolderError> {
        self.side(&format!("{table}.width"), lens.width)?;
        self.side(&format!("{table}.height"), lens.height)?;
        self.positive(&format!("{table}.fx"), lens.fx)?;
        self.positive(&format!("{table}.fy"), lens.fy)?;
        self.finite(&format!("{table}.cx"), &[lens.cx])?;
        self.finite(&format!("{table}.cy"), &[lens.cy])?;
        let field = format!("{table}.distortion");
        self.finite(&field, &lens.distortion.coefficients())?;
        Ok(lens)
    }

    fn transfer(&self, transfer: &Transfer) -> Result<(), FolderError> {
        match transfer {
            Transfer::Gamma(gamma) => self.positive("color.transfer.gamma", f64::from(*gamma)),
            Transfer::Response(curve) => {
                let rises = curve.windows(2).all(|pair| pair[0] <= pair[1]);
                let inside = curve.iter().all(|light| (0.0..=1.0).contains(light));
                if curve.len() == 256 && rises && inside {
                    Ok(())
                } else {
                    Err(self.wrong(
                        "color.transfer.response",
                        "is not a curve",
                        "give 256 non-decreasing numbers in [0, 1], as capturectl calibrate does",
                    ))
                }
            }
            Transfer::Linear | Transfer::Srgb | Transfer::Bt709 => Ok(()),
        }
    }

    fn rotation(&self, rows: [[f64; 3]; 3]) -> Result<DMat3, FolderError> {
        let field = "depth.rotation";
        self.finite(field, rows.as_flattened())?;
        let typed = DMat3::from_cols_array_2d(&rows).transpose();
        let gram = typed * typed.transpose();
        let off = (gram - DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .fold(0.0_f64, |worst, value| worst.max(value.abs()));
        if off > ROTATION_TOLERANCE {
            return Err(self.wrong(
                field,
                format!("is not orthonormal (R Rᵀ differs from the identity by {off:.2e})"),
                "give the rows of a rotation matrix, depth camera to color camera",
            ));
        }
        if typed.determinant() < 0.0 {
            return Err(self.wrong(
                field,
                "is a mirror image (determinant −1)",
                "give a rotation with determinant +1; check the sign of its rows",
            ));
        }
        // The nearest rotation, by Newton's iteration for the polar factor (Higham 1986).
        let mut rotation = typed;
        for _ in 0..8 {
            rotation = (rotation + rotation.inverse().transpose()) * 0.5;
        }
        Ok(rotation)
    }
}

/// What `capture.toml` says, checked.
pub(super) struct Declared {
    pub rig: Rig,
    pub transfer: Transfer,
    pub black_level: f32,
    pub white_level: f32,
    pub flash_exposure: Exposure,
    pub ambient_exposure: Exposure,
    pub depth_unit_metres: f64,
    pub depth_offset_metres: f64,
}

impl Declared {
    /// A stored distance without its offset; none that would lie behind the camera.
    pub fn true_metres(&self, stored: f32) -> f32 {
        let metres = stored - self.depth_offset_metres as f32;
        if metres > 0.0 { metres } else { f32::NAN }
    }
}

impl CaptureToml {
    /// Checks every field and puts the rig together.
    pub fn check(self, path: &Path) -> Result<Declared, FolderError> {
        let fields = Fields(path);
        if self.format != 1 {
            return Err(fields.wrong("format", format!("is {}", self.format), "set format = 1"));
        }
        let color = self.color;
        let lens = fields.lens(
            "color",
            Intrinsics {
                width: color.width,
                height: color.height,
                fx: color.fx,
                fy: color.fy,
                cx: color.cx,
                cy: color.cy,
                distortion: color.distortion,
            },
        )?;
        fields.transfer(&color.transfer)?;
        let (black, white) = (color.black_level, color.white_level);
        if !(0.0..1.0).contains(&black) {
            return Err(fields.wrong(
                "color.black_level",
                format!("is {black}"),
                "give a fraction of full scale, 0 ≤ black_level < 1",
            ));
        }
        if !(white > black && white <= 1.0) {
            return Err(fields.wrong(
                "color.white_level",
                format!("is {white}"),
                "give a fraction of full scale, black_level < white_level ≤ 1",
            ));
        }
        let (flash_exposure, ambient_exposure) =
            match (color.flash_exposure, color.ambient_exposure) {
                (None, None) => (Exposure::UNIT, Exposure::UNIT),
                (Some(flash), ambient) => (
                    fields.exposure("color.flash_exposure", flash)?,
                    fields.exposure("color.ambient_exposure", ambient.unwrap_or(flash))?,
                ),
                (None, Some(_)) => {
                    return Err(fields.wrong(
                        "color.ambient_exposure",
                        "stands without color.flash_exposure",
                        "give both exposures, or neither when they are the same",
                    ));
                }
            };

        let mut depth_unit_metres = millimetre();
        let mut depth_offset_metres = 0.0;
        let depth = match self.depth {
            None => None,
            Some(table) => {
                let lens = fields.lens(
                    "depth",
                    Intrinsics {
                        width: table.width,
                        height: table.height,
                        fx: table.fx,
                        fy: table.fy,
                        cx: table.cx,
                        cy: table.cy,
                        distortion: table.distortion,
                    },
                )?;
                fields.positive("depth.depth_unit_metres", table.depth_unit_metres)?;
                depth_unit_metres = table.depth_unit_metres;
                fields.finite("depth.offset_metres", &[table.offset_metres])?;
                depth_offset_metres = table.offset_metres;
                fields.finite("depth.translation_metres", &table.translation_metres)?;
                let to_color = RigidTransform {
                    rotation: fields.rotation(table.rotation)?,
                    translation_metres: DVec3::from_array(table.translation_metres),
                };
                Some(DepthCamera { lens, to_color })
            }
        };

        fields.finite("flash.position_metres", &self.flash.position_metres)?;
        if let Some(intensity) = self.flash.intensity {
            fields.positive("flash.intensity", f64::from(intensity))?;
        }
        let beam = self.flash.beam;
        if !beam.is_sound() {
            return Err(fields.wrong(
                "flash.beam",
                format!("is {beam:?}"),
                "give numbers between -4 and 4, as capturectl calibrate rig does",
            ));
        }
        let flash = FlashLamp {
            beam,
            position_metres: DVec3::from_array(self.flash.position_metres),
            // The folder states it in the photograph's values; a rig states it at unit exposure.
            intensity: self
                .flash
                .intensity
                .map(|value| value / flash_exposure.factor()),
        };
        Ok(Declared {
            rig: Rig {
                color: lens,
                depth,
                flash,
            },
            transfer: color.transfer,
            black_level: black,
            white_level: white,
            flash_exposure,
            ambient_exposure,
            depth_unit_metres,
            depth_offset_metres,
        })
    }
}
