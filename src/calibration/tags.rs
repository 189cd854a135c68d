//! Tags of the family 36h11 in a picture: dark rings with four corners whose cells spell a code.
//!
//! The usual road (Garrido-Jurado et al., "Automatic generation and detection of highly reliable
//! fiducial markers", Pattern Recognition 2014): local threshold, connected dark regions, four corners,
//! straight edges, cells. Of our own, since the AprilTag library is C and would read pictures from
//! outside, and since the corners of the chessboard, not of the tags, are what is measured.

use super::{homography, sampling::sample, tag36h11::TAG36H11};
use drivers::Plane;
use glam::{DMat3, DVec2};

/// A tag in a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tag {
    /// Place in the family.
    pub id: usize,
    /// From its own top left corner on, clockwise as printed.
    pub corners: [DVec2; 4],
}

/// Cells across a tag, its black border included.
const CELLS: usize = 8;
/// Reaches of the local mean that the threshold compares with, pixels.
const REACHES: [usize; 3] = [5, 12, 28];
/// How far under the local mean is dark.
const DARKER: f32 = 0.04;
/// Least side of a tag, pixels: two for each cell.
const LEAST_SIDE: f64 = 2.0 * CELLS as f64;
/// Cells of the border that may look white, and inner cells that may be wrong. Codes differ in eleven
/// cells at least.
const WRONG_BORDER: usize = 3;
const WRONG_CELLS: u32 = 2;

/// Finds tags in a picture between 0 and 1; each at most once.
pub(super) fn find(gray: &Plane<f32>) -> Vec<Tag> {
    let sums = sums(gray);
    let mut found: Vec<Tag> = Vec::new();
    for reach in REACHES {
        let dark = darker_than_around(gray, &sums, reach);
        for region in regions(&dark) {
            let Some(tag) = corners(&region).and_then(|rough| read(gray, rough)) else {
                continue;
            };
            let middle = |tag: &Tag| tag.corners.iter().sum::<DVec2>() / 4.0;
            let side = tag.corners[0].distance(tag.corners[1]);
            let known =
                |other: &Tag| other.id == tag.id && middle(other).distance(middle(&tag)) < side;
            if !found.iter().any(known) {
                found.push(tag);
            }
        }
    }
    // A tag in two places is a second board or a mistake; which is which cannot be known.
    let ids: Vec<usize> = found.iter().map(|tag| tag.id).collect();
    found.retain(|tag| ids.iter().filter(|id| **id == tag.id).count() == 1);
    found
}

/// Sum of everything above and left of each grid point.
fn sums(gray: &Plane<f32>) -> Plane<f64> {
    let (width, height) = gray.size();
    let mut sums = Plane::filled(width + 1, height + 1, 0.0);
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += f64::from(gray[(x, y)]);
            sums[(x + 1, y + 1)] = sums[(x + 1, y)] + row;
        }
    }
    sums
}

fn darker_than_around(gray: &Plane<f32>, sums: &Plane<f64>, reach: usize) -> Plane<bool> {
    let (width, height) = gray.size();
    Plane::from_fn(width, height, |x, y| {
        let (left, top) = (x.saturating_sub(reach), y.saturating_sub(reach));
        let (right, bottom) = ((x + reach + 1).min(width), (y + reach + 1).min(height));
        let sum =
            sums[(right, bottom)] + sums[(left, top)] - sums[(right, top)] - sums[(left, bottom)];
        let mean = sum / ((right - left) * (bottom - top)) as f64;
        gray[(x, y)] < mean as f32 - DARKER
    })
}

/// Pixels of each connected dark region that may be a tag.
fn regions(dark: &Plane<bool>) -> Vec<Vec<DVec2>> {
    let (width, height) = dark.size();
    let least = (LEAST_SIDE * LEAST_SIDE / 4.0) as usize;
    let mut seen = dark.map(|dark| !dark);
    let mut waiting = Vec::new();
    let mut found = Vec::new();
    for start in 0..width * height {
        if seen.samples()[start] {
            continue;
        }
        seen.samples_mut()[start] = true;
        waiting.push(start);
        let mut region = Vec::new();
        let mut cut = false;
        while let Some(at) = waiting.pop() {
            let (x, y) = (at % width, at / width);
            region.push(DVec2::new(x as f64, y as f64));
            cut |= x == 0 || y == 0 || x + 1 == width || y + 1 == height;
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then_some(at + width),
            ];
            for next in beside.into_iter().flatten() {
                if !std::mem::replace(&mut seen.samples_mut()[next], true) {
                    waiting.push(next);
                }
            }
        }
        if !cut && region.len() >= least {
            found.push(region);
        }
    }
    found
}

