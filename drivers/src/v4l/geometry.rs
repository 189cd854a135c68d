//! The rig of a camera file, for the sizes that were granted.

use crate::{
    admission,
    calibration::{DepthCamera, Intrinsics, Rig},
    rig_file::{Declared, RigToml},
};

/// Reads a rig file.
pub(super) fn parse(text: &str) -> Result<Declared, String> {
    let file: RigToml =
        toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
    let declared = file.check().map_err(|wrong| wrong.to_string())?;
    admission::admit_rig(&declared.rig).map_err(|refusal| refusal.to_string())?;
    Ok(declared)
}

/// The rig of cameras that deliver pictures of these sizes.
///
/// A lens measured at another size of the same shape is scaled; without a rig file it is [`Rig::assumed`].
pub(super) fn rig(
    known: Option<&Rig>,
    color: (usize, usize),
    depth: Option<(usize, usize)>,
) -> Result<Rig, String> {
    let Some(known) = known else {
        return Ok(Rig::assumed(color, depth));
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

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../../../config/rig.example.toml");

    #[test]
    fn the_shipped_rig_is_read_and_scaled_to_what_was_granted() {
        let known = parse(SHIPPED).unwrap().rig;
        assert_eq!(known.color.size(), (640, 480));
        let rig = rig(Some(&known), (320, 240), Some((320, 240))).unwrap();
        assert_eq!(rig.color.fx, known.color.fx / 2.0);
        assert_eq!(rig.depth.unwrap().lens, known.depth.unwrap().lens);
        assert_eq!(rig.depth.unwrap().to_color.translation_metres.x, -0.02);
    }

    #[test]
    fn a_rig_of_another_shape_is_refused() {
        let known = parse(SHIPPED).unwrap().rig;
        let refused = rig(Some(&known), (640, 360), None).unwrap_err();
        assert!(refused.contains("640×360"), "{refused}");
        assert!(parse(&SHIPPED.replace("format = 1", "format = 9")).is_err());
        assert!(parse(&SHIPPED.replace("fx = 525.0", "fx = -1.0")).is_err());
    }
}
