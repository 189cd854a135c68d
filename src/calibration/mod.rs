//! A rig from pictures of a board: lenses, where the cameras stand, how far distances are off, and the
//! flash.
//!
//! Corners of a ChArUco board are found in the color pictures and in the ToF camera's amplitude (tags say
//! which, saddle points where), each lens is fitted alone (Zhang 2000), then both
//! and all poses of the board together, by Levenberg–Marquardt. The boards' planes then judge the
//! distances, and their white paper the flash.

mod board;
mod corners;
mod flash;
mod homography;
mod least_squares;
mod lenses;
mod range;
mod sampling;
mod tag36h11;
mod tags;

pub use board::Board;
pub use corners::{Corner, find_corners};
pub use flash::FlashFit;
pub use lenses::{FEWEST_VIEWS, LensFit};
pub use range::RangeFit;

use crate::{
    radiometry::{self, SubtractOptions, linearise},
    shot::Shot,
};
use drivers::{DepthCamera, Plane, Rig};
use lenses::Seen;
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;

/// Why a rig cannot be calibrated.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CalibrationError {
    /// A board that cannot be.
    #[error("the board: {problem}; give its squares and sides as they were printed")]
    Board {
        /// What is wrong.
        problem: String,
    },
    /// Pictures that do not suffice.
    #[error("{camera}: {problem}")]
    Views {
        /// Which camera.
        camera: &'static str,
        /// What is missing, and what would do.
        problem: String,
    },
    /// No answer fits the pictures.
    #[error(
        "{camera}: no calibration fits the pictures; check the board's size and that it is flat, and \
         take pictures in which it is sharp"
    )]
    Unsolved {
        /// Which camera.
        camera: &'static str,
    },
    /// Pictures of another rig.
    #[error("view {view}: {problem}; give pictures of one rig")]
    Foreign {
        /// Which, from 1.
        view: usize,
        /// What differs.
        problem: String,
    },
}

/// A rig, and how far to trust it.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// The rig.
    pub rig: Rig,
    /// The color camera.
    pub color: LensFit,
    /// The depth camera; `None` where depth lies on the color grid.
    pub depth: Option<DepthFit>,
    /// The flash; `None` where it could not be told, and then its position is the lens's.
    pub flash: Option<FlashFit>,
    /// What lowers the trust.
    pub warnings: Vec<String>,
}

/// The depth camera.
#[derive(Debug, Clone, Serialize)]
pub struct DepthFit {
    /// Its lens.
    pub lens: LensFit,
    /// Its distances.
    pub range: RangeFit,
    /// Standard error of where it stands, metres.
    pub translation_error_metres: f64,
}

/// Reprojection errors above which a lens is doubted, pixels: of a color picture and of amplitude.
const DOUBTFUL_PIXELS: (f64, f64) = (0.5, 1.0);
/// Share of the picture that corners should cover.
const COVERED: f64 = 0.6;
/// Uncertainty of positions above which they are doubted, metres.
const DOUBTFUL_METRES: f64 = 0.005;

