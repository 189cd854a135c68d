//! Lenses of both cameras and where they stand to each other, from corners of a board in many poses.

use super::{CalibrationError, board::Board, corners::Corner, homography, least_squares::minimize};
use drivers::{Distortion, Intrinsics, RigidTransform};
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::Serialize;

/// Corners of one picture.
pub(super) type Seen = Vec<Corner>;
/// Parameters of a lens: fx, fy, cx, cy, k1, k2, p1, p2, k3.
const LENS: usize = 9;
/// Parameters of a pose: scaled axis of its rotation, translation.
const POSE: usize = 6;
/// Fewest corners of a picture that count.
pub(super) const FEWEST_CORNERS: usize = 8;
/// Fewest pictures of a camera.
pub const FEWEST_VIEWS: usize = 4;
/// Residuals beyond so many robust standard deviations are mistakes of detection.
const OUTLIER: f64 = 5.0;

/// How well a camera's pictures fit its lens.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LensFit {
    /// Root mean square distance between seen and predicted corners, pixels.
    pub rms_pixels: f64,
    /// The same of each picture; `None` where too few corners were seen.
    pub rms_by_view: Vec<Option<f64>>,
    /// Corners that count.
    pub corners: usize,
    /// Corners that were left out as mistakes.
    pub outliers: usize,
    /// Share of a grid of 8×6 parts of the picture that holds corners.
    pub coverage: f64,
    /// Standard errors of fx, fy, cx and cy, pixels.
    pub errors_pixels: [f64; 4],
}

/// One camera, alone.
#[derive(Debug, Clone)]
pub(super) struct Camera {
    pub lens: Intrinsics,
    /// Pose of the board in each picture.
    pub poses: Vec<Option<RigidTransform>>,
    parameters: [f64; LENS],
    /// Corners without mistakes.
    seen: Vec<Seen>,
    outliers: usize,
    /// Standard errors of the parameters.
    errors: Vec<f64>,
}

fn lens_of(p: &[f64], (width, height): (usize, usize)) -> Intrinsics {
    Intrinsics {
        width,
        height,
        fx: p[0],
        fy: p[1],
        cx: p[2],
        cy: p[3],
        distortion: Distortion::BrownConrady {
            k1: p[4],
            k2: p[5],
            p1: p[6],
            p2: p[7],
            k3: p[8],
        },
    }
}

fn pose_of(p: &[f64]) -> RigidTransform {
    RigidTransform {
        rotation: DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(p[0], p[1], p[2]))),
        translation_metres: DVec3::new(p[3], p[4], p[5]),
    }
}

fn parameters_of(pose: &RigidTransform) -> [f64; POSE] {
    let axis = DQuat::from_mat3(&pose.rotation)
        .normalize()
        .to_scaled_axis();
    let t = pose.translation_metres;
    [axis.x, axis.y, axis.z, t.x, t.y, t.z]
}

/// First `outer`, in whose axes `inner` stands.
fn chain(outer: &RigidTransform, inner: &RigidTransform) -> RigidTransform {
    RigidTransform {
        rotation: outer.rotation * inner.rotation,
        translation_metres: outer.apply(inner.translation_metres),
    }
}

pub(super) fn inverse(pose: &RigidTransform) -> RigidTransform {
    let rotation = pose.rotation.transpose();
    RigidTransform {
        rotation,
        translation_metres: -(rotation * pose.translation_metres),
    }
}

/// Pushes the misses of one picture; a board behind the camera misses by far.
fn misses(
    lens: &Intrinsics,
    pose: &RigidTransform,
    board: &Board,
    seen: &Seen,
    out: &mut Vec<f64>,
) {
    const FAR: f64 = 1e4;
    for corner in seen {
        let miss = lens
            .project(pose.apply(board.corner(corner.id)))
            .map_or(DVec2::splat(FAR), |pixel| pixel - corner.pixel);
        out.extend([miss.x.clamp(-FAR, FAR), miss.y.clamp(-FAR, FAR)]);
    }
}

