//! The geometry in a rig file, whose other keys belong to photographs.

use crate::{
    admission,
    calibration::{Beam, DepthCamera, Distortion, FlashLamp, Intrinsics, Rig, RigidTransform},
};
use glam::{DMat3, DVec3};
use serde::Deserialize;

/// The keys of `config/rig.example.toml` that say where things are.
#[derive(Deserialize)]
struct File {
    format: u32,
    color: Lens,
    depth: Option<Lens>,
    #[serde(default)]
    flash: Flash,
}

#[derive(Deserialize)]
struct Lens {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: Option<Distortion>,
    rotation: Option<[[f64; 3]; 3]>,
    #[serde(default)]
    translation_metres: [f64; 3],
}

#[derive(Default, Deserialize)]
struct Flash {
    #[serde(default)]
    position_metres: [f64; 3],
    intensity: Option<f32>,
    #[serde(default)]
    beam: Beam,
}

impl Lens {
    fn intrinsics(&self) -> Intrinsics {
        Intrinsics {
            width: self.width,
            height: self.height,
            fx: self.fx,
            fy: self.fy,
            cx: self.cx,
            cy: self.cy,
            distortion: self.distortion.unwrap_or(Distortion::None {}),
        }
    }
}

/// Reads a rig file.
pub(super) fn parse(text: &str) -> Result<Rig, String> {
    let file: File =
        toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
    if file.format != 1 {
        return Err(format!("format is {}; this program reads 1", file.format));
    }
    let rig = Rig {
        color: file.color.intrinsics(),
        depth: file.depth.map(|depth| DepthCamera {
            lens: depth.intrinsics(),
            to_color: RigidTransform {
                // Written row by row.
                rotation: depth.rotation.map_or(DMat3::IDENTITY, |rows| {
                    DMat3::from_cols_array_2d(&rows).transpose()
                }),
                translation_metres: DVec3::from_array(depth.translation_metres),
            },
        }),
        flash: FlashLamp {
            position_metres: DVec3::from_array(file.flash.position_metres),
            intensity: file.flash.intensity,
            beam: file.flash.beam,
        },
    };
    admission::admit_rig(&rig).map_err(|refusal| refusal.to_string())?;
    Ok(rig)
}

/// The rig of cameras that deliver pictures of these sizes.
///
/// A lens measured at another size of the same shape is scaled; without a rig file every camera is a
/// pinhole 60° wide at one place, with the flash at the lens.
pub(super) fn rig(
    known: Option<&Rig>,
    color: (usize, usize),
    depth: Option<(usize, usize)>,
) -> Result<Rig, String> {
    let Some(known) = known else {
        return Ok(Rig {
            color: pinhole(color),
            depth: depth.map(|size| DepthCamera {
                lens: pinhole(size),
                to_color: RigidTransform::IDENTITY,
            }),
            flash: FlashLamp {
                position_metres: DVec3::ZERO,
                intensity: None,
                beam: Beam::default(),
            },
        });
    };
    let fit = |camera: &str, lens: &Intrinsics, (width, height): (usize, usize)| {
        // A crop has another shape or another field of view; only the first can be told here.
        let same_shape = lens.width * height == lens.height * width;
        if same_shape {
            Ok(lens.scaled_to(width, height))
        } else {
            Err(format!(
                "the rig's {camera} camera is {}×{}, but {width}×{height} was granted; ask for a \
                 size of the same shape or calibrate this one",
                lens.width, lens.height
            ))
        }
    };
    Ok(Rig {
        color: fit("color", &known.color, color)?,
        depth: match (known.depth, depth) {
            (Some(camera), Some(size)) => Some(DepthCamera {
                lens: fit("depth", &camera.lens, size)?,
                ..camera
            }),
            (None, Some(size)) if size == color => None,
            (None, Some(_)) => return Err("the rig has no depth camera".into()),
            (_, None) => None,
        },
        flash: known.flash,
    })
}

fn pinhole((width, height): (usize, usize)) -> Intrinsics {
    let focal = width as f64 / 2.0 / 30f64.to_radians().tan();
    Intrinsics {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: (width as f64 - 1.0) / 2.0,
        cy: (height as f64 - 1.0) / 2.0,
        distortion: Distortion::None {},
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../../../config/rig.example.toml");

    #[test]
    fn the_shipped_rig_is_read_and_scaled_to_what_was_granted() {
        let known = parse(SHIPPED).unwrap();
        assert_eq!(known.color.size(), (640, 480));
        let rig = rig(Some(&known), (320, 240), Some((320, 240))).unwrap();
        assert_eq!(rig.color.fx, known.color.fx / 2.0);
        assert_eq!(rig.depth.unwrap().lens, known.depth.unwrap().lens);
        assert_eq!(rig.depth.unwrap().to_color.translation_metres.x, -0.02);
    }

    #[test]
    fn a_rig_of_another_shape_is_refused() {
        let known = parse(SHIPPED).unwrap();
        let refused = rig(Some(&known), (640, 360), None).unwrap_err();
        assert!(refused.contains("640×360"), "{refused}");
        assert!(parse(&SHIPPED.replace("format = 1", "format = 9")).is_err());
        assert!(parse(&SHIPPED.replace("fx = 525.0", "fx = -1.0")).is_err());
    }
}
