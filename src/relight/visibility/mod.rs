//! Cast shadows by line sweep over slabs.
//!
//! Along the image line through the light's vanishing point all points lie in one plane with the
//! light direction, so "what stands between this point and the lamp" is a one-dimensional
//! question per line. Let `v = |P × L|` be the distance of a point P from the axis through the
//! lens along L. Two points of one line are on one ray of light exactly when their `v` agree,
//! and the one further out (away from the antisolar point) is nearer to the lamp. The surface
//! seen at a pixel fills the ray from depth z to z + thickness, hence the interval
//! `|r × L| · [z, z + thickness]`, r = (x/z, y/z, 1). A sweep from the lamp's side keeps the union
//! of the intervals passed so far and compares each point against it: constant work per pixel,
//! unlimited range.
//!
//! A near lamp at S = D·L turns rays into a pencil through S: two points of one line are on one ray of
//! light exactly when the angles agree under which S sees them. In place of `v` stands minus the
//! cotangent of the angle θ at S between the lens and the point, `(r·L − D/z) / |r × L|`, which grows
//! with z as `v` does and, unlike a tangent, is one number for every ray, whether it goes toward
//! the lens or away from it. Lines pass through the image of S; where S is in front of the lens the
//! nearer of two points of a ray is seen nearer to that image, seen or not. As D grows `−D / cotangent`
//! becomes `v`.
//!
//! Line sweeps: Timonen, "Line-Sweep Ambient Obscurance" (2013); horizons: Max (1988). New here:
//! perspective cameras, intervals of finite thickness instead of one horizon, and ends of intervals that fade over all
//! the thicknesses a body may have.

pub mod answers;
pub mod lines;
pub mod map;
pub mod occluders;
pub mod sweep;

pub use answers::Answers;
pub use map::VisibilityMap;
pub use occluders::Occluders;
pub(super) use sweep::STEEPEST_TANGENT;
pub use sweep::{Swept, Thickness, sweep};
