//! The inner corners of a board in a picture: tags say which, saddle points say where.

use super::{board::Board, homography, sampling::sample, tags};
use drivers::Plane;
use glam::{DMat3, DVec2};

/// One inner corner of the board and where a picture shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Which, as [`Board::corner`] counts.
    pub id: usize,
    /// Where; the centre of the top left pixel is (0, 0).
    pub pixel: DVec2,
}

/// Width under which a picture is enlarged for the tag detector, which wants two or three pixels for
/// each cell of a tag; ToF cameras seldom give them.
const WIDE: usize = 960;
/// Most times enlarged.
const ENLARGED: usize = 3;
/// How far from where a tag foretells it its neighbour may be, in diagonals of a tag: a lens may bend
/// the board, but not by this.
const OFF: f64 = 0.3;
/// Reach of the search for a saddle point, as a share of a square's side in the picture, and its limits
/// in pixels.
const REACH: f64 = 0.22;
const REACH_PIXELS: (f64, f64) = (2.0, 8.0);

/// Finds the corners of `board` in a picture of any unit; NaN = unknown. Without two neighbouring tags
/// there are none.
pub fn find_corners(picture: &Plane<f32>, board: &Board) -> Vec<Corner> {
    let (width, height) = picture.size();
    if width < 16 || height < 16 {
        return Vec::new();
    }
    let gray = evened(picture);
    let mut guesses: Vec<Vec<(DVec2, f64)>> = vec![Vec::new(); board.corner_count()];
    for (square, map) in agreeing(&gray, board) {
        for corner in board.corners_around(square) {
            let place = board.corner(corner).truncate();
            let seen = homography::apply(&map, place);
            // Towards the middle of the square: how large it is in the picture.
            let side = (place - board.middle_of(square)).signum() * board.square_metres();
            let across = seen.distance(homography::apply(&map, place - side.with_y(0.0)));
            let down = seen.distance(homography::apply(&map, place - side.with_x(0.0)));
            guesses[corner].push((seen, across.min(down)));
        }
    }
    let mut found = Vec::new();
    for (id, guesses) in guesses.iter().enumerate() {
        let count = guesses.len() as f64;
        if guesses.is_empty() {
            continue;
        }
        let guess = guesses.iter().map(|guess| guess.0).sum::<DVec2>() / count;
        let side = guesses.iter().map(|guess| guess.1).sum::<f64>() / count;
        let reach = (REACH * side).clamp(REACH_PIXELS.0, REACH_PIXELS.1);
        if let Some(pixel) = saddle(&gray, guess, reach) {
            found.push(Corner { id, pixel });
        }
    }
    found
}

/// The picture between its darkest and its brightest per cent as 0 to 1, by a square root, which evens
/// out how light falls off.
fn evened(picture: &Plane<f32>) -> Plane<f32> {
    let step = (picture.len() / 40_000).max(1);
    let known = picture
        .samples()
        .iter()
        .step_by(step)
        .filter(|v| v.is_finite());
    let mut sorted: Vec<f32> = known.copied().collect();
    sorted.sort_by(f32::total_cmp);
    let at = |share: usize| sorted.get(sorted.len().saturating_sub(1) * share / 100);
    let (low, high) = (
        at(1).copied().unwrap_or(0.0),
        at(99).copied().unwrap_or(1.0),
    );
    let range = (high - low).max(f32::MIN_POSITIVE);
    // Unknown is mostly clipped: as bright as can be.
    picture.map(|v| {
        if v.is_nan() {
            1.0
        } else {
            ((v - low) / range).clamp(0.0, 1.0).sqrt()
        }
    })
}

/// Tags of this board whose neighbours lie where they foretell, with the maps from the board.
fn agreeing(gray: &Plane<f32>, board: &Board) -> Vec<((usize, usize), DMat3)> {
    let times = (WIDE / gray.width()).clamp(1, ENLARGED);
    let scale = times as f64;
    let found = if times == 1 {
        tags::find(gray)
    } else {
        let (width, height) = (gray.width() * times, gray.height() * times);
        tags::find(&Plane::from_fn(width, height, |x, y| {
            sample(gray, (DVec2::new(x as f64, y as f64) + 0.5) / scale - 0.5)
        }))
    };
    struct Placed {
        square: (usize, usize),
        map: DMat3,
        middle: DVec2,
        size: f64,
    }
    let place = |tag: &tags::Tag| {
        let on_board = board.tag_corners(tag.id)?;
        let seen = tag.corners.map(|corner| (corner + 0.5) / scale - 0.5);
        let pairs: Vec<_> = on_board.into_iter().zip(seen).collect();
        Some(Placed {
            square: board.square_of(tag.id)?,
            map: homography::homography(&pairs)?,
            middle: seen.iter().sum::<DVec2>() / 4.0,
            size: seen[0].distance(seen[2]),
        })
    };
    let placed: Vec<Placed> = found.iter().filter_map(place).collect();
    let agrees = |tag: &Placed| {
        placed.iter().any(|other| {
            let (columns, rows) = (
                tag.square.0.abs_diff(other.square.0),
                tag.square.1.abs_diff(other.square.1),
            );
            let near = (1..=2).contains(&columns.max(rows));
            let there = homography::apply(&tag.map, board.middle_of(other.square));
            near && there.distance(other.middle) < OFF * tag.size
        })
    };
    let kept = placed.iter().filter(|tag| agrees(tag));
    kept.map(|tag| (tag.square, tag.map)).collect()
}

/// The saddle point near `guess`, to a few hundredths of a pixel: the place at which every gradient
/// around is at right angles to the way there (Förstner & Gülch 1987).
fn saddle(gray: &Plane<f32>, guess: DVec2, reach: f64) -> Option<DVec2> {
    const ROUNDS: usize = 30;
    let steps = reach.ceil() as i32;
    let mut at = guess;
    for _ in 0..ROUNDS {
        let margin = reach + 2.0;
        let (width, height) = (gray.width() as f64, gray.height() as f64);
        let inside =
            at.x > margin && at.y > margin && at.x < width - margin && at.y < height - margin;
        if !inside {
            return None;
        }
        let (mut xx, mut xy, mut yy, mut right) = (0.0, 0.0, 0.0, DVec2::ZERO);
        for dy in -steps..=steps {
            for dx in -steps..=steps {
                let way = DVec2::new(f64::from(dx), f64::from(dy));
                // Fades out to the rim, so that pixels come and go gently as the place moves.
                let weight = (1.0 - way.length_squared() / (reach * reach + 1.0)).max(0.0);
                if weight == 0.0 {
                    continue;
                }
                let place = at + way;
                let gradient = DVec2::new(
                    f64::from(sample(gray, place + DVec2::X) - sample(gray, place - DVec2::X)),
                    f64::from(sample(gray, place + DVec2::Y) - sample(gray, place - DVec2::Y)),
                );
                let (gx, gy) = (gradient.x, gradient.y);
                xx += weight * gx * gx;
                xy += weight * gx * gy;
                yy += weight * gy * gy;
                right += weight * gradient * gradient.dot(way);
            }
        }
        let determinant = xx * yy - xy * xy;
        // An edge, or nothing at all: no corner holds the place in both directions.
        if determinant < 0.02 * (xx + yy) * (xx + yy) || xx + yy < 0.05 {
            return None;
        }
        let step =
            DVec2::new(yy * right.x - xy * right.y, xx * right.y - xy * right.x) / determinant;
        at += step;
        if at.distance(guess) > reach {
            return None;
        }
        if step.length() < 1e-3 {
            return Some(at);
        }
    }
    Some(at)
}
