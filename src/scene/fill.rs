//! What stands around a pixel: weighted means over as small a neighbourhood as has evidence.

use drivers::Plane;
use rayon::prelude::*;

/// Weighted sums of a color, and the weight.
type Cell = [f32; 4];

/// A local mean for every pixel: `values` averaged with `weights` over the smallest neighbourhood
/// whose weights sum to about `enough`; NaN only where no pixel of the image has weight.
///
/// Push–pull (Gortler et al. 1996): halve until one cell is left, then come back, each cell
/// keeping its own mean as far as its weight reaches. Values of zero weight may be NaN.
pub(super) fn local_mean(
    values: &Plane<[f32; 3]>,
    weights: &Plane<f32>,
    enough: f32,
) -> Plane<[f32; 3]> {
    let (width, height) = values.size();
    let mut base = Plane::filled(width, height, [0.0; 4]);
    base.samples_mut()
        .par_iter_mut()
        .zip(values.samples())
        .zip(weights.samples())
        .for_each(|((cell, value), &weight)| {
            if weight > 0.0 {
                *cell = [
                    value[0] * weight,
                    value[1] * weight,
                    value[2] * weight,
                    weight,
                ];
            }
        });
    let mut levels = vec![base];
    while let Some(last) = levels.last()
        && (last.width() > 1 || last.height() > 1)
    {
        levels.push(halved(last));
    }
    let mut mean = levels.pop().map_or_else(
        || Plane::filled(0, 0, [0.0; 3]),
        |top| top.map(|&[r, g, b, w]| [r / w, g / w, b / w]),
    );
    for level in levels.iter().rev() {
        mean = pulled(level, &mean, enough);
    }
    mean
}

/// Sums of 2×2 cells.
fn halved(fine: &Plane<Cell>) -> Plane<Cell> {
    let (width, height) = (fine.width().div_ceil(2), fine.height().div_ceil(2));
    let mut coarse = Plane::filled(width, height, [0.0; 4]);
    coarse
        .samples_mut()
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, cell) in row.iter_mut().enumerate() {
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    if let Some(part) = fine.get(2 * x + dx, 2 * y + dy) {
                        for (sum, part) in cell.iter_mut().zip(part) {
                            *sum += part;
                        }
                    }
                }
            }
        });
    coarse
}

/// Each fine cell's own mean, leaning on the coarse mean around it for what it lacks in weight.
fn pulled(fine: &Plane<Cell>, coarse: &Plane<[f32; 3]>, enough: f32) -> Plane<[f32; 3]> {
    let (width, height) = fine.size();
    let mut mean = Plane::filled(width, height, [0.0; 3]);
    mean.samples_mut()
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            // A fine centre lies a quarter cell from its own coarse centre: weights 3/4 and 1/4.
            let (y0, y1) = (y / 2, neighbour(y, coarse.height()));
            for (x, out) in row.iter_mut().enumerate() {
                let (x0, x1) = (x / 2, neighbour(x, coarse.width()));
                let [r, g, b, weight] = fine[(x, y)];
                let lack = (enough - weight).max(0.0) / enough;
                let corners = [
                    (x0, y0, 0.5625),
                    (x1, y0, 0.1875),
                    (x0, y1, 0.1875),
                    (x1, y1, 0.0625),
                ];
                let mut around = [0.0f32; 3];
                for (cx, cy, part) in corners {
                    for (sum, value) in around.iter_mut().zip(coarse[(cx, cy)]) {
                        *sum += part * value;
                    }
                }
                let total = weight + lack * enough;
                *out = std::array::from_fn(|i| ([r, g, b][i] + lack * enough * around[i]) / total);
            }
        });
    mean
}

/// The other coarse cell that a fine cell leans on.
fn neighbour(fine: usize, count: usize) -> usize {
    if fine.is_multiple_of(2) {
        (fine / 2).saturating_sub(1)
    } else {
        (fine / 2 + 1).min(count - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_takes_the_value_around_it_and_evidence_keeps_its_own() {
        let values = Plane::from_fn(33, 17, |x, y| {
            if (x, y) == (16, 8) {
                [f32::NAN; 3]
            } else if x < 20 {
                [0.2; 3]
            } else {
                [0.8; 3]
            }
        });
        let weights = values.map(|v| if v[0].is_nan() { 0.0 } else { 1.0 });
        let mean = local_mean(&values, &weights, 1.0);
        assert!((mean[(16, 8)][0] - 0.2).abs() < 0.06, "{:?}", mean[(16, 8)]);
        assert!((mean[(30, 3)][1] - 0.8).abs() < 1e-5);
        assert!((mean[(2, 12)][2] - 0.2).abs() < 1e-5);
    }

    #[test]
    fn nothing_known_is_nothing_told() {
        let mean = local_mean(
            &Plane::filled(5, 4, [1.0; 3]),
            &Plane::filled(5, 4, 0.0),
            1.0,
        );
        assert!(mean.samples().iter().all(|m| m[0].is_nan()));
        assert!(
            local_mean(
                &Plane::filled(0, 0, [1.0; 3]),
                &Plane::filled(0, 0, 0.0),
                1.0
            )
            .is_empty()
        );
    }
}
