//! `rig.toml`, which beside the pictures of a shot is `capture.toml`: its keys, and the rules a parser
//! cannot know.

use crate::{
    admission::MAX_SIDE,
    calibration::{Beam, DepthCamera, Distortion, FlashLamp, Intrinsics, Rig, RigidTransform},
    frame::{Exposure, Transfer},
};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How far a typed-in rotation may be from orthonormal before it is taken for a mistake.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A key with a value that cannot be.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{field} {problem}; {remedy}")]
pub struct WrongField {
    /// The key, as `table.key`.
    pub field: String,
    /// What is wrong with it, with the numbers.
    pub problem: String,
    /// What to do.
    pub remedy: String,
}

/// All of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigToml {
    /// 1.
    pub format: u32,
    /// The color camera; its axes are the rig's.
    pub color: ColorTable,
    /// The depth camera; without it depth lies on the color grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthTable>,
    /// The flash.
    #[serde(default)]
    pub flash: FlashTable,
}

// The keys of a lens stand in both tables: what serde flattens out of one struct could not refuse unknown keys.

/// `[color]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorTable {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length across, pixels.
    pub fx: f64,
    /// Focal length down, pixels.
    pub fy: f64,
    /// Principal point, pixels from the centre of the first.
    pub cx: f64,
    /// As `cx`, down.
    pub cy: f64,
    /// Distortion of its lens.
    #[serde(default = "pinhole")]
    pub distortion: Distortion,
    /// How values relate to light.
    pub transfer: Transfer,
    /// Value of no light, as a fraction of full scale.
    #[serde(default)]
    pub black_level: f32,
    /// Value of clipped light, as a fraction of full scale.
    #[serde(default = "one")]
    pub white_level: f32,
    /// What was granted for the flash photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flash_exposure: Option<Exposure>,
    /// What was granted for the ambient one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient_exposure: Option<Exposure>,
}

/// `[depth]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthTable {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length across, pixels.
    pub fx: f64,
    /// Focal length down, pixels.
    pub fy: f64,
    /// Principal point, pixels from the centre of the first.
    pub cx: f64,
    /// As `cx`, down.
    pub cy: f64,
    /// Distortion of its lens.
    #[serde(default = "pinhole")]
    pub distortion: Distortion,
    /// Metres of one step of a PNG picture.
    #[serde(default = "millimetre")]
    pub depth_unit_metres: f64,
    /// Rows of the rotation from depth camera to color camera.
    #[serde(default = "no_rotation")]
    pub rotation: [[f64; 3]; 3],
    /// Where the depth camera sits in the color camera's axes.
    #[serde(default)]
    pub translation_metres: [f64; 3],
    /// To be subtracted from every distance.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_metres: f64,
}

/// `[flash]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlashTable {
    /// Where it sits in the color camera's axes.
    #[serde(default)]
    pub position_metres: [f64; 3],
    /// Value in the flash photograph, flash alone, of a white matte patch that faces it at one metre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity: Option<f32>,
    /// How its light falls off from the middle.
    #[serde(default, skip_serializing_if = "is_even")]
    pub beam: Beam,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_even(beam: &Beam) -> bool {
    *beam == Beam::default()
}

fn pinhole() -> Distortion {
    Distortion::None {}
}

fn one() -> f32 {
    1.0
}

/// Millimetres, as nearly every ToF camera writes them.
pub fn millimetre() -> f64 {
    0.001
}

fn no_rotation() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

fn wrong(field: &str, problem: impl Into<String>, remedy: &str) -> WrongField {
    WrongField {
        field: field.into(),
        problem: problem.into(),
        remedy: remedy.into(),
    }
}

/// Refuses numbers that are none.
///
/// # Errors
/// [`WrongField`] with the number.
pub fn finite(field: &str, values: &[f64]) -> Result<(), WrongField> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(wrong(
            field,
            format!("holds {value}"),
            "give finite numbers there",
        )),
        None => Ok(()),
    }
}

/// Refuses all but finite numbers above zero.
///
/// # Errors
/// [`WrongField`] with the number.
pub fn positive(field: &str, value: f64) -> Result<(), WrongField> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(wrong(
            field,
            format!("is {value}"),
            "give a finite number above zero",
        ))
    }
}

fn side(field: &str, pixels: usize) -> Result<(), WrongField> {
    if (1..=MAX_SIDE).contains(&pixels) {
        Ok(())
    } else {
        Err(wrong(
            field,
            format!("is {pixels}"),
            "give the image's size in pixels, 1 to 16384",
        ))
    }
}

fn exposure(field: &str, exposure: Exposure) -> Result<Exposure, WrongField> {
    positive(&format!("{field}.seconds"), f64::from(exposure.seconds))?;
    positive(&format!("{field}.gain"), f64::from(exposure.gain))?;
    positive(field, f64::from(exposure.factor()))?;
    Ok(exposure)
}

