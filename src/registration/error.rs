//! Why depth could not be brought onto the color grid.

use thiserror::Error;

/// A rig or a frame that cannot be registered.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RegistrationError {
    /// A number of the calibration that no camera can have.
    #[error("rig.{field} {problem}; calibrate the rig again or correct the value")]
    Rig {
        /// Path of the field within the rig, e.g. `depth.lens.fx`.
        field: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A picture whose size is not what the rig says.
    #[error(
        "{field} is {found_width}×{found_height} but the rig's {camera} camera is \
         {width}×{height}; use the calibration of the mode the frame was taken in"
    )]
    Size {
        /// The picture: `depth.metres`, `depth.amplitude`, `depth.sigma` or `guide`.
        field: &'static str,
        /// `color` or `depth`.
        camera: &'static str,
        /// Pixels per row in the picture.
        found_width: usize,
        /// Rows in the picture.
        found_height: usize,
        /// Pixels per row in the rig.
        width: usize,
        /// Rows in the rig.
        height: usize,
    },
    /// Not one sample of the frame is a distance the color camera could see.
    #[error(
        "depth.metres holds no usable distance; move within the depth camera's range, \
         uncover its lens or check depth_unit_metres"
    )]
    NoDepth,
}
