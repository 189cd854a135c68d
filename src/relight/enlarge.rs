//! From the working grid back to the photograph's own size.
//!
//! Relit light is carried up as a ratio to the flash photograph, so that the photograph's own
//! detail survives; the ratio is smooth wherever the relit picture differs from the photograph
//! only by lamp and shadow (quotient images: Shashua & Riklin-Raviv 2001). Between the four nearest
//! ratios those of pixels that look like the photograph's count most, so that edges of things stay as
//! sharp as they are there (joint bilateral upsampling: Kopf et al. 2007).

use super::prepared::Relit;
use crate::radiometry::LinearImage;
use drivers::Plane;
use glam::Vec3;
use rayon::prelude::*;

/// A sample that can be mixed with others.
pub trait Mix: Copy + Send + Sync {
    /// Adds nothing to a sum.
    const NOTHING: Self;
    /// Stands for "unknown".
    const UNKNOWN: Self;
    /// True when it takes part in mixing.
    fn is_known(&self) -> bool;
    /// `self + weight · sample`.
    #[must_use]
    fn plus(self, weight: f32, sample: Self) -> Self;
    /// The mean, of a sum over weights that add up to `weight`, which is positive.
    #[must_use]
    fn over(self, weight: f32) -> Self;
}

impl Mix for f32 {
    const NOTHING: Self = 0.0;
    const UNKNOWN: Self = f32::NAN;
    fn is_known(&self) -> bool {
        !self.is_nan()
    }
    fn plus(self, weight: f32, sample: Self) -> Self {
        weight * sample + self
    }
    fn over(self, weight: f32) -> Self {
        self / weight
    }
}

impl Mix for [f32; 3] {
    const NOTHING: Self = [0.0; 3];
    const UNKNOWN: Self = [f32::NAN; 3];
    fn is_known(&self) -> bool {
        !self[0].is_nan()
    }
    fn plus(self, weight: f32, sample: Self) -> Self {
        std::array::from_fn(|c| weight * sample[c] + self[c])
    }
    fn over(self, weight: f32) -> Self {
        self.map(|sum| sum / weight)
    }
}

impl Mix for Vec3 {
    const NOTHING: Self = Vec3::ZERO;
    const UNKNOWN: Self = Vec3::NAN;
    fn is_known(&self) -> bool {
        !self.x.is_nan()
    }
    fn plus(self, weight: f32, sample: Self) -> Self {
        weight * sample + self
    }
    /// Directions: the mean is brought back to unit length.
    fn over(self, _weight: f32) -> Self {
        self.normalize_or_zero()
    }
}

/// Bilinear places of a larger grid on a smaller one along one axis: (first, second, fraction).
fn places(small: usize, large: usize) -> Vec<(usize, usize, f32)> {
    let scale = small as f32 / large as f32;
    (0..large)
        .map(|index| {
            let at = ((index as f32 + 0.5) * scale - 0.5).clamp(0.0, (small - 1) as f32);
            let first = at as usize;
            (first, (first + 1).min(small - 1), at - first as f32)
        })
        .collect()
}

fn at<T: Mix>(
    plane: &Plane<T>,
    (x0, x1, fx): (usize, usize, f32),
    (y0, y1, fy): (usize, usize, f32),
) -> T {
    let corners = [
        ((1.0 - fx) * (1.0 - fy), plane[(x0, y0)]),
        (fx * (1.0 - fy), plane[(x1, y0)]),
        ((1.0 - fx) * fy, plane[(x0, y1)]),
        (fx * fy, plane[(x1, y1)]),
    ];
    let (mut sum, mut total) = (T::NOTHING, 0.0);
    for (weight, sample) in corners {
        if sample.is_known() {
            sum = sum.plus(weight, sample);
            total += weight;
        }
    }
    // The nearest corner decides whether there is an answer at all.
    if total < 0.5 {
        return T::UNKNOWN;
    }
    sum.over(total)
}