/// Calibrates one camera.
///
/// # Errors
/// [`CalibrationError::Views`] with too few pictures or corners, or boards that were never tilted;
/// [`CalibrationError::Unsolved`] where no lens fits.
pub(super) fn calibrate(
    camera: &'static str,
    size: (usize, usize),
    board: &Board,
    views: &[Seen],
) -> Result<Camera, CalibrationError> {
    let refuse = |problem: String| Err(CalibrationError::Views { camera, problem });
    let good = |seen: &&Seen| seen.len() >= FEWEST_CORNERS;
    let count = views.iter().filter(good).count();
    if count < FEWEST_VIEWS {
        return refuse(format!(
            "the board is seen well (in {FEWEST_CORNERS} corners or more) in {count} of {} pictures; {FEWEST_VIEWS} are needed",
            views.len()
        ));
    }
    let centre = DVec2::new(size.0 as f64 - 1.0, size.1 as f64 - 1.0) / 2.0;
    let map = |seen: &Seen, change: &dyn Fn(DVec2) -> DVec2| {
        let pair = |corner: &Corner| (board.corner(corner.id).truncate(), change(corner.pixel));
        let pairs: Vec<_> = seen.iter().map(pair).collect();
        homography::homography(&pairs)
    };
    let maps: Vec<DMat3> = views
        .iter()
        .filter(good)
        .filter_map(|seen| map(seen, &|pixel| pixel))
        .collect();
    let wide = size.0.max(size.1) as f64;
    let focal =
        homography::focal_length(&maps, centre).filter(|f| (0.2 * wide..20.0 * wide).contains(f));
    let Some(focal) = focal else {
        return refuse(
            "the board is never tilted enough to tell the focal length; tilt it by 30° to 45° each way"
                .to_owned(),
        );
    };
    let poses: Vec<Option<RigidTransform>> = views
        .iter()
        .map(|seen| {
            let ideal = map(seen, &|pixel| (pixel - centre) / focal);
            let (rotation, translation_metres) = homography::pose(&ideal.filter(|_| good(&seen))?)?;
            Some(RigidTransform {
                rotation,
                translation_metres,
            })
        })
        .collect();
    let mut camera_found = Camera {
        lens: lens_of(
            &[focal, focal, centre.x, centre.y, 0.0, 0.0, 0.0, 0.0, 0.0],
            size,
        ),
        parameters: [focal, focal, centre.x, centre.y, 0.0, 0.0, 0.0, 0.0, 0.0],
        seen: views
            .iter()
            .zip(&poses)
            .map(|(seen, pose)| {
                if pose.is_some() {
                    seen.clone()
                } else {
                    Vec::new()
                }
            })
            .collect(),
        poses,
        outliers: 0,
        errors: Vec::new(),
    };
    // Distortion in steps: all of it at once, from afar, may fold the picture.
    for free in [5, LENS] {
        camera_found.refine(camera, board, size, free)?;
    }
    while camera_found.drop_outliers(board) {
        camera_found.refine(camera, board, size, LENS)?;
    }
    Ok(camera_found)
}

impl Camera {
    /// Fits the first `free` parameters of the lens, and all poses.
    fn refine(
        &mut self,
        camera: &'static str,
        board: &Board,
        size: (usize, usize),
        free: usize,
    ) -> Result<(), CalibrationError> {
        let mut start = self.parameters[..free].to_vec();
        start.extend(self.poses.iter().flatten().flat_map(parameters_of));
        let fixed = self.parameters;
        let seen: Vec<&Seen> = self
            .seen
            .iter()
            .zip(&self.poses)
            .filter(|(_, pose)| pose.is_some())
            .map(|(seen, _)| seen)
            .collect();
        let found = minimize(start, |p| {
            let mut lens = fixed;
            lens[..free].copy_from_slice(&p[..free]);
            let lens = lens_of(&lens, size);
            let mut out = Vec::new();
            for (seen, pose) in seen.iter().zip(p[free..].chunks(POSE)) {
                misses(&lens, &pose_of(pose), board, seen, &mut out);
            }
            out
        });
        let found = found.ok_or(CalibrationError::Unsolved { camera })?;
        self.parameters[..free].copy_from_slice(&found.parameters[..free]);
        self.errors = found.errors;
        self.lens = lens_of(&self.parameters, size);
        let poses = found.parameters[free..].chunks(POSE);
        for (pose, found) in self.poses.iter_mut().flatten().zip(poses) {
            *pose = pose_of(found);
        }
        if !(self.lens.fx > 0.0 && self.lens.fy > 0.0) {
            return Err(CalibrationError::Unsolved { camera });
        }
        Ok(())
    }