/// The four corners of a region that has four, clockwise in the picture; rough.
fn corners(region: &[DVec2]) -> Option<[DVec2; 4]> {
    let farthest = |distance: &dyn Fn(DVec2) -> f64| {
        let by = |a: &&DVec2, b: &&DVec2| distance(**a).total_cmp(&distance(**b));
        region.iter().max_by(by).copied()
    };
    let middle = region.iter().sum::<DVec2>() / region.len() as f64;
    let first = farthest(&|p| p.distance_squared(middle))?;
    let third = farthest(&|p| p.distance_squared(first))?;
    let across = (third - first).perp().try_normalize()?;
    let second = farthest(&|p| (p - first).dot(across))?;
    let fourth = farthest(&|p| -(p - first).dot(across))?;
    // `perp` turns from x towards y, which is clockwise in a picture; seen from `first`, what lies to
    // that side comes last.
    let quad = [first, fourth, third, second];
    let sides: [DVec2; 4] = std::array::from_fn(|k| quad[(k + 1) % 4] - quad[k]);
    let long_enough = sides.iter().all(|side| side.length() >= LEAST_SIDE - 1.0);
    let convex = (0..4).all(|k| sides[k].perp_dot(sides[(k + 1) % 4]) > 0.0);
    (long_enough && convex).then_some(quad)
}

/// Moves the corners to where straight edges meet, and reads the cells between them.
fn read(gray: &Plane<f32>, rough: [DVec2; 4]) -> Option<Tag> {
    let quad = straightened(gray, rough)?;
    let unit = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let pairs: Vec<(DVec2, DVec2)> = unit
        .iter()
        .zip(quad)
        .map(|((x, y), corner)| (DVec2::new(*x, *y) * CELLS as f64, corner))
        .collect();
    let map = homography::homography(&pairs)?;
    let mut cells = [[0.0f32; CELLS]; CELLS];
    for (row, cells) in cells.iter_mut().enumerate() {
        for (column, cell) in cells.iter_mut().enumerate() {
            *cell = lightness(gray, &map, column, row);
        }
    }
    let mut sorted: Vec<f32> = cells.as_flattened().to_vec();
    sorted.sort_by(f32::total_cmp);
    // Border and code together are dark for a half at least; a fifth of a code is white at least.
    let (dark, light) = (sorted[CELLS * CELLS / 4], sorted[CELLS * CELLS * 15 / 16]);
    if light - dark < 2.0 * DARKER {
        return None;
    }
    let white = |row: usize, column: usize| cells[row][column] > (dark + light) / 2.0;
    let inner = 1..CELLS - 1;
    let (mut code, mut border) = (0u64, 0);
    for row in 0..CELLS {
        for column in 0..CELLS {
            if inner.contains(&row) && inner.contains(&column) {
                code = code << 1 | u64::from(white(row, column));
            } else {
                border += usize::from(white(row, column));
            }
        }
    }
    if border > WRONG_BORDER {
        return None;
    }
    for turn in 0..4 {
        let wrong = |tag: &u64| (tag ^ code).count_ones();
        if let Some(id) = TAG36H11.iter().position(|tag| wrong(tag) <= WRONG_CELLS) {
            let corners = std::array::from_fn(|k| quad[(turn + k) % 4]);
            return Some(Tag { id, corners });
        }
        code = turned(code);
    }
    None
}

/// The code as it reads after its tag was turned by a quarter against the clock.
fn turned(code: u64) -> u64 {
    const SIDE: usize = CELLS - 2;
    let bit = |row: usize, column: usize| code >> (SIDE * SIDE - 1 - (row * SIDE + column)) & 1;
    let mut out = 0;
    for row in 0..SIDE {
        for column in 0..SIDE {
            out = out << 1 | bit(column, SIDE - 1 - row);
        }
    }
    out
}

/// Mean over the middle of a cell.
fn lightness(gray: &Plane<f32>, map: &DMat3, column: usize, row: usize) -> f32 {
    let mut sum = 0.0;
    for dy in [0.3, 0.5, 0.7] {
        for dx in [0.3, 0.5, 0.7] {
            let place = DVec2::new(column as f64 + dx, row as f64 + dy);
            sum += sample(gray, homography::apply(map, place));
        }
    }
    sum / 9.0
}