/// A plane on a larger grid of the same picture; unknown stays unknown.
///
/// # Panics
/// When `plane` is empty: a bug of the caller.
pub fn enlarge<T: Mix>(plane: &Plane<T>, width: usize, height: usize) -> Plane<T> {
    let (columns, rows) = (places(plane.width(), width), places(plane.height(), height));
    let mut samples = vec![T::UNKNOWN; width * height];
    samples
        .par_chunks_mut(width.max(1))
        .zip(rows.par_iter())
        .for_each(|(out, &row)| {
            for (out, &column) in out.iter_mut().zip(&columns) {
                *out = at(plane, column, row);
            }
        });
    Plane::new(width, height, samples).expect("one sample per pixel")
}

/// Rows of a larger grid, one at a time, from channels whose samples are all known; bilinear as [`enlarge`].
#[derive(Debug)]
pub struct Stretch {
    columns: Vec<(usize, usize, f32)>,
    rows: Vec<(usize, usize, f32)>,
    width: usize,
}

impl Stretch {
    /// From channels of a `small` grid to a `large` one.
    pub fn new(small: (usize, usize), large: (usize, usize)) -> Self {
        Self {
            columns: places(small.0, large.0),
            rows: places(small.1, large.1),
            width: small.0,
        }
    }

    /// Row `y` of the larger grid of `channel`; `between` is scratch.
    pub fn row(&self, channel: &[f32], y: usize, between: &mut Vec<f32>, out: &mut [f32]) {
        let (first, second, fy) = self.rows[y];
        let [upper, lower] = [first, second].map(|row| &channel[row * self.width..][..self.width]);
        between.clear();
        between.extend(
            upper
                .iter()
                .zip(lower)
                .map(|(upper, lower)| upper + fy * (lower - upper)),
        );
        for (out, &(first, second, fx)) in out.iter_mut().zip(&self.columns) {
            let (left, right) = (between[first], between[second]);
            *out = left + fx * (right - left);
        }
    }
}

/// The part of the flash light's median below which a ratio to it means nothing.
const FLOOR_SHARE: f32 = 0.05;

/// How much unlike light counts against likeness, of the squared relative difference: of truth's own relit
/// pictures at half to a quarter of their size the error at edges falls by a third, as it does with a
/// Gaussian of the difference of logarithms, which takes longer.
const UNLIKE: f32 = 200.0;
/// What the most unlike neighbour still weighs, so that something weighs where all are unlike.
const LEAST_LIKE: f32 = 1e-3;

/// A relit picture on the small grid, ready to be mixed.
struct Small {
    /// The photograph's light, never quite dark.
    guide: Vec<[f32; 3]>,
    /// Relit light over `guide`, and the shadow; 0 where either is unknown.
    relit: Vec<[f32; 4]>,
    /// 1 where both are known, else 0.
    known: Vec<f32>,
}

impl Small {
    fn of(relit: &Relit, guide: Vec<[f32; 3]>) -> Self {
        let samples = relit.light.0.samples().par_iter();
        let samples = samples.zip(relit.shadow.samples()).zip(&guide);
        let (mixed, known) = samples
            .map(|((light, shadow), guide)| {
                let [red, green, blue] = std::array::from_fn(|c| light[c] / guide[c]);
                if [red, green, blue].is_known() && shadow.is_known() {
                    ([red, green, blue, *shadow], 1.0)
                } else {
                    ([0.0; 4], 0.0)
                }
            })
            .unzip();
        Self {
            guide,
            relit: mixed,
            known,
        }
    }