    /// Leaves out corners that lie far off; whether there were any.
    fn drop_outliers(&mut self, board: &Board) -> bool {
        let off = |corner: &Corner, pose: &RigidTransform| {
            let pixel = self.lens.project(pose.apply(board.corner(corner.id)));
            pixel.map_or(f64::INFINITY, |pixel| pixel.distance(corner.pixel))
        };
        let pairs = || self.seen.iter().zip(&self.poses);
        let mut all: Vec<f64> = pairs()
            .flat_map(|(seen, pose)| {
                let pose = pose.as_ref();
                seen.iter()
                    .filter_map(move |corner| Some(off(corner, pose?)))
            })
            .collect();
        all.sort_by(f64::total_cmp);
        let Some(median) = all.get(all.len() / 2) else {
            return false;
        };
        // The median length of a two-dimensional normal is 1.18 standard deviations.
        let limit = (OUTLIER * median / 1.18).max(0.02);
        let kept: Vec<Seen> = pairs()
            .map(|(seen, pose)| match pose {
                Some(pose) => seen
                    .iter()
                    .filter(|corner| off(corner, pose) <= limit)
                    .copied()
                    .collect(),
                None => Vec::new(),
            })
            .collect();
        let before: usize = self.seen.iter().map(Vec::len).sum();
        let after: usize = kept.iter().map(Vec::len).sum();
        self.seen = kept;
        for (pose, seen) in self.poses.iter_mut().zip(&mut self.seen) {
            if seen.len() < FEWEST_CORNERS {
                *pose = None;
                seen.clear();
            }
        }
        self.outliers += before - after;
        after < before
    }

    /// How well it fits.
    pub(super) fn fit(&self, board: &Board) -> LensFit {
        let rms = |values: &[f64]| {
            // Two residuals for each corner.
            let count = values.len() as f64 / 2.0;
            (values.iter().map(|v| v * v).sum::<f64>() / count).sqrt()
        };
        let mut all = Vec::new();
        let rms_by_view = self
            .seen
            .iter()
            .zip(&self.poses)
            .map(|(seen, pose)| {
                let mut view = Vec::new();
                misses(&self.lens, pose.as_ref()?, board, seen, &mut view);
                all.extend_from_slice(&view);
                (!view.is_empty()).then(|| rms(&view))
            })
            .collect();
        const PARTS: (usize, usize) = (8, 6);
        let mut parts = [false; PARTS.0 * PARTS.1];
        for corner in self.seen.iter().flatten() {
            let part = |at: f64, side: usize, parts: usize| {
                ((at + 0.5) / side as f64 * parts as f64).clamp(0.0, parts as f64 - 1.0) as usize
            };
            let column = part(corner.pixel.x, self.lens.width, PARTS.0);
            parts[part(corner.pixel.y, self.lens.height, PARTS.1) * PARTS.0 + column] = true;
        }
        LensFit {
            rms_pixels: rms(&all),
            rms_by_view,
            corners: all.len() / 2,
            outliers: self.outliers,
            coverage: parts.iter().filter(|part| **part).count() as f64 / parts.len() as f64,
            errors_pixels: std::array::from_fn(|k| {
                self.errors.get(k).copied().unwrap_or(f64::INFINITY)
            }),
        }
    }
}

/// Both cameras on one rig.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub color: Camera,
    pub depth: Camera,
    /// From the depth camera's axes to the color camera's.
    pub to_color: RigidTransform,
    pub color_fit: LensFit,
    pub depth_fit: LensFit,
    /// Standard error of the translation, metres.
    pub translation_error_metres: f64,
}

