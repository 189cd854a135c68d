//! Everything registration needs that depends on the rig alone, computed once.

use super::RegistrationError;
use drivers::{Distortion, Intrinsics, Rig, RigidTransform};
use glam::{DMat3, DVec2};
use rayon::prelude::*;

/// Longest side and most pixels of a camera that is believed.
const MOST_PIXELS_PER_SIDE: usize = 1 << 15;
const MOST_PIXELS: usize = 1 << 27;

/// Prepared geometry of one rig.
#[derive(Debug, Clone)]
pub struct RigMaps {
    pub(super) color: ColorGrid,
    pub(super) depth: DepthGrid,
}

/// The color lens in single precision: where a point in color axes lands on the delivered picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct ColorGrid {
    pub width: usize,
    pub height: usize,
    focal: [f32; 2],
    centre: [f32; 2],
    /// `[k1, k2, p1, p2, k3, k4, k5, k6]`.
    bend: [f32; 8],
    /// Squared ideal radius (x²+y² at z = 1) up to which the lens model is one-to-one.
    radius2_limit: f32,
}

impl ColorGrid {
    /// Pixel of (x, y, z) in color axes, and 1/z; NaN behind the camera or outside the lens model.
    #[inline(always)]
    pub fn project(&self, x: f32, y: f32, z: f32) -> [f32; 3] {
        let inverse = 1.0 / z;
        let (x, y) = (x * inverse, y * inverse);
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.bend;
        let r2 = x * x + y * y;
        let radial =
            (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        let seen = z > 0.0 && r2 <= self.radius2_limit;
        [
            if seen {
                self.focal[0] * bent_x + self.centre[0]
            } else {
                f32::NAN
            },
            if seen {
                self.focal[1] * bent_y + self.centre[1]
            } else {
                f32::NAN
            },
            if seen { inverse } else { f32::NAN },
        ]
    }

    /// Mean focal length, pixels.
    pub fn focal_pixels(&self) -> f32 {
        0.5 * (self.focal[0] + self.focal[1])
    }
}

/// The depth camera's samples as rays in color axes.
#[derive(Debug, Clone)]
pub(super) struct DepthGrid {
    pub width: usize,
    pub height: usize,
    /// Distance between neighbouring samples at one metre, metres (1 / focal length).
    pub spacing: f32,
    /// `None` = the samples already lie on the color grid, in color axes.
    pub rays: Option<Rays>,
}

/// `point = metres · ray + origin`, color axes.
#[derive(Debug, Clone)]
pub(super) struct Rays {
    /// `R · (x/z, y/z, 1)` per sample, one vector per axis; NaN outside the useful circle.
    pub axes: [Vec<f32>; 3],
    /// The depth camera's centre in color axes, metres.
    pub origin: [f32; 3],
    /// Color pixels per depth sample at equal distance.
    pub magnification: f32,
}

impl RigMaps {
    /// Prepares a rig; takes a fraction of a second, once per session.
    ///
    /// # Errors
    /// [`RegistrationError::Rig`] for an empty or absurd grid, a focal length that is not
    /// positive, a number that is not finite, or a rotation that is not one.
    pub fn new(rig: &Rig) -> Result<Self, RegistrationError> {
        check_lens("color", &rig.color)?;
        let lens = rig.color;
        let color = ColorGrid {
            width: lens.width,
            height: lens.height,
            focal: [lens.fx as f32, lens.fy as f32],
            centre: [lens.cx as f32, lens.cy as f32],
            bend: lens.distortion.coefficients().map(|k| k as f32),
            radius2_limit: radius2_limit(&lens.distortion) as f32,
        };
        let spacing_of = |lens: &Intrinsics| (2.0 / (lens.fx + lens.fy)) as f32;
        let on_color_grid = DepthGrid {
            width: lens.width,
            height: lens.height,
            spacing: spacing_of(&lens),
            rays: None,
        };
        let Some(camera) = &rig.depth else {
            return Ok(Self {
                color,
                depth: on_color_grid,
            });
        };
        check_lens("depth.lens", &camera.lens)?;
        check_transform(&camera.to_color)?;
        if camera.lens == lens && camera.to_color == RigidTransform::IDENTITY {
            return Ok(Self {
                color,
                depth: on_color_grid,
            });
        }
        let depth = DepthGrid {
            width: camera.lens.width,
            height: camera.lens.height,
            spacing: spacing_of(&camera.lens),
            rays: Some(Rays {
                axes: rotated_rays(&camera.lens, camera.to_color.rotation),
                origin: camera.to_color.translation_metres.as_vec3().to_array(),
                magnification: ((lens.fx + lens.fy) / (camera.lens.fx + camera.lens.fy)) as f32,
            }),
        };
        Ok(Self { color, depth })
    }

