//! Answers on a coarser working grid, brought to the grid of the truth.

use drivers::Plane;
use glam::Vec3;
use std::borrow::Cow;

/// A sample that can be blended with its neighbour.
pub(super) trait Sample: Copy {
    /// `self · (1 − share) + other · share`, with share in (0, 1); unknown when either is.
    fn blend(self, other: Self, share: f32) -> Self;
}

impl Sample for f32 {
    fn blend(self, other: Self, share: f32) -> Self {
        self + (other - self) * share
    }
}

impl Sample for [f32; 3] {
    fn blend(self, other: Self, share: f32) -> Self {
        std::array::from_fn(|channel| self[channel].blend(other[channel], share))
    }
}

impl Sample for Vec3 {
    fn blend(self, other: Self, share: f32) -> Self {
        self.lerp(other, share)
    }
}

/// The plane on a grid of another size over the same picture, bilinear between pixel centres;
/// itself when it lies there already, empty when it has no pixel.
pub(super) fn stretched<T: Sample + Send + Sync>(
    plane: &Plane<T>,
    size: (usize, usize),
) -> Cow<'_, Plane<T>>
where
    Plane<T>: Clone,
{
    if plane.size() == size || plane.is_empty() {
        return Cow::Borrowed(plane);
    }
    let axis = |target: usize, source: usize, index: usize| {
        let at = (index as f32 + 0.5) * source as f32 / target as f32 - 0.5;
        let at = at.clamp(0.0, (source - 1) as f32);
        let below = at as usize;
        (below, (below + 1).min(source - 1), at - below as f32)
    };
    let mix = |low: T, high: T, share: f32| {
        // A neighbour without weight must not spoil the answer by being unknown.
        if share > 0.0 {
            low.blend(high, share)
        } else {
            low
        }
    };
    Cow::Owned(Plane::from_fn(size.0, size.1, |x, y| {
        let (left, right, across) = axis(size.0, plane.width(), x);
        let (upper, lower, down) = axis(size.1, plane.height(), y);
        let above = mix(plane[(left, upper)], plane[(right, upper)], across);
        if down > 0.0 {
            above.blend(
                mix(plane[(left, lower)], plane[(right, lower)], across),
                down,
            )
        } else {
            above
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_on_a_finer_grid() {
        let coarse = Plane::from_fn(8, 6, |x, y| x as f32 + 10.0 * y as f32);
        let fine = stretched(&coarse, (16, 12));
        // Pixel (5, 7) of the fine grid is centred at (2.25, 3.25) of the coarse one.
        assert!((fine[(5, 7)] - (2.25 + 32.5)).abs() < 1e-4);
    }

    #[test]
    fn an_unknown_pixel_does_not_reach_neighbours_it_has_no_weight_in() {
        let mut plane = Plane::filled(3, 3, 1.0_f32);
        plane[(1, 1)] = f32::NAN;
        let same_width = stretched(&plane, (3, 6));
        assert!(same_width[(0, 2)] == 1.0 && same_width[(2, 3)] == 1.0);
        assert!(same_width[(1, 2)].is_nan());
    }
}
