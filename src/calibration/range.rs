//! How far a ToF camera's distances are off, from boards whose plane is known.

use super::{CalibrationError, board::Board, lenses::Camera};
use drivers::Plane;
use glam::{DVec2, DVec3};
use serde::Serialize;

/// How far distances are off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RangeFit {
    /// To be subtracted from every distance, metres: the median over the boards.
    pub offset_metres: f64,
    /// Half of the boards lie within this distance of it, metres.
    pub scatter_metres: f64,
    /// By how much the offset grows with distance, metres per metre; what is far from 0 tells of a
    /// wrong size of the board or of a wrong modulation frequency.
    pub growth: f64,
    /// Boards that were measured.
    pub views: usize,
}

/// Fewest samples on a board that count.
const FEWEST: usize = 50;

/// Compares `depths`, one plane of metres along z for each view, with the boards that `camera` saw.
///
/// # Errors
/// [`CalibrationError::Views`] where distances are missing on nearly all boards.
pub(super) fn offset(
    camera: &Camera,
    board: &Board,
    depths: &[&Plane<f32>],
) -> Result<RangeFit, CalibrationError> {
    let mut boards: Vec<(f64, f64)> = Vec::new();
    for (pose, depth) in camera.poses.iter().zip(depths) {
        let Some(pose) = pose else { continue };
        let normal = pose.rotation * DVec3::Z;
        let height = normal.dot(pose.translation_metres);
        let back = pose.rotation.transpose();
        let mut off = Vec::new();
        let mut far = 0.0;
        for y in 0..depth.height() {
            for x in 0..depth.width() {
                let metres = f64::from(depth[(x, y)]);
                if metres.is_nan() {
                    continue;
                }
                let Some(ray) = camera.lens.ray(DVec2::new(x as f64, y as f64)) else {
                    continue;
                };
                let true_metres = height / normal.dot(ray);
                let place = back * (ray * true_metres - pose.translation_metres);
                if true_metres > 0.0 && board.holds(place.truncate()) {
                    off.push(metres - true_metres);
                    far += true_metres;
                }
            }
        }
        if off.len() >= FEWEST {
            far /= off.len() as f64;
            boards.push((far, median(&mut off)));
        }
    }
    if boards.len() < 3 {
        return Err(CalibrationError::Views {
            camera: "depth camera",
            problem: format!(
                "distances are known on {} boards; 3 are needed",
                boards.len()
            ),
        });
    }
    let mut offsets: Vec<f64> = boards.iter().map(|(_, off)| *off).collect();
    let offset_metres = median(&mut offsets);
    let mut around: Vec<f64> = offsets
        .iter()
        .map(|off| (off - offset_metres).abs())
        .collect();
    let mut slopes = Vec::new();
    for (k, a) in boards.iter().enumerate() {
        // Nearly equal distances say nothing of growth.
        let others = boards[k + 1..].iter().filter(|b| (b.0 - a.0).abs() > 0.05);
        slopes.extend(others.map(|b| (b.1 - a.1) / (b.0 - a.0)));
    }
    Ok(RangeFit {
        offset_metres,
        scatter_metres: median(&mut around),
        growth: if slopes.is_empty() {
            0.0
        } else {
            median(&mut slopes)
        },
        views: boards.len(),
    })
}

pub(super) fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