fn sound_lens(table: &str, lens: Intrinsics) -> Result<Intrinsics, WrongField> {
    side(&format!("{table}.width"), lens.width)?;
    side(&format!("{table}.height"), lens.height)?;
    positive(&format!("{table}.fx"), lens.fx)?;
    positive(&format!("{table}.fy"), lens.fy)?;
    finite(&format!("{table}.cx"), &[lens.cx])?;
    finite(&format!("{table}.cy"), &[lens.cy])?;
    let field = format!("{table}.distortion");
    finite(&field, &lens.distortion.coefficients())?;
    Ok(lens)
}

fn transfer(transfer: &Transfer) -> Result<(), WrongField> {
    match transfer {
        Transfer::Gamma(gamma) => positive("color.transfer.gamma", f64::from(*gamma)),
        Transfer::Response(curve) => {
            let rises = curve.windows(2).all(|pair| pair[0] <= pair[1]);
            let inside = curve.iter().all(|light| (0.0..=1.0).contains(light));
            if curve.len() == 256 && rises && inside {
                Ok(())
            } else {
                Err(wrong(
                    "color.transfer.response",
                    "is not a curve",
                    "give 256 non-decreasing numbers in [0, 1], as capturectl calibrate does",
                ))
            }
        }
        Transfer::Linear | Transfer::Srgb | Transfer::Bt709 => Ok(()),
    }
}

fn rotation(rows: [[f64; 3]; 3]) -> Result<DMat3, WrongField> {
    let field = "depth.rotation";
    finite(field, rows.as_flattened())?;
    let typed = DMat3::from_cols_array_2d(&rows).transpose();
    let gram = typed * typed.transpose();
    let off = (gram - DMat3::IDENTITY)
        .to_cols_array()
        .iter()
        .fold(0.0_f64, |worst, value| worst.max(value.abs()));
    if off > ROTATION_TOLERANCE {
        return Err(wrong(
            field,
            format!("is not orthonormal (R Rᵀ differs from the identity by {off:.2e})"),
            "give the rows of a rotation matrix, depth camera to color camera",
        ));
    }
    if typed.determinant() < 0.0 {
        return Err(wrong(
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
/// What the file says, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Declared {
    /// Its geometry and its flash, whose intensity is that at unit exposure.
    pub rig: Rig,
    /// How values of the color camera relate to light.
    pub transfer: Transfer,
    /// Value of no light, as a fraction of full scale.
    pub black_level: f32,
    /// Value at which the color camera clips, as a fraction of full scale.
    pub white_level: f32,
    /// What was granted for the flash photograph.
    pub flash_exposure: Exposure,
    /// What was granted for the ambient one.
    pub ambient_exposure: Exposure,
    /// Metres of one step of a PNG picture of depth.
    pub depth_unit_metres: f64,
    /// To be subtracted from every distance, metres; see [`without_offset`].
    pub depth_offset_metres: f64,
}

/// A distance without what its camera says too much; NaN for one that would lie behind the camera.
pub fn without_offset(metres: f32, offset_metres: f32) -> f32 {
    let metres = metres - offset_metres;
    if metres > 0.0 { metres } else { f32::NAN }
}

impl RigToml {
    /// Checks every field and puts the rig together.
    ///
    /// # Errors
    /// [`WrongField`] for the first field that cannot be.
    pub fn check(self) -> Result<Declared, WrongField> {
        if self.format != 1 {
            return Err(wrong(
                "format",
                format!("is {}", self.format),
                "set format = 1",
            ));
        }
        let color = self.color;
        let lens = sound_lens(
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
        transfer(&color.transfer)?;
        let (black, white) = (color.black_level, color.white_level);
        if !(0.0..1.0).contains(&black) {
            return Err(wrong(
                "color.black_level",
                format!("is {black}"),
                "give a fraction of full scale, 0 ≤ black_level < 1",
            ));
        }
        if !(white > black && white <= 1.0) {
            return Err(wrong(
                "color.white_level",
                format!("is {white}"),
                "give a fraction of full scale, black_level < white_level ≤ 1",
            ));
        }
        let (flash_exposure, ambient_exposure) =
            match (color.flash_exposure, color.ambient_exposure) {
                (None, None) => (Exposure::UNIT, Exposure::UNIT),
                (Some(flash), ambient) => (
                    exposure("color.flash_exposure", flash)?,
                    exposure("color.ambient_exposure", ambient.unwrap_or(flash))?,
                ),
                (None, Some(_)) => {
                    return Err(wrong(
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
                let lens = sound_lens(
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
                positive("depth.depth_unit_metres", table.depth_unit_metres)?;
                depth_unit_metres = table.depth_unit_metres;
                finite("depth.offset_metres", &[table.offset_metres])?;
                depth_offset_metres = table.offset_metres;
                finite("depth.translation_metres", &table.translation_metres)?;
                let to_color = RigidTransform {
                    rotation: rotation(table.rotation)?,
                    translation_metres: DVec3::from_array(table.translation_metres),
                };
                Some(DepthCamera { lens, to_color })
            }
        };

        finite("flash.position_metres", &self.flash.position_metres)?;
        if let Some(intensity) = self.flash.intensity {
            positive("flash.intensity", f64::from(intensity))?;
        }
        let beam = self.flash.beam;
        if !beam.is_sound() {
            return Err(wrong(
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
