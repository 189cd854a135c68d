//! Frames → [`Shot`]: a flash frame, the ambient frames around it and a depth frame of one moment; or
//! → [`Burst`]: many of each.

mod assembler;
mod drops;
mod evidence;
mod gathering;
mod partial;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod virtual_time_tests;

pub use assembler::{Assembler, Limits};
pub use drops::DropCounts;
pub use gathering::{Burst, Gathering};

use drivers::{ColorFrame, DepthFrame, Plane, Rig};

/// Everything one picture is made from.
#[derive(Debug, Clone)]
pub struct Shot {
    /// The photograph with the flash on.
    pub flash: ColorFrame,
    /// Photographs of the room's light alone: none when `flash` is flash-only already, one, or
    /// the two that bracket the flash in time.
    pub ambient: Vec<ColorFrame>,
    /// Depth, on the depth camera's grid (on the color grid when `rig.depth` is `None`).
    pub depth: DepthFrame,
    /// Geometry.
    pub rig: Rig,
    /// The part of the color image that counts; `None` = all of it.
    pub mask: Option<Plane<bool>>,
}
