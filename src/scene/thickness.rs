//! How far surfaces reach back: the half of the shape that no camera saw.

use super::edges::Edges;
use drivers::Plane;
use glam::Vec2;
use rayon::prelude::*;

/// Depth of a body as a share of its width, where its front is flat.
const BOX_SHARE: f32 = 1.0;

/// What a run of connected pixels along one image line tells about the body behind it.
#[derive(Debug, Clone, Copy)]
struct Run {
    first: usize,
    last: usize,
    /// Does the body end here, in front of something farther?
    ends: [bool; 2],
}

/// Metres of z behind every pixel; NaN where depth is unknown, +∞ for what shows no end (walls,
/// floors).
///
/// Along a row or a column a body runs from one occluding edge to the other. Its front is mirrored
/// at the depth of those edges (exact for balls and pipes); a front too flat for its width is given
/// `BOX_SHARE` of that width instead. The thinner answer of row and column holds, between `least`
/// and `most` metres.
pub(super) fn thickness(
    depth_metres: &Plane<f32>,
    edges: &Edges,
    rays: &Plane<Vec2>,
    least: f32,
    most: f32,
) -> Plane<f32> {
    let (width, height) = depth_metres.size();
    let mut plane = Plane::filled(width, height, f32::INFINITY);
    plane
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            let depth = |x: usize| depth_metres[(x, y)];
            let ray = |x: usize| rays[(x, y)];
            along(
                width,
                depth,
                ray,
                |x| edges.right[(x, y)],
                |x, t| row[x] = t,
            );
        });
    // Columns, turned so that each task owns one of them.
    let mut columns = Plane::filled(height, width, f32::INFINITY);
    columns
        .samples_mut()
        .par_chunks_mut(height.max(1))
        .enumerate()
        .for_each(|(x, column)| {
            let depth = |y: usize| depth_metres[(x, y)];
            let ray = |y: usize| rays[(x, y)];
            along(
                height,
                depth,
                ray,
                |y| edges.below[(x, y)],
                |y, t| column[y] = t,
            );
        });
    plane
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (x, thickness) in row.iter_mut().enumerate() {
                if depth_metres[(x, y)].is_nan() {
                    *thickness = f32::NAN;
                    continue;
                }
                let thinner = thickness.min(columns[(y, x)]);
                *thickness = if thinner == f32::INFINITY {
                    thinner
                } else {
                    thinner.clamp(least, most)
                };
            }
        });
    plane
}

/// Steps of depth smaller than this share of it, across a gap, are one surface with a hole.
const SAME_SURFACE: f32 = 0.02;

/// Thickness along one line of `count` pixels.
fn along(
    count: usize,
    depth: impl Fn(usize) -> f32,
    ray: impl Fn(usize) -> Vec2,
    cut_after: impl Fn(usize) -> bool,
    mut set: impl FnMut(usize, f32),
) {
    let known_from = |mut i: usize| {
        while i < count && depth(i).is_nan() {
            i += 1;
        }
        i
    };
    let mut first = known_from(0);
    // Beside a gap that reaches the picture's border the body ends: what lies behind is too far
    // away to answer. At the border itself nobody knows.
    let mut starts = first > 0;
    while first < count {
        let mut last = first;
        let (ends, next, next_starts) = loop {
            if last + 1 < count && !cut_after(last) {
                last += 1;
                continue;
            }
            let next = known_from(last + 1);
            if next >= count {
                break (last + 1 < count, next, false);
            }
            let (here, there) = (depth(last), depth(next));
            let hole = next > last + 1 && (here - there).abs() < SAME_SURFACE * here.min(there);
            if hole {
                last = next;
                continue;
            }
            break (here < there, next, there < here);
        };
        body(
            Run {
                first,
                last,
                ends: [starts, ends],
            },
            &depth,
            &ray,
            &mut set,
        );
        (first, starts) = (next, next_starts);
    }
}

/// Thickness of one run.
fn body(
    run: Run,
    depth: &impl Fn(usize) -> f32,
    ray: &impl Fn(usize) -> Vec2,
    set: &mut impl FnMut(usize, f32),
) {
    let Run { first, last, ends } = run;
    // Edges of the silhouette; a run with one end is mirrored at that one.
    let (z_first, z_last) = match ends {
        [true, true] => (depth(first), depth(last)),
        [true, false] => (depth(first), depth(first)),
        [false, true] => (depth(last), depth(last)),
        [false, false] => return,
    };
    let length = (last - first).max(1) as f32;
    let edge = |i: usize| z_first + (z_last - z_first) * (i - first) as f32 / length;
    let mirrored = |i: usize| 2.0 * (edge(i) - depth(i));
    let bulge = (first..=last).map(mirrored).fold(0.0, f32::max);
    // One pixel is as wide as the step to its neighbour.
    let step = ray(first).distance(ray(if last > first {
        last
    } else if first > 0 {
        first - 1
    } else {
        first + 1
    })) / length;
    let chord = 0.5 * (z_first + z_last) * step * (last - first + 1) as f32;
    let flat = (BOX_SHARE * chord - bulge).max(0.0);
    for i in first..=last {
        set(i, mirrored(i).max(0.0) + flat);
    }
}
