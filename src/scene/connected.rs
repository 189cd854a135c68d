//! Connected pixels (union–find, near-linear).

use drivers::Plane;

/// The piece that every pixel of a picture belongs to, named by its first pixel in row order. `right`
/// and `below` say whether a pixel and its neighbour there belong together; they are asked of pixels
/// that have one.
pub(crate) fn connected(
    (width, height): (usize, usize),
    right: impl Fn(usize, usize) -> bool,
    below: impl Fn(usize, usize) -> bool,
) -> Plane<u32> {
    let mut parents: Vec<u32> = (0..(width * height) as u32).collect();
    for y in 0..height {
        for x in 0..width {
            let here = (y * width + x) as u32;
            if x + 1 < width && right(x, y) {
                join(&mut parents, here, here + 1);
            }
            if y + 1 < height && below(x, y) {
                join(&mut parents, here, here + width as u32);
            }
        }
    }
    let names = (0..(width * height) as u32).map(|pixel| root(&mut parents, pixel));
    Plane::new(width, height, names.collect()).expect("one name per pixel")
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
    // The smaller index leads, so that names do not depend on the order of joining.
    parents[a.max(b) as usize] = a.min(b);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_is_named_by_its_first_pixel_and_reaches_around_corners() {
        // Letters that touch are one piece: a spiral, and the dot within.
        let picture = [b"aaaa", b"...a", b"ab.a", b"aaaa"];
        let same = |a: (usize, usize), b: (usize, usize)| picture[a.1][a.0] == picture[b.1][b.0];
        let pieces = connected(
            (4, 4),
            |x, y| same((x, y), (x + 1, y)),
            |x, y| same((x, y), (x, y + 1)),
        );
        let names: Vec<u32> = pieces.samples().to_vec();
        assert_eq!(names, [0, 0, 0, 0, 4, 4, 4, 0, 0, 9, 4, 0, 0, 0, 0, 0]);
    }
}
