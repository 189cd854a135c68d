//! Depth → color grid: undistort, unproject, splat with occlusion, fill by color.
//!
//! [`RigMaps`] holds what depends on the rig alone. [`register`] then cleans the frame
//! (`cleaning`, `holes`), draws its samples as a surface on the distorted color grid (`surface`) and
//! closes the gaps along the edges of the picture (`fill`).

mod cleaning;
mod error;
mod fill;
mod guide;
mod holes;
mod maps;
mod snap;
mod surface;

pub use error::RegistrationError;
pub use maps::RigMaps;

use crate::radiometry::LinearImage;
use drivers::{DepthFrame, Plane};

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

impl RegisteredDepth {
    /// A grid on which nothing is known yet.
    pub fn unknown(width: usize, height: usize) -> Self {
        Self {
            metres: Plane::filled(width, height, f32::NAN),
            sigma_metres: Plane::filled(width, height, f32::NAN),
            measured: Plane::filled(width, height, false),
            amplitude: None,
        }
    }
}

/// Buffers that [`register_into`] keeps between frames.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    cleaned: cleaning::Cleaned,
    surface: surface::Surface,
    fill: fill::Gaps,
    guide: guide::Guide,
    snap: snap::Snap,
}

/// Brings a depth frame onto the color grid of `maps`.
///
/// `guide` is any linear picture on the color grid; where it is given, gaps are closed along its
/// edges.
///
/// # Errors
/// [`RegistrationError::Size`] when a plane of the frame or the guide is not of the rig's size;
/// [`RegistrationError::NoDepth`] when no sample is usable.
pub fn register(
    depth: &DepthFrame,
    maps: &RigMaps,
    guide: Option<&LinearImage>,
) -> Result<RegisteredDepth, RegistrationError> {
    let (width, height) = maps.color_size();
    let mut registered = RegisteredDepth::unknown(width, height);
    register_into(depth, maps, guide, &mut Scratch::default(), &mut registered)?;
    Ok(registered)
}

/// [`register`] into planes that already exist; allocates nothing after the first frame of a size.
///
/// # Errors
/// As [`register`]; `registered` then holds no meaning.
pub fn register_into(
    depth: &DepthFrame,
    maps: &RigMaps,
    guide: Option<&LinearImage>,
    scratch: &mut Scratch,
    registered: &mut RegisteredDepth,
) -> Result<(), RegistrationError> {
    check_sizes(depth, maps, guide)?;
    prepare(registered, maps.color_size(), depth.amplitude.is_some());
    let (width, height) = maps.color_size();
    // Each has a part that only one thread can do.
    rayon::join(
        || scratch.guide.take(guide, width, height),
        || scratch.cleaned.clean(depth, maps.depth.spacing),
    );
    if !scratch.cleaned.any() {
        return Err(RegistrationError::NoDepth);
    }
    let landed = match &maps.depth.rays {
        None => surface::copy(&scratch.cleaned, depth, registered),
        Some(rays) => scratch.surface.draw(
            &scratch.cleaned,
            depth,
            &maps.color,
            &maps.depth,
            rays,
            registered,
        ),
    };
    if !landed {
        return Err(RegistrationError::NoDepth);
    }
    let focal = maps.color.focal_pixels();
    scratch.fill.close(registered, focal, &scratch.guide);
    if maps.depth.rays.is_some() {
        let footprint = focal * maps.depth.spacing;
        scratch
            .snap
            .edges(registered, &scratch.guide, footprint, focal);
    }
    Ok(())
}

fn prepare(registered: &mut RegisteredDepth, (width, height): (usize, usize), amplitude: bool) {
    let size = (width, height);
    if registered.metres.size() != size
        || registered.sigma_metres.size() != size
        || registered.measured.size() != size
    {
        *registered = RegisteredDepth::unknown(width, height);
    }
    if !amplitude {
        registered.amplitude = None;
    } else if registered
        .amplitude
        .as_ref()
        .is_none_or(|plane| plane.size() != size)
    {
        registered.amplitude = Some(Plane::filled(width, height, f32::NAN));
    }
}

fn check_sizes(
    depth: &DepthFrame,
    maps: &RigMaps,
    guide: Option<&LinearImage>,
) -> Result<(), RegistrationError> {
    let check = |field, camera, found: (usize, usize), said: (usize, usize)| {
        if found == said {
            return Ok(());
        }
        Err(RegistrationError::Size {
            field,
            camera,
            found_width: found.0,
            found_height: found.1,
            width: said.0,
            height: said.1,
        })
    };
    let said = maps.depth_size();
    check("depth.metres", "depth", depth.metres.size(), said)?;
    if let Some(amplitude) = &depth.amplitude {
        check("depth.amplitude", "depth", amplitude.size(), said)?;
    }
    if let Some(sigma) = &depth.sigma {
        check("depth.sigma", "depth", sigma.size(), said)?;
    }
    if let Some(LinearImage(guide)) = guide {
        check("guide", "color", guide.size(), maps.color_size())?;
    }
    Ok(())
}