    /// `(width, height)` of the color grid, the grid of every result.
    pub fn color_size(&self) -> (usize, usize) {
        (self.color.width, self.color.height)
    }

    /// `(width, height)` a depth frame must have.
    pub fn depth_size(&self) -> (usize, usize) {
        (self.depth.width, self.depth.height)
    }
}

/// Rays through all pixel centres, turned by `rotation`; NaN where the lens model has no inverse.
fn rotated_rays(lens: &Intrinsics, rotation: DMat3) -> [Vec<f32>; 3] {
    let limit = radius2_limit(&lens.distortion);
    let width = lens.width;
    let mut axes = [0; 3].map(|_| vec![f32::NAN; width * lens.height]);
    let [xs, ys, zs] = &mut axes;
    (
        xs.par_chunks_mut(width),
        ys.par_chunks_mut(width),
        zs.par_chunks_mut(width),
    )
        .into_par_iter()
        .enumerate()
        .for_each(|(y, (xs, ys, zs))| {
            for (x, ((to_x, to_y), to_z)) in xs.iter_mut().zip(ys).zip(zs).enumerate() {
                // Newton can land beyond the fold of the model, where a second ray shares the pixel.
                let ray = lens
                    .ray(DVec2::new(x as f64, y as f64))
                    .filter(|ray| ray.truncate().length_squared() <= limit);
                if let Some(ray) = ray {
                    let turned = (rotation * ray).as_vec3();
                    (*to_x, *to_y, *to_z) = (turned.x, turned.y, turned.z);
                }
            }
        });
    axes
}

/// Squared ideal radius where the radial model first stops growing: beyond it two rays share one
/// pixel. Ends at 87° off the axis for a lens that never folds.
fn radius2_limit(distortion: &Distortion) -> f64 {
    const STEP: f64 = 1e-3;
    const FARTHEST: f64 = 20.0;
    let [k1, k2, _, _, k3, k4, k5, k6] = distortion.coefficients();
    let bent = |r: f64| {
        let r2 = r * r;
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        if below <= 1e-6 {
            return f64::NAN;
        }
        r * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
    };
    let mut previous = 0.0;
    let mut radius = 0.0;
    while radius < FARTHEST {
        let next = bent(radius + STEP);
        if next.is_nan() || next <= previous {
            break;
        }
        previous = next;
        radius += STEP;
    }
    radius * radius
}

fn check_lens(camera: &str, lens: &Intrinsics) -> Result<(), RegistrationError> {
    let wrong = |field: &str, problem: String| {
        Err(RegistrationError::Rig {
            field: format!("{camera}.{field}"),
            problem,
        })
    };
    let (width, height) = lens.size();
    for (field, side) in [("width", width), ("height", height)] {
        if side == 0 || side > MOST_PIXELS_PER_SIDE {
            return wrong(
                field,
                format!("is {side}, not within 1..={MOST_PIXELS_PER_SIDE}"),
            );
        }
    }
    if width * height > MOST_PIXELS {
        return wrong(
            "width",
            format!("× height is {}, over {MOST_PIXELS}", width * height),
        );
    }
    for (field, focal) in [("fx", lens.fx), ("fy", lens.fy)] {
        if !(focal.is_finite() && focal > 0.0) {
            return wrong(
                field,
                format!("is {focal}, not a positive number of pixels"),
            );
        }
    }
    for (field, centre) in [("cx", lens.cx), ("cy", lens.cy)] {
        if !centre.is_finite() {
            return wrong(field, format!("is {centre}, not a finite number of pixels"));
        }
    }
    if lens
        .distortion
        .coefficients()
        .iter()
        .any(|k| !k.is_finite())
    {
        return wrong(
            "distortion",
            "holds a coefficient that is not finite".into(),
        );
    }
    Ok(())
}

fn check_transform(to_color: &RigidTransform) -> Result<(), RegistrationError> {
    let wrong = |field: &str, problem: &str| {
        Err(RegistrationError::Rig {
            field: format!("depth.to_color.{field}"),
            problem: problem.into(),
        })
    };
    let rotation = to_color.rotation;
    let excess = rotation * rotation.transpose() - DMat3::IDENTITY;
    let orthonormal = excess.to_cols_array().iter().all(|e| e.abs() < 1e-3);
    // NaN makes both comparisons false.
    let keeps_hands = rotation.determinant() > 0.0;
    if !orthonormal || !keeps_hands {
        return wrong(
            "rotation",
            "is not a rotation (orthonormal, determinant +1)",
        );
    }
    if !to_color.translation_metres.is_finite() {
        return wrong("translation_metres", "is not finite");
    }
    Ok(())
}