    /// The mean of four neighbours, as the photograph's pixel `flash` weighs them: bilinearly, and by how alike they look.
    /// `None` where the nearest is unknown.
    #[inline(always)]
    fn mixed(&self, weights: [f32; 4], places: [usize; 4], flash: [f32; 3]) -> Option<[f32; 4]> {
        // Four at a time throughout, which compilers make vectors of.
        let plain: [f32; 4] = std::array::from_fn(|k| weights[k] * self.known[places[k]]);
        if (plain[0] + plain[1]) + (plain[2] + plain[3]) < 0.5 {
            return None;
        }
        let there = places.map(|place| self.guide[place]);
        let (mut apart, mut sum) = ([0.0f32; 4], [0.0f32; 4]);
        for (c, here) in flash.into_iter().enumerate() {
            for k in 0..4 {
                let (less, more) = (there[k][c] - here, there[k][c] + here);
                apart[k] += less * less;
                sum[k] += more * more;
            }
        }
        let like: [f32; 4] =
            std::array::from_fn(|k| sum[k] / (sum[k] + UNLIKE * apart[k]) + LEAST_LIKE);
        // What is not known to be alike weighs as the most unlike.
        let weights: [f32; 4] = std::array::from_fn(|k| {
            plain[k]
                * if like[k].is_nan() {
                    LEAST_LIKE
                } else {
                    like[k]
                }
        });
        let per_weight = 1.0 / ((weights[0] + weights[1]) + (weights[2] + weights[3]));
        let mut mean = [0.0f32; 4];
        for (weight, place) in weights.into_iter().zip(places) {
            let relit = self.relit[place];
            mean = std::array::from_fn(|c| mean[c] + weight * per_weight * relit[c]);
        }
        Some(mean)
    }
}

/// A relit picture at the size of the photograph.
///
/// `small` is the flash-only light on the grid of `relit`, `full` the photograph's own.
/// Where the flash light is unknown the relit picture is enlarged plainly.
pub fn enlarge_relit(relit: &Relit, small: &LinearImage, full: &LinearImage) -> Relit {
    let (width, height) = full.0.size();
    let floor = FLOOR_SHARE * median_level(small);
    let lifted = |flash: &[f32; 3]| flash.map(|channel| channel.max(0.0) + floor);
    let guide = small.0.samples().par_iter().map(lifted).collect();
    let mixable = Small::of(relit, guide);
    let columns = places(small.0.width(), width);
    let rows = places(small.0.height(), height);
    let mut light = Plane::filled(width, height, [f32::NAN; 3]);
    let mut shadow = Plane::filled(width, height, f32::NAN);
    let lines = light.samples_mut().par_chunks_mut(width.max(1));
    let lines = lines.zip(shadow.samples_mut().par_chunks_mut(width.max(1)));
    let lines = lines.zip(full.0.samples().par_chunks(width.max(1)));
    lines
        .zip(rows.par_iter())
        .for_each(|(((light, shadow), flash), &row)| {
            let starts = [row.0 * small.0.width(), row.1 * small.0.width()];
            let pixels = light.iter_mut().zip(shadow).zip(flash).zip(&columns);
            for (((light, shadow), flash), &column) in pixels {
                let (fx, fy) = (column.2, row.2);
                let weights = [
                    (1.0 - fx) * (1.0 - fy),
                    fx * (1.0 - fy),
                    (1.0 - fx) * fy,
                    fx * fy,
                ];
                let places = [
                    starts[0] + column.0,
                    starts[0] + column.1,
                    starts[1] + column.0,
                    starts[1] + column.1,
                ];
                let lit = lifted(flash);
                let mixed = flash
                    .is_known()
                    .then(|| mixable.mixed(weights, places, lit))
                    .flatten();
                let Some([red, green, blue, share]) = mixed else {
                    *light = at(&relit.light.0, column, row);
                    *shadow = at(&relit.shadow, column, row);
                    continue;
                };
                *light = [red * lit[0], green * lit[1], blue * lit[2]];
                *shadow = share;
            }
        });
    Relit {
        light: LinearImage(light),
        shadow,
        unseen_path_fraction: relit.unseen_path_fraction,
    }
}

