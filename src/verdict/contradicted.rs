//! Depth that the photograph contradicts: pieces that hang before or behind their surroundings although
//! the picture goes on across their edges.

use super::{
    look::Look,
    steps::{Step, Steps},
};
use crate::{develop::Development, scene::connected, shot::Shot};
use drivers::Plane;

/// Steps smaller than this share of the nearer depth may be relief that no photograph shows.
const CLEAR: f32 = 0.06;
/// Share of a piece's edge across which the photograph goes on, from which it does not belong there.
const UNSEEN_SHARE: f32 = 0.55;
/// Fewest pixels of such an edge.
const LEAST_EDGE: usize = 8;
/// Under texture the photograph changes at every pixel of an edge, but where only the depth steps it does
/// not change on average: by less than this share of what light falls off by over the step …
const EVEN: f32 = 0.08;
/// … which has to be this much on average, in natural logarithms of light (a mirror about doubles a
/// distance) …
const LEAST_FALL: f32 = 0.7;
/// … over this share of the piece's edges, and so many pixels (rendered validation captures).
const EVEN_SHARE: f32 = 0.7;
const LEAST_EVEN_EDGE: f32 = 32.0;
/// Largest piece that can be out of place, as a share of the picture: the rest must be its surroundings.
const LARGEST: f32 = 0.6;

/// One side of a piece's edge.
#[derive(Debug, Clone, Copy, Default)]
struct Side {
    /// Pixels, and those where the photograph shows nothing.
    pixels: [usize; 2],
    /// Pixels whose light is known on both sides, how much brighter the nearer ones are together, and
    /// how much brighter they would be were both of one color; natural logarithms.
    light: [f32; 3],
}

impl Side {
    /// One pixel of an edge.
    fn of(look: &Look<'_>, step: &Step, near: (usize, usize), far: (usize, usize)) -> Self {
        let mut side = Self {
            pixels: [1, usize::from(!step.seen)],
            light: [0.0; 3],
        };
        // A pixel further on each side, where nothing of the other is mixed in.
        let beyond = |(x, y): (usize, usize), (from_x, from_y): (usize, usize)| {
            let (x, y) = ((2 * x).checked_sub(from_x)?, (2 * y).checked_sub(from_y)?);
            look.light.get(x, y).copied()
        };
        if let (Some(nearer), Some(farther)) = (beyond(near, far), beyond(far, near))
            && (nearer - farther).is_finite()
        {
            let fall = 2.0 * (look.metres[far] / look.metres[near]).ln();
            side.light = [1.0, nearer - farther, fall];
        }
        side
    }

    fn add(&mut self, other: &Self) {
        for (sum, one) in self.pixels.iter_mut().zip(other.pixels) {
            *sum += one;
        }
        for (sum, one) in self.light.iter_mut().zip(other.light) {
            *sum += one;
        }
    }

    /// Whether the photograph goes on across it; `others` are the pixels of the piece's other edges.
    fn goes_on(&self, others: usize) -> bool {
        let [all, unseen] = self.pixels;
        let edges = (all + others) as f32;
        let unseen = unseen >= LEAST_EDGE && unseen as f32 > UNSEEN_SHARE * edges;
        let [known, brighter, fall] = self.light;
        let even = known >= LEAST_EVEN_EDGE
            && known > EVEN_SHARE * edges
            && fall > LEAST_FALL * known
            && brighter.abs() < EVEN * fall;
        unseen || even
    }
}

/// Edges of one piece of depth.
#[derive(Debug, Clone, Copy, Default)]
struct Edge {
    pixels: usize,
    /// Where it is the farther side.
    far: Side,
    /// Where it is the nearer side.
    near: Side,
}

impl Edge {
    fn is_contradicted(&self, largest: usize) -> bool {
        let goes_on = |side: &Side, other: &Side| side.goes_on(other.pixels[0]);
        self.pixels <= largest && (goes_on(&self.far, &self.near) || goes_on(&self.near, &self.far))
    }
}

/// Pixels whose depth the photograph contradicts, on the photograph's working grid; `None` without any.
pub fn contradicted(shot: &Shot, development: &Development) -> Option<Plane<bool>> {
    let look = Look::of(shot, development);
    of(&look, &Steps::of(&look))
}

/// The same, of a look and the steps of its depth.
pub(super) fn of(look: &Look<'_>, steps: &Steps) -> Option<Plane<bool>> {
    let piece = pieces_of(look, steps);
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
        let side = Side::of(look, step, near, far);
        edges[piece[far] as usize].far.add(&side);
        edges[piece[near] as usize].near.add(&side);
    }
    let largest = (LARGEST * piece.len() as f32) as usize;
    let wrong: Vec<bool> = edges
        .iter()
        .map(|edge| edge.is_contradicted(largest))
        .collect();
    let found = look.on_working_grid(|at| wrong[piece[at] as usize]);
    found.samples().contains(&true).then_some(found)
}

/// The piece of connected depth that every pixel belongs to, named by its first pixel.
pub(super) fn pieces_of(look: &Look<'_>, steps: &Steps) -> Plane<u32> {
    let (width, height) = look.size();
    let mut cut = [(); 2].map(|()| Plane::filled(width, height, false));
    for step in &steps.found {
        cut[usize::from(step.across)][(step.x, step.y)] = true;
    }
    pieces(&look.metres, &cut)
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
