//! What a frame or a rig must be to pass the door, checked in one place.
//!
//! Recordings, the contract and the assembler all ask here, so that "well formed" means one thing.

use crate::{
    calibration::{Intrinsics, Rig},
    frame::{ColorFrame, DepthFrame, Exposure, Frame, Pixels, Transfer},
};
use thiserror::Error;

/// Longest side of an image, in pixels.
pub const MAX_SIDE: usize = 16_384;
/// Most pixels of an image.
pub const MAX_PIXELS: usize = 1 << 26;
/// Most bytes of one JPEG picture.
pub const MAX_JPEG_BYTES: usize = 1 << 26;

/// Why something may not pass.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{field}: {problem}")]
pub struct Refusal {
    /// Name of the field, as in the vocabulary.
    pub field: &'static str,
    /// What is wrong with it, with the numbers.
    pub problem: String,
}

fn refuse<T>(field: &'static str, problem: impl Into<String>) -> Result<T, Refusal> {
    Err(Refusal {
        field,
        problem: problem.into(),
    })
}

/// Checks a frame against the rig it claims to come from.
///
/// # Errors
/// [`Refusal`] naming the first field that is not what the vocabulary promises.
pub fn admit(frame: &Frame, rig: &Rig) -> Result<(), Refusal> {
    match frame {
        Frame::Color(frame) => admit_color(frame, rig),
        Frame::Depth(frame) => admit_depth(frame, rig),
    }
}

/// Checks a color frame: size, byte lengths, exposure, levels, transfer curve.
///
/// # Errors
/// As [`admit`].
pub fn admit_color(frame: &ColorFrame, rig: &Rig) -> Result<(), Refusal> {
    let (width, height) = frame.pixels.size();
    if (width, height) != rig.color.size() {
        let (w, h) = rig.color.size();
        return refuse(
            "pixels",
            format!("{width}×{height}, but the rig's color camera is {w}×{h}"),
        );
    }
    admit_exposure(frame.exposure)?;
    let (black, white) = (frame.black_level, frame.white_level);
    if !(black >= 0.0 && black < white && white <= 1.0) {
        return refuse(
            "black_level",
            format!("levels {black}..{white}; need 0 ≤ black < white ≤ 1"),
        );
    }
    admit_transfer(&frame.transfer)?;
    let bytes_of = |name: &'static str, found: usize, needed: usize, even: bool| {
        if !even {
            return refuse(
                "pixels",
                format!("{name} needs even sizes, not {width}×{height}"),
            );
        }
        if found != needed {
            return refuse(
                "pixels",
                format!("{name} {width}×{height} has {found} bytes, not {needed}"),
            );
        }
        Ok(())
    };
    match &frame.pixels {
        Pixels::Yuyv { bytes, .. } => {
            bytes_of("yuyv", bytes.len(), 2 * width * height, width % 2 == 0)
        }
        Pixels::Nv12 { bytes, .. } => bytes_of(
            "nv12",
            bytes.len(),
            width * height * 3 / 2,
            width % 2 == 0 && height % 2 == 0,
        ),
        Pixels::Mjpg { bytes, .. } if !bytes.starts_with(&[0xff, 0xd8]) => refuse(
            "pixels",
            "mjpg does not begin with a JPEG start-of-image marker",
        ),
        Pixels::Mjpg { bytes, .. } if bytes.len() > MAX_JPEG_BYTES => refuse(
            "pixels",
            format!("mjpg has {} bytes, limit {MAX_JPEG_BYTES}", bytes.len()),
        ),
        Pixels::RgbF32(plane) if plane.samples().iter().flatten().any(|v| v.is_infinite()) => {
            refuse("pixels", "an infinite sample; unknown is NaN")
        }
        _ => Ok(()),
    }
}

/// Checks a depth frame: sizes and the ranges of its planes.
///
/// # Errors
/// As [`admit`].
pub fn admit_depth(frame: &DepthFrame, rig: &Rig) -> Result<(), Refusal> {
    let size = depth_size(rig);
    let planes = [
        ("metres", Some(&frame.metres)),
        ("amplitude", frame.amplitude.as_ref()),
        ("sigma", frame.sigma.as_ref()),
    ];
    for (field, plane) in planes {
        let Some(plane) = plane else { continue };
        if plane.size() != size {
            let (w, h) = plane.size();
            return refuse(
                field,
                format!("{w}×{h}, but the rig's depth is {}×{}", size.0, size.1),
            );
        }
        let positive = field == "metres";
        let wrong = plane
            .samples()
            .iter()
            .find(|v| v.is_infinite() || **v < 0.0 || (positive && **v == 0.0));
        if let Some(value) = wrong {
            return refuse(field, format!("holds {value}; unknown is NaN"));
        }
    }
    Ok(())
}

