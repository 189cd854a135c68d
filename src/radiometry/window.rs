//! The window around one patch, as seen through a warp.

use super::warp::{Warp, keys};
use drivers::Plane;
use fearless_simd::{Level, Simd, dispatch, f32x4, prelude::*};

/// Pixels along the side of a patch.
pub(super) const SIDE: usize = 32;
/// Side of the sampled window: the patch and one pixel around it for gradients.
pub(super) const WINDOW: usize = SIDE + 2;

/// Bend of a warp across a window that is let go, pixels at its corners: the middle lies right, and what
/// is added on one side is missing on the other.
const BEND: f64 = 0.1;

/// The window around a patch as seen through `warp` moved on by `off`; the warp is taken as
/// straight across a patch, and where it hardly bends there, as a shift. `None` when it is not all inside.
pub(super) fn sample(
    plane: &Plane<f32>,
    warp: &Warp,
    left: usize,
    top: usize,
    off: [f64; 2],
) -> Option<[f32; WINDOW * WINDOW]> {
    let (width, height) = plane.size();
    let origin = [left as f64 - 1.0, top as f64 - 1.0];
    let at = |x: f64, y: f64| warp.displacement(origin[0] + x, origin[1] + y);
    let span = (WINDOW - 1) as f64;
    let (start, right, down) = (at(0.0, 0.0), at(span, 0.0), at(0.0, span));
    let across = [(right[0] - start[0]) / span, (right[1] - start[1]) / span];
    let along = [(down[0] - start[0]) / span, (down[1] - start[1]) / span];
    let place = |u: f64, v: f64| {
        [
            origin[0] + u + start[0] + off[0] + across[0] * u + along[0] * v,
            origin[1] + v + start[1] + off[1] + across[1] * u + along[1] * v,
        ]
    };
    // A straight warp is outermost in the corners; a hair of the margin is left to rounding.
    let inside = |[x, y]: [f64; 2]| {
        x >= 1.0 && y >= 1.0 && x < width as f64 - 2.0 - 1e-9 && y < height as f64 - 2.0 - 1e-9
    };
    if ![(0.0, 0.0), (span, 0.0), (0.0, span), (span, span)]
        .iter()
        .all(|&(u, v)| inside(place(u, v)))
    {
        return None;
    }
    let mut window = [0.0; WINDOW * WINDOW];
    let bend = [across, along]
        .as_flattened()
        .iter()
        .map(|b| b.abs())
        .sum::<f64>();
    if bend * span / 2.0 < BEND {
        let middle = place(span / 2.0, span / 2.0).map(|at| at - span / 2.0);
        dispatch!(Level::new(), simd => shifted(simd, plane.samples(), width, middle, &mut window));
        return Some(window);
    }
    let step = [[1.0 + across[0], across[1]], [along[0], 1.0 + along[1]]];
    dispatch!(Level::new(), simd => {
        interpolate(simd, plane.samples(), width, place(0.0, 0.0), step, &mut window);
    });
    Some(window)
}

/// Samples of a row that a shifted window is made of.
const TAPS: usize = WINDOW + 3;

/// Cubic interpolation at `start` and on by whole pixels: all pixels have the same weights.
#[inline(always)]
fn shifted<S: Simd>(
    _simd: S,
    samples: &[f32],
    width: usize,
    start: [f64; 2],
    window: &mut [f32; WINDOW * WINDOW],
) {
    let (left, top) = ((start[0] as usize).max(1), (start[1] as usize).max(1));
    let across = keys((start[0] - left as f64) as f32);
    let down = keys((start[1] - top as f64) as f32);
    for (y, window) in window.chunks_exact_mut(WINDOW).enumerate() {
        let taps = |row: usize| &samples[(top - 1 + y + row) * width + left - 1..][..TAPS];
        let (first, second, third, fourth) = (taps(0), taps(1), taps(2), taps(3));
        let mut columns = [0.0f32; TAPS];
        for (x, column) in columns.iter_mut().enumerate() {
            let outer = first[x] * down[0] + fourth[x] * down[3];
            *column = second[x] * down[1] + third[x] * down[2] + outer;
        }
        for (x, value) in window.iter_mut().enumerate() {
            let outer = columns[x] * across[0] + columns[x + 3] * across[3];
            *value = columns[x + 1] * across[1] + columns[x + 2] * across[2] + outer;
        }
    }
}