/// Corners where lines through the steepest places of each side meet.
fn straightened(gray: &Plane<f32>, rough: [DVec2; 4]) -> Option<[DVec2; 4]> {
    /// Places along a side.
    const PLACES: usize = 12;
    let mut lines = [(DVec2::ZERO, DVec2::ZERO); 4];
    for (k, line) in lines.iter_mut().enumerate() {
        let (from, to) = (rough[k], rough[(k + 1) % 4]);
        let length = from.distance(to);
        // Outward: clockwise in the picture, the inside lies to the right of a side.
        let outward = -(to - from).perp() / length;
        let reach = (length / CELLS as f64 * 0.8).clamp(1.5, 5.0);
        let mut places = Vec::with_capacity(PLACES);
        for place in 0..PLACES {
            let share = 0.12 + 0.76 * place as f64 / (PLACES - 1) as f64;
            let at = from.lerp(to, share);
            let steps = (reach / 0.25) as i32;
            let rise = |step: i32| {
                let here = at + outward * (f64::from(step) * 0.25);
                sample(gray, here + outward * 0.75) - sample(gray, here - outward * 0.75)
            };
            let best = (-steps..=steps).max_by(|a, b| rise(*a).total_cmp(&rise(*b)))?;
            if rise(best) > DARKER {
                places.push(at + outward * (f64::from(best) * 0.25));
            }
        }
        *line = line_through(&places)?;
    }
    let mut quad = [DVec2::ZERO; 4];
    for (k, corner) in quad.iter_mut().enumerate() {
        let ((a, u), (b, v)) = (lines[(k + 3) % 4], lines[k]);
        let along = (b - a).perp_dot(v) / u.perp_dot(v);
        *corner = a + u * along;
        let side = rough[k].distance(rough[(k + 1) % 4]);
        let moved = corner.distance(rough[k]);
        if moved.is_nan() || moved >= side / 4.0 {
            return None;
        }
    }
    Some(quad)
}

/// A point and a direction; the median place of three thirds holds it against a few wrong ones.
fn line_through(places: &[DVec2]) -> Option<(DVec2, DVec2)> {
    if places.len() < 6 {
        return None;
    }
    let mut kept = places.to_vec();
    for _ in 0..2 {
        let mean = kept.iter().sum::<DVec2>() / kept.len() as f64;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for place in &kept {
            let off = *place - mean;
            xx += off.x * off.x;
            xy += off.x * off.y;
            yy += off.y * off.y;
        }
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let way = DVec2::from_angle(angle);
        let off = |place: &DVec2| (*place - mean).perp_dot(way).abs();
        let mut sizes: Vec<f64> = kept.iter().map(off).collect();
        sizes.sort_by(f64::total_cmp);
        let limit = (3.0 * sizes[sizes.len() / 2]).max(0.3);
        let near: Vec<DVec2> = kept
            .iter()
            .filter(|place| off(place) <= limit)
            .copied()
            .collect();
        if near.len() == kept.len() || near.len() < 6 {
            return Some((mean, way));
        }
        kept = near;
    }
    let mean = kept.iter().sum::<DVec2>() / kept.len() as f64;
    let way = (*kept.last()? - kept[0]).try_normalize()?;
    Some((mean, way))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_quarter_turns_give_the_code_back_and_fewer_another_tag_or_none() {
        for code in TAG36H11.iter().take(40) {
            let mut now = *code;
            for turn in 1..=4 {
                now = turned(now);
                let equal = TAG36H11
                    .iter()
                    .any(|tag| (tag ^ now).count_ones() <= WRONG_CELLS);
                assert_eq!(equal, turn == 4, "{code:#x} after {turn}");
            }
            assert_eq!(now, *code);
        }
    }

    #[test]
    fn a_tag_is_read_however_it_lies_and_its_first_corner_is_its_own() {
        // Tag 7 at 5 pixels a cell on white, turned by k quarters.
        for k in 0..4 {
            let cell = |row: usize, column: usize| {
                let inner = 1..=6;
                inner.contains(&row)
                    && inner.contains(&column)
                    && TAG36H11[7] >> (35 - ((row - 1) * 6 + column - 1)) & 1 == 1
            };
            let picture = Plane::from_fn(80, 80, |x, y| {
                // Turned by k quarters with the clock.
                let (mut x, mut y) = (x as i32 - 20, y as i32 - 20);
                for _ in 0..k {
                    (x, y) = (y, 39 - x);
                }
                let inside = (0..40).contains(&x) && (0..40).contains(&y);
                let white = !inside || cell(y as usize / 5, x as usize / 5);
                if white { 0.9 } else { 0.1 }
            });
            let found = find(&picture);
            assert_eq!(found.len(), 1, "turn {k}");
            assert_eq!(found[0].id, 7);
            let corners = [(19.5, 19.5), (59.5, 19.5), (59.5, 59.5), (19.5, 59.5)];
            for (place, corner) in found[0].corners.iter().enumerate() {
                let (x, y) = corners[(place + k) % 4];
                assert!(
                    corner.distance(DVec2::new(x, y)) < 0.5,
                    "turn {k}: {corner}"
                );
            }
        }
    }
}
