//! A depth camera of fewer pixels.

use super::{
    CorruptionError,
    depth_grid::{lens, metres},
};
use crate::shot::Shot;
use drivers::{DepthCamera, DepthFrame, Plane, Rig, RigidTransform, chance::Chance};

/// Depth on a grid `factor` times as coarse a side, each sample the mean of what is known in its
/// cell, or unknown where less than half is. The rig tells the new grid, so nothing is in the wrong
/// place; steps mix, as they do in a larger pixel.
pub(super) fn on_shot(shot: &Shot, factor: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let (width, height) = metres(shot)?.size();
    let coarser = |side: usize| ((side as f32 / factor) as usize).max(1);
    let size = (coarser(width), coarser(height));
    let camera = DepthCamera {
        lens: lens(shot).scaled_to(size.0, size.1),
        to_color: shot
            .rig
            .depth
            .map_or(RigidTransform::IDENTITY, |camera| camera.to_color),
    };
    let frame = &shot.depth;
    let depth = DepthFrame {
        metres: reduced(&frame.metres, size),
        amplitude: frame.amplitude.as_ref().map(|plane| reduced(plane, size)),
        sigma: None,
        ..frame.clone()
    };
    Ok(Shot {
        depth,
        rig: Rig {
            depth: Some(camera),
            ..shot.rig
        },
        ..shot.clone()
    })
}

fn reduced(plane: &Plane<f32>, size: (usize, usize)) -> Plane<f32> {
    let (width, height) = plane.size();
    let cell = |at: usize, cells: usize, end: usize| at * end / cells..(at + 1) * end / cells;
    Plane::from_fn(size.0, size.1, |x, y| {
        let (columns, rows) = (cell(x, size.0, width), cell(y, size.1, height));
        let samples = columns.len() * rows.len();
        let known = rows
            .flat_map(|y| &plane.row(y)[columns.clone()])
            .filter(|value| value.is_finite());
        let (sum, count) = known.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
        if 2 * count >= samples && count > 0 {
            sum / count as f32
        } else {
            f32::NAN
        }
    })
}
