//! Depth that the photograph contradicts: pieces that hang before or behind their surroundings although
//! the picture goes on across their edges.

use super::{look::Look, steps::Steps};
use crate::{develop::Development, scene::connected, shot::Shot};
use drivers::Plane;

/// Steps smaller than this share of the nearer depth may be relief that no photograph shows.
const CLEAR: f32 = 0.06;
/// Share of a piece's edge across which the photograph goes on, from which it does not belong there.
const UNSEEN_SHARE: f32 = 0.55;
/// Fewest pixels of such an edge.
const LEAST_EDGE: usize = 8;
/// Largest piece that can be out of place, as a share of the picture: the rest must be its surroundings.
const LARGEST: f32 = 0.6;

/// Edges of one piece of depth, in pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Edge {
    pixels: usize,
    /// Where it is the farther side: all, and those that the photograph does not show.
    far: [usize; 2],
    /// The same where it is the nearer side.
    near: [usize; 2],
}

impl Edge {
    fn is_contradicted(&self, largest: usize) -> bool {
        let unseen = |[all, unseen]: [usize; 2], others: usize| {
            unseen >= LEAST_EDGE && unseen as f32 > UNSEEN_SHARE * (all + others) as f32
        };
        self.pixels <= largest && (unseen(self.far, self.near[0]) || unseen(self.near, self.far[0]))
    }
}

/// Pixels whose depth the photograph contradicts, on the photograph's working grid; `None` without any.
pub fn contradicted(shot: &Shot, development: &Development) -> Option<Plane<bool>> {
    let look = Look::of(shot, development);
    of(&look, &Steps::of(&look))
}

/// The same, of a look and the steps of its depth.
pub(super) fn of(look: &Look<'_>, steps: &Steps) -> Option<Plane<bool>> {
    let (width, height) = look.size();
    let mut cut = [(); 2].map(|()| Plane::filled(width, height, false));
    for step in &steps.found {
        cut[usize::from(step.across)][(step.x, step.y)] = true;
    }
    let piece = pieces(&look.metres, &cut);
    let mut edges = vec![Edge::default(); piece.len()];
    for index in piece.samples() {
        edges[*index as usize].pixels += 1;
    }
    for step in steps.found.iter().filter(|step| step.height > CLEAR) {
        let there = if step.across {
            (step.x + 1, step.y)
        } else {
            (step.x, step.y + 1)
        };
        let here = (step.x, step.y);
        let (near, far) = if look.metres[here] < look.metres[there] {
            (here, there)
        } else {
            (there, here)
        };
        let unseen = usize::from(!step.seen);
        for (side, at) in [(true, far), (false, near)] {
            let edge = &mut edges[piece[at] as usize];
            let counts = if side { &mut edge.far } else { &mut edge.near };
            *counts = [counts[0] + 1, counts[1] + unseen];
        }
    }
    let largest = (LARGEST * piece.len() as f32) as usize;
    let wrong: Vec<bool> = edges
        .iter()
        .map(|edge| edge.is_contradicted(largest))
        .collect();
    let grid = look.development.scene.depth_metres.size();
    let found = Plane::from_fn(grid.0, grid.1, |x, y| {
        let at = (
            (x / look.stride).min(width - 1),
            (y / look.stride).min(height - 1),
        );
        !look.metres[at].is_nan() && wrong[piece[at] as usize]
    });
    found.samples().contains(&true).then_some(found)
}

/// The piece of connected depth that every pixel belongs to, named by its first pixel. `cut` says
/// where depth steps: below a pixel, and right of it.
fn pieces(metres: &Plane<f32>, [below, right]: &[Plane<bool>; 2]) -> Plane<u32> {
    let known = |x: usize, y: usize| !metres[(x, y)].is_nan();
    connected(
        metres.size(),
        |x, y| known(x, y) && known(x + 1, y) && !right[(x, y)],
        |x, y| known(x, y) && known(x, y + 1) && !below[(x, y)],
    )
}
