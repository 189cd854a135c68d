//! Pieces of surface: smooth, connected, and taken to be of one material.

use super::connected::connected;
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

/// Joins neighbours that no cut and no fold parts.
pub(super) fn regions(edges: &Edges, normal: &Plane<Vec3>) -> Regions {
    let (width, height) = normal.size();
    let smooth = |a: (usize, usize), b: (usize, usize)| normal[a].dot(normal[b]) > FOLD_COSINE;
    let pieces = connected(
        (width, height),
        |x, y| !edges.right[(x, y)] && smooth((x, y), (x + 1, y)),
        |x, y| !edges.below[(x, y)] && smooth((x, y), (x, y + 1)),
    );
    // Pieces get consecutive numbers in the order they are met.
    let mut numbers = vec![u32::MAX; pieces.len()];
    let mut count = 0;
    let mut of = Plane::filled(width, height, None);
    let places = of.samples_mut().iter_mut().zip(pieces.samples());
    for ((region, piece), normal) in places.zip(normal.samples()) {
        if normal.is_nan() {
            continue;
        }
        let number = &mut numbers[*piece as usize];
        if *number == u32::MAX {
            *number = count;
            count += 1;
        }
        *region = Some(*number);
    }
    Regions {
        of,
        count: count as usize,
    }
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