/// Cubic interpolation at `start` and on by `step[0]` a column and `step[1]` a row; every place is
/// at least one sample inside on the left and above, two on the right and below.
#[inline(always)]
fn interpolate<S: Simd>(
    simd: S,
    samples: &[f32],
    width: usize,
    start: [f64; 2],
    step: [[f64; 2]; 2],
    window: &mut [f32; WINDOW * WINDOW],
) {
    let mut row = 0.0;
    for window in window.chunks_exact_mut(WINDOW) {
        let [left, top] = [start[0] + step[1][0] * row, start[1] + step[1][1] * row];
        row += 1.0;
        let mut column = 0.0;
        for value in window {
            let (x, y) = (left + step[0][0] * column, top + step[0][1] * column);
            column += 1.0;
            let (ix, iy) = ((x as usize).max(1), (y as usize).max(1));
            let across = weights(simd, (x - ix as f64) as f32);
            let [first, second, third, fourth] = *weights(simd, (y - iy as f64) as f32);
            // First down, then across: four columns at a time.
            let taps = &samples[(iy - 1) * width + ix - 1..];
            let taps = |row: usize| f32x4::from_slice(simd, &taps[row * width..][..4]);
            let columns = taps(0) * first;
            let columns = taps(1).mul_add(second, columns);
            let columns = taps(2).mul_add(third, columns);
            let columns = taps(3).mul_add(fourth, columns);
            let [a, b, c, d] = *(columns * across);
            *value = (a + b) + (c + d);
        }
    }
}

/// Weights of the four samples around a position `t` of the way from the second to the third, as
/// [`super::warp::keys`] has them.
#[inline(always)]
fn weights<S: Simd>(simd: S, t: f32) -> f32x4<S> {
    let of = |coefficients: [f32; 4]| f32x4::load_array(simd, coefficients);
    of([-0.5, 1.5, -1.5, 0.5])
        .mul_add(t, of([1.0, -2.5, 2.0, -0.5]))
        .mul_add(t, of([-0.5, 0.0, 0.5, 0.0]))
        .mul_add(t, of([0.0, 1.0, 0.0, 0.0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warp_that_hardly_bends_is_sampled_as_one_that_does() {
        let plane = Plane::from_fn(64, 60, |x, y| {
            (x as f32 * 0.3).sin() + (y as f32 * 0.2).cos()
        });
        let seen = |bend: f64| {
            let warp = Warp::new(64, 60, [0.7, bend, 0.0, -1.3, 0.0, 0.0, 0.0, 0.0]);
            sample(&plane, &warp, 12, 10, [0.2, 0.1]).unwrap()
        };
        // Under and over BEND, a hundredth of a pixel apart.
        let (shifted, bent) = (seen(0.18), seen(0.2));
        for (shifted, bent) in shifted.iter().zip(&bent) {
            assert!((shifted - bent).abs() < 0.05, "{shifted} {bent}");
        }
        let exact = dispatch!(Level::new(), simd => {
            let mut window = [0.0; WINDOW * WINDOW];
            interpolate(simd, plane.samples(), 64, [11.9, 7.8], [[1.0, 0.0], [0.0, 1.0]], &mut window);
            window
        });
        let still = Warp::new(64, 60, [0.7, 0.0, 0.0, -1.3, 0.0, 0.0, 0.0, 0.0]);
        for (shifted, exact) in sample(&plane, &still, 12, 10, [0.2, 0.1])
            .unwrap()
            .iter()
            .zip(&exact)
        {
            assert!((shifted - exact).abs() < 1e-5, "{shifted} {exact}");
        }
    }

    #[test]
    fn weights_are_those_that_frames_are_resampled_with() {
        for step in 0..=64 {
            let t = step as f32 / 64.0;
            let found = dispatch!(Level::new(), simd => *weights(simd, t));
            for (found, expected) in found.iter().zip(super::super::warp::keys(t)) {
                assert!((found - expected).abs() < 1e-6, "{t}");
            }
        }
    }
}