/// Calibrates a rig from shots of the board, each of one pose; `paper_albedo` is that of its white.
///
/// Of the shots' own rig only the sizes of the pictures count.
///
/// # Errors
/// [`CalibrationError`] naming the camera and what is missing.
pub fn calibrate(
    shots: &[Shot],
    board: &Board,
    paper_albedo: f64,
) -> Result<Calibration, CalibrationError> {
    for (place, shot) in shots.iter().enumerate().skip(1) {
        let sizes = |shot: &Shot| (shot.flash.pixels.size(), shot.depth.metres.size());
        if sizes(shot) != sizes(&shots[0]) {
            return Err(CalibrationError::Foreign {
                view: place + 1,
                problem: format!(
                    "sizes {:?}, but the first has {:?}",
                    sizes(shot),
                    sizes(&shots[0])
                ),
            });
        }
    }
    let Some(first) = shots.first() else {
        return Err(CalibrationError::Views {
            camera: "color camera",
            problem: "there are no pictures".to_owned(),
        });
    };
    let size = first.flash.pixels.size();
    let seen: Vec<Seen> = shots.par_iter().map(|shot| in_color(shot, board)).collect();
    let color = lenses::calibrate("color camera", size, board, &seen)?;
    let mut warnings = Vec::new();
    let mut depth_fit = None;
    let mut depth_camera = None;
    let (color, color_fit) = if first.rig.depth.is_some() {
        let amplitude: Vec<Seen> = shots
            .par_iter()
            .map(|shot| match &shot.depth.amplitude {
                Some(amplitude) => find_corners(amplitude, board),
                None => Vec::new(),
            })
            .collect();
        let size = first.depth.metres.size();
        let depth = lenses::calibrate("depth camera", size, board, &amplitude)?;
        let pair = lenses::together(color, depth, board)?;
        let depths: Vec<&Plane<f32>> = shots.iter().map(|shot| &shot.depth.metres).collect();
        let range = range::offset(&pair.depth, board, &depths)?;
        depth_camera = Some(DepthCamera {
            lens: pair.depth.lens,
            to_color: pair.to_color,
        });
        if pair.translation_error_metres > DOUBTFUL_METRES {
            warnings.push(format!(
                "the depth camera's place is known to ±{:.1} mm only; take more poses, nearer and tilted",
                1e3 * pair.translation_error_metres
            ));
        }
        if range.growth.abs() > 0.02 {
            warnings.push(format!(
                "distances are off by {:+.1} % more with distance; is the board as large as was said?",
                100.0 * range.growth
            ));
        }
        doubt(
            &mut warnings,
            "depth camera",
            &pair.depth_fit,
            DOUBTFUL_PIXELS.1,
        );
        depth_fit = Some(DepthFit {
            lens: pair.depth_fit,
            range,
            translation_error_metres: pair.translation_error_metres,
        });
        (pair.color, pair.color_fit)
    } else {
        let fit = color.fit(board);
        (color, fit)
    };
    doubt(&mut warnings, "color camera", &color_fit, DOUBTFUL_PIXELS.0);

    let mut rig = Rig {
        color: color.lens,
        depth: depth_camera,
        flash: first.rig.flash,
    };
    let lights: Result<Vec<_>, _> = shots
        .par_iter()
        .map(|shot| radiometry::subtract(&shot.flash, &shot.ambient, &SubtractOptions::default()))
        .collect();
    let flash = lights
        .map_err(|error| error.to_string())
        .and_then(|lights| {
            let lights: Vec<_> = lights.iter().map(|flash| &flash.light.0).collect();
            flash::fit(&color, board, &lights, paper_albedo).map_err(|error| error.to_string())
        });
    let flash = match flash {
        Ok((lamp, fit)) => {
            rig.flash = lamp;
            if fit.position_error_metres > DOUBTFUL_METRES {
                warnings.push(format!(
                    "the flash's place is known to ±{:.0} mm only; take boards at more distances",
                    1e3 * fit.position_error_metres
                ));
            }
            Some(fit)
        }
        Err(problem) => {
            warnings.push(format!("the flash stays as it was: {problem}"));
            None
        }
    };
    Ok(Calibration {
        rig,
        color: color_fit,
        depth: depth_fit,
        flash,
        warnings,
    })
}

fn doubt(warnings: &mut Vec<String>, camera: &str, fit: &LensFit, limit: f64) {
    if fit.rms_pixels > limit {
        warnings.push(format!(
            "{camera}: the reprojection error is {:.2} pixels; are the pictures sharp and the board flat?",
            fit.rms_pixels
        ));
    }
    if fit.coverage < COVERED {
        warnings.push(format!(
            "{camera}: the boards cover {:.0} % of the picture; show it in the corners too",
            100.0 * fit.coverage
        ));
    }
}

/// Corners in whichever photograph shows more of them: the flash may glare, the room may be dark.
fn in_color(shot: &Shot, board: &Board) -> Seen {
    std::iter::once(&shot.flash)
        .chain(&shot.ambient)
        .filter_map(|frame| linearise(frame).ok())
        .map(|light| find_corners(&light.0.map(|rgb| rgb[0] + rgb[1] + rgb[2]), board))
        .max_by_key(Vec::len)
        .unwrap_or_default()
}
