//! Random fields that vary smoothly over a picture, and what parts off a share of it.

use drivers::{Plane, chance::Chance};

/// A smooth random field in [0, 1]: values on a lattice `cell_pixels` apart, smoothly between, and
/// half as much again of one twice as fine.
pub(super) fn field(size: (usize, usize), cell_pixels: f32, chance: Chance) -> Plane<f32> {
    let coarse = chance.of(1);
    let fine = chance.of(2);
    Plane::from_fn(size.0, size.1, |x, y| {
        let (x, y) = (x as f32 / cell_pixels, y as f32 / cell_pixels);
        (2.0 * octave(coarse, x, y) + octave(fine, 2.0 * x, 2.0 * y)) / 3.0
    })
}

fn octave(chance: Chance, x: f32, y: f32) -> f32 {
    let (column, row) = (x.floor(), y.floor());
    let node = |dx: u64, dy: u64| chance.of(row as u64 + dy).unit(column as u64 + dx) as f32;
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (across, down) = (smooth(x - column), smooth(y - row));
    let between = |a: f32, b: f32, t: f32| a + (b - a) * t;
    between(
        between(node(0, 0), node(1, 0), across),
        between(node(0, 1), node(1, 1), across),
        down,
    )
}

/// The value that `percent` of the finite values reach or exceed; `None` where there are none.
pub(super) fn upper(values: impl Iterator<Item = f32>, percent: f32) -> Option<f32> {
    let mut values: Vec<f32> = values.filter(|value| value.is_finite()).collect();
    let most = values.len().checked_sub(1)?;
    let above = (values.len() as f32 * percent / 100.0).round() as usize;
    let place = values.len().saturating_sub(above).min(most);
    Some(*values.select_nth_unstable_by(place, f32::total_cmp).1)
}

/// Patches about `cell_pixels` wide over `percent` of the known samples of a plane.
pub(super) fn patches(
    plane: &Plane<f32>,
    percent: f32,
    cell_pixels: f32,
    chance: Chance,
) -> Plane<bool> {
    let field = field(plane.size(), cell_pixels, chance);
    let known = field.samples().iter().zip(plane.samples());
    let known = known.filter_map(|(value, sample)| sample.is_finite().then_some(*value));
    let least = upper(known, percent).unwrap_or(f32::INFINITY);
    field.map(|value| *value >= least)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_upper_part_is_as_large_as_asked_for() {
        let plane = field((200, 150), 12.0, Chance::new(3));
        for percent in [2.0, 20.0, 50.0] {
            let least = upper(plane.samples().iter().copied(), percent).unwrap();
            let count = plane
                .samples()
                .iter()
                .filter(|value| **value >= least)
                .count();
            let found = 100.0 * count as f32 / plane.len() as f32;
            // The field has no two equal values that matter: one sample in 30 000.
            assert!((found - percent).abs() < 0.01, "{found} %, not {percent} %");
        }
        assert_eq!(upper([f32::NAN].into_iter(), 10.0), None);
    }
}
