//! Pieces of surface: smooth, connected, and taken to be of one material.

use super::edges::Edges;
use drivers::Plane;
use glam::Vec3;

/// Pixels grouped into pieces of surface.
#[derive(Debug, Clone)]
pub(super) struct Regions {
    /// Index of each pixel's piece; `None` where nothing is known.
    pub of: Plane<Option<u32>>,
    /// How many pieces there are.
    pub count: usize,
}

/// A fold sharper than this (cosine between neighbouring normals; 20°) parts two pieces.
const FOLD_COSINE: f32 = 0.94;

/// Joins neighbours that no cut and no fold parts (union–find, near-linear).
pub(super) fn regions(edges: &Edges, normal: &Plane<Vec3>) -> Regions {
    let (width, height) = normal.size();
    let mut parents: Vec<u32> = (0..normal.len() as u32).collect();
    let smooth = |a: Vec3, b: Vec3| a.dot(b) > FOLD_COSINE;
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            let here = normal.samples()[i];
            if x + 1 < width && !edges.right[(x, y)] && smooth(here, normal.samples()[i + 1]) {
                join(&mut parents, i as u32, (i + 1) as u32);
            }
            if y + 1 < height && !edges.below[(x, y)] && smooth(here, normal.samples()[i + width]) {
                join(&mut parents, i as u32, (i + width) as u32);
            }
        }
    }
    // Roots get consecutive numbers in the order they are met.
    let mut numbers = vec![u32::MAX; parents.len()];
    let mut count = 0;
    let mut of = Plane::filled(width, height, None);
    for (i, region) in of.samples_mut().iter_mut().enumerate() {
        if normal.samples()[i].is_nan() {
            continue;
        }
        let root = root(&mut parents, i as u32) as usize;
        if numbers[root] == u32::MAX {
            numbers[root] = count;
            count += 1;
        }
        *region = Some(numbers[root]);
    }
    Regions {
        of,
        count: count as usize,
    }
}

/// Representative of `i`'s set; halves the path on the way.
fn root(parents: &mut [u32], mut i: u32) -> u32 {
    while parents[i as usize] != i {
        let up = parents[parents[i as usize] as usize];
        parents[i as usize] = up;
        i = up;
    }
    i
}

fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    // The smaller index leads, so that numbering does not depend on the order of joining.
    let (low, high) = (a.min(b), a.max(b));
    parents[high as usize] = low;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{edges::edges, smooth::InverseDepth};

    #[test]
    fn a_fold_and_a_step_part_surfaces_and_a_gentle_bend_does_not() {
        // Columns: a bend of 6° a pixel, a fold of 90° at x = 4, a step of depth at x = 8.
        let normal = Plane::from_fn(12, 5, |x, _| {
            let angle = if x < 4 { 0.1 * x as f32 } else { 1.5 };
            Vec3::new(angle.sin(), 0.0, -angle.cos())
        });
        let value = Plane::from_fn(12, 5, |x, _| if x < 8 { 1.0 } else { 0.5 });
        let variance = value.map(|_| 1e-12);
        let depth = InverseDepth { value, variance };
        let found = regions(&edges(&depth, 300.0), &normal);
        assert_eq!(found.count, 3);
        let row: Vec<_> = (0..12).map(|x| found.of[(x, 2)].unwrap()).collect();
        assert_eq!(row, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]);
    }

    #[test]
    fn unknown_pixels_belong_nowhere() {
        let depth = InverseDepth {
            value: Plane::filled(3, 3, f32::NAN),
            variance: Plane::filled(3, 3, f32::NAN),
        };
        let found = regions(&edges(&depth, 300.0), &Plane::filled(3, 3, Vec3::NAN));
        assert_eq!(found.count, 0);
        assert!(found.of.samples().iter().all(Option::is_none));
    }
}