/// Median of the green channel over a sparse set of pixels; a tiny positive number for a black
/// picture.
fn median_level(light: &LinearImage) -> f32 {
    let step = (light.0.len() / 10_000).max(1);
    let mut levels: Vec<f32> = light
        .0
        .samples()
        .iter()
        .step_by(step)
        .map(|pixel| pixel[1])
        .filter(|level| level.is_finite())
        .collect();
    if levels.is_empty() {
        return 1.0;
    }
    let middle = levels.len() / 2;
    levels
        .select_nth_unstable_by(middle, f32::total_cmp)
        .1
        .max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_and_a_hole_stays_a_hole() {
        let mut ramp = Plane::from_fn(8, 4, |x, _| x as f32);
        ramp[(6, 2)] = f32::NAN;
        let large = enlarge(&ramp, 32, 16);
        assert!((large[(13, 3)] - ((13.5 / 4.0) - 0.5)).abs() < 1e-5);
        assert!(large[(26, 10)].is_nan());
        assert!(large[(16, 10)].is_finite());
    }

    #[test]
    fn rows_that_are_stretched_one_at_a_time_are_those_of_the_whole() {
        let small = Plane::from_fn(7, 5, |x, y| ((3 * x + 5 * y * y) % 11) as f32);
        for size in [(7, 5), (29, 13), (70, 50)] {
            let whole = enlarge(&small, size.0, size.1);
            let stretch = Stretch::new(small.size(), size);
            let (mut between, mut row) = (Vec::new(), vec![0.0; size.0]);
            for y in 0..size.1 {
                stretch.row(small.samples(), y, &mut between, &mut row);
                for (found, expected) in row.iter().zip(whole.row(y)) {
                    assert!((found - expected).abs() < 1e-5, "{size:?}");
                }
            }
        }
    }

    #[test]
    fn detail_of_the_photograph_survives_being_relit() {
        // Fine texture that the working grid averages away, under a lamp half as bright.
        let full = LinearImage(Plane::from_fn(16, 16, |x, y| {
            [if (x + y) % 2 == 0 { 0.2 } else { 0.6 }; 3]
        }));
        let small = LinearImage(Plane::filled(4, 4, [0.4; 3]));
        let relit = Relit {
            light: LinearImage(Plane::filled(4, 4, [0.2; 3])),
            shadow: Plane::filled(4, 4, 1.0),
            unseen_path_fraction: 0.0,
        };
        let large = enlarge_relit(&relit, &small, &full);
        for (relit, flash) in large.light.0.samples().iter().zip(full.0.samples()) {
            assert!((relit[0] - 0.5 * flash[0]).abs() < 0.02);
        }
    }

    #[test]
    fn an_edge_of_the_photograph_stays_as_sharp_when_it_is_relit() {
        // A dark thing before a bright wall; the lamp lights the thing twice as much, the wall half as much.
        let side = |x: usize| if x < 22 { 0.1 } else { 0.8 };
        let relit_side = |x: usize| if x < 22 { 0.2 } else { 0.4 };
        let full = LinearImage(Plane::from_fn(64, 8, |x, _| [side(x); 3]));
        let means = |of: &(dyn Fn(usize) -> f32 + Sync)| {
            Plane::from_fn(16, 2, |x, _| {
                [(4 * x..4 * x + 4).map(of).sum::<f32>() / 4.0; 3]
            })
        };
        let relit = Relit {
            light: LinearImage(means(&relit_side)),
            shadow: Plane::from_fn(16, 2, |x, _| if x < 5 { 0.0 } else { 1.0 }),
            unseen_path_fraction: 0.0,
        };
        let large = enlarge_relit(&relit, &LinearImage(means(&side)), &full);
        for x in (4..20).chain(24..60) {
            let found = large.light.0[(x, 4)][0];
            assert!((found / relit_side(x) - 1.0).abs() < 0.12, "{x}: {found}");
        }
    }
}