/// Fits both lenses, the step between the cameras and all poses at once.
///
/// # Errors
/// [`CalibrationError::Views`] where too few poses were seen by both cameras, or where the pictures do
/// not belong to each other; [`CalibrationError::Unsolved`].
pub(super) fn together(
    mut color: Camera,
    mut depth: Camera,
    board: &Board,
) -> Result<Pair, CalibrationError> {
    let refuse = |problem: String| CalibrationError::Views {
        camera: "pair of cameras",
        problem,
    };
    let steps: Vec<RigidTransform> = color
        .poses
        .iter()
        .zip(&depth.poses)
        .filter_map(|(color, depth)| Some(chain(color.as_ref()?, &inverse(depth.as_ref()?))))
        .collect();
    if steps.len() < 3 {
        return Err(refuse(format!(
            "both cameras see the board well in {} poses; 3 are needed",
            steps.len()
        )));
    }
    // The step that lies nearest to all others: a wrong one lies near none.
    let apart = |a: &RigidTransform, b: &RigidTransform| {
        let turned = DQuat::from_mat3(&(a.rotation.transpose() * b.rotation)).to_scaled_axis();
        turned.length() + a.translation_metres.distance(b.translation_metres)
    };
    let total = |step: &RigidTransform| {
        let mut all: Vec<f64> = steps.iter().map(|other| apart(step, other)).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let start = steps.iter().min_by(|a, b| total(a).total_cmp(&total(b)));
    let step = *start.ok_or_else(|| refuse("no pose is left".to_owned()))?;
    if total(&step) > 0.5 {
        return Err(refuse(
            "the pictures of the two cameras do not show the board in the same poses; hold it still \
             while both are taken"
                .to_owned(),
        ));
    }

    // One pose for each view, in color axes, whichever camera saw it.
    let poses: Vec<Option<RigidTransform>> = color
        .poses
        .iter()
        .zip(&depth.poses)
        .map(|(color, depth)| color.or_else(|| Some(chain(&step, depth.as_ref()?))))
        .collect();
    let places: Vec<usize> = (0..poses.len()).filter(|k| poses[*k].is_some()).collect();
    let mut start = color.parameters.to_vec();
    start.extend(depth.parameters);
    start.extend(parameters_of(&step));
    start.extend(poses.iter().flatten().flat_map(parameters_of));
    let (color_size, depth_size) = (color.lens.size(), depth.lens.size());
    // Each camera's corners count by how well they are seen.
    let certainty = |camera: &Camera| 1.0 / camera.fit(board).rms_pixels.max(1e-3);
    let (color_weight, depth_weight) = (certainty(&color), certainty(&depth));
    let found = minimize(start, |p| {
        let (lenses, poses) = p.split_at(2 * LENS + POSE);
        let color_lens = lens_of(&lenses[..LENS], color_size);
        let depth_lens = lens_of(&lenses[LENS..2 * LENS], depth_size);
        let to_depth = inverse(&pose_of(&lenses[2 * LENS..]));
        let (mut out, mut of_depth) = (Vec::new(), Vec::new());
        for (place, pose) in places.iter().zip(poses.chunks(POSE)) {
            let pose = pose_of(pose);
            misses(&color_lens, &pose, board, &color.seen[*place], &mut out);
            let pose = chain(&to_depth, &pose);
            misses(
                &depth_lens,
                &pose,
                board,
                &depth.seen[*place],
                &mut of_depth,
            );
        }
        for miss in &mut out {
            *miss *= color_weight;
        }
        out.extend(of_depth.iter().map(|miss| miss * depth_weight));
        out
    });
    let found = found.ok_or(CalibrationError::Unsolved {
        camera: "pair of cameras",
    })?;
    let p = &found.parameters;
    color.parameters.copy_from_slice(&p[..LENS]);
    depth.parameters.copy_from_slice(&p[LENS..2 * LENS]);
    color.lens = lens_of(&color.parameters, color_size);
    depth.lens = lens_of(&depth.parameters, depth_size);
    let to_color = pose_of(&p[2 * LENS..2 * LENS + POSE]);
    let to_depth = inverse(&to_color);
    for (place, pose) in places.iter().zip(p[2 * LENS + POSE..].chunks(POSE)) {
        let pose = pose_of(pose);
        color.poses[*place] = Some(pose);
        depth.poses[*place] = Some(chain(&to_depth, &pose));
    }
    let errors = &found.errors;
    color.errors = errors[..LENS].to_vec();
    depth.errors = errors[LENS..2 * LENS].to_vec();
    let moved = &errors[2 * LENS + 3..2 * LENS + POSE];
    Ok(Pair {
        color_fit: color.fit(board),
        depth_fit: depth.fit(board),
        translation_error_metres: moved.iter().map(|e| e * e).sum::<f64>().sqrt(),
        color,
        depth,
        to_color,
    })
}