/// `(width, height)` of the grid depth frames lie on.
pub fn depth_size(rig: &Rig) -> (usize, usize) {
    rig.depth
        .map_or(rig.color.size(), |camera| camera.lens.size())
}

fn admit_exposure(exposure: Exposure) -> Result<(), Refusal> {
    let Exposure { seconds, gain } = exposure;
    let good = |value: f32| value.is_finite() && value > 0.0;
    if !(good(seconds) && good(gain) && good(exposure.factor())) {
        return refuse(
            "exposure",
            format!("{seconds} s at gain {gain}; both must be above 0"),
        );
    }
    Ok(())
}

fn admit_transfer(transfer: &Transfer) -> Result<(), Refusal> {
    match transfer {
        Transfer::Gamma(gamma) if !(gamma.is_finite() && *gamma > 0.0) => {
            refuse("transfer", format!("gamma {gamma} must be above 0"))
        }
        Transfer::Response(light) => {
            let ordered = light.windows(2).all(|pair| pair[0] <= pair[1]);
            let inside = light.iter().all(|value| (0.0..=1.0).contains(value));
            if light.len() == 256 && ordered && inside {
                Ok(())
            } else {
                refuse(
                    "transfer",
                    "a response is 256 non-decreasing values in [0, 1]",
                )
            }
        }
        _ => Ok(()),
    }
}

/// Checks a rig: image sizes, focal lengths, rotation, flash.
///
/// # Errors
/// As [`admit`].
pub fn admit_rig(rig: &Rig) -> Result<(), Refusal> {
    admit_lens("rig.color", &rig.color)?;
    if let Some(depth) = &rig.depth {
        admit_lens("rig.depth.lens", &depth.lens)?;
        let rotation = depth.to_color.rotation;
        let error = rotation * rotation.transpose() - glam::DMat3::IDENTITY;
        let worst = error
            .to_cols_array()
            .into_iter()
            .fold(0.0, |a: f64, v| a.max(v.abs()));
        // Written so that NaN fails too. 1e-3 is what calibration files rounded to four digits reach.
        if !(worst < 1e-3 && rotation.determinant() > 0.0) {
            return refuse(
                "rig.depth.to_color.rotation",
                format!("not a rotation (off by {worst})"),
            );
        }
        if !depth.to_color.translation_metres.is_finite() {
            return refuse("rig.depth.to_color.translation_metres", "not finite");
        }
    }
    if !rig.flash.position_metres.is_finite() {
        return refuse("rig.flash.position_metres", "not finite");
    }
    let beam = rig.flash.beam;
    if !beam.is_sound() {
        return refuse(
            "rig.flash.beam",
            format!("{beam:?}; each number lies between -4 and 4"),
        );
    }
    match rig.flash.intensity {
        Some(value) if !(value.is_finite() && value > 0.0) => {
            refuse("rig.flash.intensity", format!("{value} must be above 0"))
        }
        _ => Ok(()),
    }
}

fn admit_lens(field: &'static str, lens: &Intrinsics) -> Result<(), Refusal> {
    let (width, height) = lens.size();
    let inside = (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height);
    if !inside || width * height > MAX_PIXELS {
        return refuse(
            field,
            format!("{width}×{height}; sides are 1 to {MAX_SIDE}, at most {MAX_PIXELS} pixels"),
        );
    }
    let good = |value: f64| value.is_finite() && value > 0.0;
    if !(good(lens.fx) && good(lens.fy) && lens.cx.is_finite() && lens.cy.is_finite()) {
        return refuse(field, "focal lengths must be above 0 and the centre finite");
    }
    let bent = lens.distortion.coefficients();
    if bent.iter().any(|value| !value.is_finite()) {
        return refuse(field, "a distortion coefficient is not finite");
    }
    Ok(())
}
