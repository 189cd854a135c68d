//! Depth → color grid: undistort, unproject, splat with occlusion, fill by color.

use drivers::Plane;

/// Depth on the color camera's grid, in color-camera axes.
#[derive(Debug, Clone)]
pub struct RegisteredDepth {
    /// Distance along the color camera's z in metres; NaN = unknown.
    pub metres: Plane<f32>,
    /// Standard deviation of `metres`, metres; grows with the distance filled over; NaN where
    /// `metres` is NaN.
    pub sigma_metres: Plane<f32>,
    /// True where a depth sample landed; false where the value was filled in or is unknown.
    pub measured: Plane<bool>,
    /// ToF amplitude carried along with the depth; NaN where nothing landed.
    pub amplitude: Option<Plane<f32>>,
}
