//! Where one surface ends and another, farther one begins.

use super::smooth::InverseDepth;
use drivers::Plane;
use rayon::prelude::*;

/// Cuts between neighbouring pixels: depth jumps there, or is unknown on one side.
#[derive(Debug, Clone)]
pub(super) struct Edges {
    /// Between (x, y) and (x + 1, y); true in the last column.
    pub right: Plane<bool>,
    /// Between (x, y) and (x, y + 1); true in the last row.
    pub below: Plane<bool>,
}

impl Edges {
    /// Of one surface that fills a picture of this size: only the picture's own end.
    pub fn none((width, height): (usize, usize)) -> Self {
        Self {
            right: Plane::from_fn(width, height, |x, _| x + 1 == width),
            below: Plane::from_fn(width, height, |_, y| y + 1 == height),
        }
    }
}

/// Jumps smaller than so many pixel pitches are the surface's own relief.
const RELIEF_PITCHES: f32 = 4.0;

/// Jumps smaller than so many standard deviations are noise…
const NOISE_SIGMAS: f32 = 4.0;

/// …but none above this share of depth: where depth is a guess, at silhouettes, its sigma spans the
/// gap to what lies behind.
const MOST_NOISE: f32 = 0.05;

/// Finds the cuts: the step between two pixels that neither side's own slope explains, above noise
/// and relief. `focal_pixels` turns pixel pitches into relative depth.
pub(super) fn edges(depth: &InverseDepth, focal_pixels: f32) -> Edges {
    let (width, height) = depth.value.size();
    let relief = RELIEF_PITCHES / focal_pixels;
    let cuts = |dx: usize, dy: usize| {
        let mut plane = Plane::filled(width, height, true);
        plane
            .samples_mut()
            .par_chunks_mut(width.max(1))
            .enumerate()
            .for_each(|(y, row)| {
                if y + dy >= height {
                    return;
                }
                for (x, cut) in row.iter_mut().enumerate().take(width - dx) {
                    let at = |i: isize| {
                        let x = x.checked_add_signed(i * dx as isize);
                        let y = y.checked_add_signed(i * dy as isize);
                        x.zip(y)
                            .and_then(|(x, y)| depth.value.get(x, y))
                            .copied()
                            .unwrap_or(f32::NAN)
                    };
                    let (here, there) = (at(0), at(1));
                    let step = there - here;
                    // `min` passes over NaN: a side without a slope explains nothing.
                    let unexplained = step
                        .abs()
                        .min((step - (here - at(-1))).abs())
                        .min((step - (at(2) - there)).abs());
                    let noise = depth.variance[(x, y)]
                        .max(depth.variance[(x + dx, y + dy)])
                        .sqrt();
                    let excused = (NOISE_SIGMAS * noise).min(MOST_NOISE * here.min(there));
                    let allowed = excused + relief * here.min(there);
                    *cut = step.is_nan() || unexplained > allowed;
                }
            });
        plane
    };
    Edges {
        right: cuts(1, 0),
        below: cuts(0, 1),
    }
}

impl Edges {
    /// Which neighbours of (x, y) lie on its own surface: left, right, above, below.
    pub fn open(&self, x: usize, y: usize) -> [bool; 4] {
        [
            x > 0 && !self.right[(x - 1, y)],
            !self.right[(x, y)],
            y > 0 && !self.below[(x, y - 1)],
            !self.below[(x, y)],
        ]
    }
}

/// Cuts that the run of a true edge leaves in the 5×5 pixels around any of them, at least.
const RUN_OF_AN_EDGE: usize = 4;

impl Edges {
    /// Only the cuts that belong to an edge of some length, and those beside unknown depth: what
    /// noise leaves stands alone.
    pub fn firm(&self, depth: &InverseDepth) -> Self {
        let (width, height) = depth.value.size();
        let stands = |x: usize, y: usize, there: (usize, usize)| {
            let unknown =
                |at: (usize, usize)| depth.value.get(at.0, at.1).is_none_or(|w| w.is_nan());
            if unknown((x, y)) || unknown(there) {
                return true;
            }
            // At the picture's border the window moves inward instead of shrinking.
            let window = |at: usize, size: usize| {
                let first = at.saturating_sub(2).min(size.saturating_sub(5));
                first..(first + 5).min(size)
            };
            let cuts = window(y, height)
                .flat_map(|y| window(x, width).map(move |x| (x, y)))
                .filter(|&at| self.right[at] || self.below[at])
                .count();
            cuts >= RUN_OF_AN_EDGE
        };
        let kept = |cuts: &Plane<bool>, dx: usize, dy: usize| {
            let mut kept = cuts.clone();
            kept.samples_mut()
                .par_chunks_mut(width.max(1))
                .enumerate()
                .for_each(|(y, row)| {
                    for (x, cut) in row.iter_mut().enumerate() {
                        *cut = *cut && stands(x, y, (x + dx, y + dy));
                    }
                });
            kept
        };
        Self {
            right: kept(&self.right, 1, 0),
            below: kept(&self.below, 0, 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(value: Plane<f32>) -> InverseDepth {
        let variance = value.map(|_| 1e-12);
        InverseDepth { value, variance }
    }

    #[test]
    fn a_step_is_cut_and_a_steep_plane_is_not() {
        let steep = exact(Plane::from_fn(16, 4, |x, _| 2.0 - 0.1 * x as f32));
        let found = edges(&steep, 300.0);
        assert!(
            (0..15).all(|x| !found.right[(x, 1)]),
            "a plane from 0.5 m to 2 m was cut"
        );

        let step = exact(Plane::from_fn(
            16,
            4,
            |x, _| if x < 8 { 1.0 } else { 1.0 / 1.2 },
        ));
        let found = edges(&step, 300.0);
        assert_eq!(
            (0..15).filter(|&x| found.right[(x, 1)]).collect::<Vec<_>>(),
            [7]
        );
        assert!((0..3).all(|y| !found.below[(5, y)]));
    }

    #[test]
    fn a_lone_cut_is_not_firm_and_an_edge_is() {
        let mut value = Plane::from_fn(16, 16, |x, _| if x < 8 { 1.0 } else { 1.0 / 1.2 });
        value[(3, 3)] = 0.8;
        let depth = exact(value);
        let firm = edges(&depth, 300.0).firm(&depth);
        assert!(!firm.right[(3, 3)] && !firm.below[(3, 3)]);
        assert!((0..16).all(|y| firm.right[(7, y)]));
    }

    #[test]
    fn unknown_depth_is_cut_all_around() {
        let hole = exact(Plane::from_fn(5, 5, |x, y| {
            if (x, y) == (2, 2) { f32::NAN } else { 1.0 }
        }));
        let found = edges(&hole, 300.0);
        assert_eq!(found.open(2, 2), [false; 4]);
        assert_eq!(found.open(1, 2), [true, false, true, true]);
    }
}
