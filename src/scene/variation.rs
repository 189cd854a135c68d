//! Depth under much noise: planes and gentle bends, parted where the photograph or the depth parts them.

mod descent;
mod level;

use super::smooth::{InverseDepth, MOST_DOUBT, Smoothed, median};
use descent::State;
use drivers::Plane;
use level::Level;
use rayon::prelude::*;

/// Price of a jump that the slope does not explain, in standard deviations of the noise of a pixel.
const JUMP_COST: f32 = 1.0;

/// Price of a bend over that of a jump is a length: this share of the picture's side. What is smaller is
/// worth no bend of its own.
const BEND_SHARE: f32 = 1.0 / 64.0;

/// How fast neighbours part where the photograph changes: per unit of the light's logarithm.
const PARTING: f32 = 2.5;

/// What is left of the bond between neighbours where the photograph shows any edge at all.
const LEAST_BOND: f32 = 0.05;

/// Light below this share of the mean is dark, and its changes no edges.
const DARK_SHARE: f32 = 0.02;

/// Weight left to pixels in which a camera that smooths has mixed two surfaces.
const MIXED_TRUST: f32 = 0.02;

/// Pixels of the shorter side from which on a picture is halved no more.
const COARSEST: usize = 32;

/// Steps at each resolution, and those after mixed pixels have been found.
const STEPS: usize = 90;
const LAST_STEPS: usize = 60;

/// What slopes do not explain across a ramp is a jump from so many standard deviations of a pixel's noise on.
const JUMP: f32 = 1.0;

/// Standard deviation of what is left of the noise, away from edges, as a share of it…
const LEFT_OF_VALUE: f32 = 0.06;
/// …and of the slope's, per pixel.
const LEFT_OF_SLOPE: f32 = 0.005;

/// The surface of least second-order total generalised variation (Bredies, Kunisch & Pock 2010) under
/// `value`, 1/z, weighted by the photograph (Ferstl et al. 2013).
///
/// Of all values u and slopes w it minimises ½ Σ ((u − value) / noise)² + jumps Σ g |∇u − w| + bends Σ
/// g |∇w|: where u is plane or bends gently it costs little, a jump costs by its height, and both cost less
/// where `light` changes between neighbours (g). `noise` is the standard deviation of 1/z that white noise
/// of the same strength over large areas would have at one pixel, `blur` how far the camera smoothed, in
/// pixels. NaN stays NaN.
pub(super) fn piecewise(
    value: &Plane<f32>,
    noise: &Plane<f32>,
    blur: f32,
    light: &Plane<[f32; 3]>,
) -> Smoothed {
    let (width, height) = value.size();
    let usual = median(noise);
    let noise = noise.map(|s| s.clamp(usual / MOST_DOUBT, usual * MOST_DOUBT));
    let bend_cost = JUMP_COST * BEND_SHARE * ((width * height) as f32).sqrt();
    let mut levels = vec![finest(value, &noise, usual, blur, light)];
    while let Some(fine) = levels.last()
        && fine.width.min(fine.height) >= 2 * COARSEST
    {
        levels.push(fine.halved());
    }
    let mut coarser: Option<(State, Level)> = None;
    for level in levels.into_iter().rev() {
        let mut state = match &coarser {
            None => State::new(&level),
            Some((state, from)) => state.finer(from, &level),
        };
        // A quarter of the pixels, each as noisy by half, and changes twice as large from one to the next.
        let share = level.width as f32 / width as f32;
        state.descend(&level, JUMP_COST * share, bend_cost * share * share, STEPS);
        coarser = Some((state, level));
    }
    let (mut state, mut level) = coarser.expect("there is always the picture itself");
    let reach = blur.round().max(1.0) as usize;
    let mixed = mixed(&state, &level, reach);
    for (trust, mixed) in level.trust.iter_mut().zip(mixed) {
        *trust *= if mixed { MIXED_TRUST } else { 1.0 };
    }
    state.descend(&level, JUMP_COST, bend_cost, LAST_STEPS);
    let known = |x: usize, y: usize, found: &dyn Fn(usize) -> f32| {
        let at = level.place(x, y);
        let known = level.trust[at] > 0.0;
        if known { usual * found(at) } else { f32::NAN }
    };
    let left = |share: f32| noise.map(|noise| (share * noise).powi(2));
    Smoothed {
        depth: InverseDepth {
            value: Plane::from_fn(width, height, |x, y| {
                // Nothing lies behind the camera, however much is guessed.
                known(x, y, &|at| state.value[at].max(1e-3 * level.measured[at]))
            }),
            variance: left(LEFT_OF_VALUE),
        },
        slope: Plane::from_fn(width, height, |x, y| {
            [0, 1].map(|axis| known(x, y, &|at| state.slope[axis][at]))
        }),
        slope_variance: left(LEFT_OF_SLOPE),
    }
}

/// The picture itself, in units of the `usual` noise.
fn finest(
    value: &Plane<f32>,
    noise: &Plane<f32>,
    usual: f32,
    blur: f32,
    light: &Plane<[f32; 3]>,
) -> Level {
    let (width, height) = value.size();
    let whole = whole(value, (2.0 * blur).round() as usize);
    let trust = Plane::from_fn(width, height, |x, y| {
        let believed = if whole[(x, y)] { 1.0 } else { MIXED_TRUST };
        believed * (usual / noise[(x, y)]).powi(2)
    });
    let logs = logarithms(light);
    Level::new(&value.map(|w| w / usual), &trust, |here, there| {
        let change = |c: usize| (logs[here][c] - logs[there][c]).abs();
        // `max` passes over NaN: unknown light parts as an edge does.
        (-PARTING * change(0).max(change(1)).max(change(2)))
            .exp()
            .max(LEAST_BOND)
    })
}

/// Pixels that no unknown one lies within `reach` of: what the camera smoothed them with was known.
fn whole(value: &Plane<f32>, reach: usize) -> Plane<bool> {
    let (width, height) = value.size();
    let along = |plane: &Plane<bool>, dx: usize, dy: usize| {
        Plane::from_fn(width, height, |x, y| {
            let columns = x.saturating_sub(dx * reach)..=(x + dx * reach).min(width - 1);
            let mut rows = y.saturating_sub(dy * reach)..=(y + dy * reach).min(height - 1);
            rows.all(|y| columns.clone().all(|x| plane[(x, y)]))
        })
    };
    let known = value.map(|w| !w.is_nan());
    along(&along(&known, 1, 0), 0, 1)
}

/// Pixels on the ramp that smoothing makes of a jump, which are of neither side.
fn mixed(state: &State, level: &Level, reach: usize) -> Vec<bool> {
    let mut mixed = vec![false; level.len()];
    for (axis, step) in [(0, 1), (1, level.stride())] {
        let slope = &state.slope[axis];
        let bonds = if axis == 0 {
            &level.right
        } else {
            &level.below
        };
        for y in 0..level.height {
            for x in 0..level.width {
                let (at, size) = if axis == 0 {
                    (x, level.width)
                } else {
                    (y, level.height)
                };
                if at < reach || at + reach + 1 >= size {
                    continue;
                }
                let here = level.place(x, y);
                let (before, after) = (here - reach * step, here + (reach + 1) * step);
                let bound = (before..after).step_by(step).all(|at| bonds[at] > 0.0);
                let apart = (2 * reach + 1) as f32;
                let explained = 0.5 * apart * (slope[before] + slope[after]);
                let off = state.value[after] - state.value[before] - explained;
                if bound && off.abs() > JUMP {
                    for between in (before + step..after).step_by(step) {
                        mixed[between] = true;
                    }
                }
            }
        }
    }
    mixed
}

/// Logarithms of light, the dark made even; NaN where it is unknown.
fn logarithms(light: &Plane<[f32; 3]>) -> Plane<[f32; 3]> {
    let (sum, count) = light
        .samples()
        .par_iter()
        .filter(|light| light.iter().all(|v| v.is_finite()))
        .map(|[r, g, b]| (f64::from(r + g + b) / 3.0, 1.0))
        .reduce(|| (0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    let dark = (f64::from(DARK_SHARE) * sum / f64::max(count, 1.0)).max(1e-9) as f32;
    light.map(|light| light.map(|v| (v.max(0.0) + dark).ln()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::noise::tests::blurred_noise;

    const SIGMA: f32 = 0.02;

    /// A far plane on the left and a near one on the right, of other slopes.
    fn truth(x: usize, y: usize) -> f32 {
        if x < 64 {
            0.5 + 0.001 * x as f32
        } else {
            0.9 + 0.001 * y as f32
        }
    }

    /// Both under noise, as a camera smooths them that blurs by a pixel.
    fn measured() -> Plane<f32> {
        let noise = blurred_noise(128, 128);
        // Normal distribution at half pixels either side of the edge, and beyond.
        let near = [0.006, 0.067, 0.309, 0.691, 0.933, 0.994];
        Plane::from_fn(128, 128, |x, y| {
            let share = match x {
                61..=66 => near[x - 61],
                _ => f32::from(u8::from(x >= 64)),
            };
            let mixed = (1.0 - share) * truth(x.min(63), y) + share * truth(x.max(64), y);
            mixed + SIGMA * noise[(x, y)]
        })
    }

    fn found(value: &Plane<f32>, right: f32) -> Smoothed {
        let light = Plane::from_fn(128, 128, |x, _| [if x < 64 { 0.3 } else { right }; 3]);
        piecewise(value, &value.map(|_| SIGMA), 1.0, &light)
    }

    #[test]
    fn planes_under_noise_keep_their_slopes() {
        for right in [0.3, 0.8] {
            let found = found(&measured(), right);
            let (mut squares, mut count) = (0.0, 0.0);
            for y in 4..124 {
                for x in (4..56).chain(72..124) {
                    let [across, down] = found.slope[(x, y)];
                    let true_slope = if x < 64 { [0.001, 0.0] } else { [0.0, 0.001] };
                    squares += (across - true_slope[0]).powi(2) + (down - true_slope[1]).powi(2);
                    count += 2.0;
                }
            }
            // A plane fitted to 16×16 pixels would do as well: σ √12 / 16².
            let rms = (squares / count as f32).sqrt();
            assert!(rms < SIGMA * 12f32.sqrt() / 256.0, "{rms}");
        }
    }

    #[test]
    fn a_smoothed_edge_is_put_back_where_the_photograph_has_it() {
        let found = found(&measured(), 0.8);
        let (mut squares, mut count) = (0.0, 0.0);
        for y in 8..120 {
            for x in [62, 63, 64, 65] {
                squares += (found.depth.value[(x, y)] - truth(x, y)).powi(2);
                count += 1.0;
            }
        }
        // An edge of 0.38 that is blurred by a pixel is off by 0.309 of it beside it, and by 0.067 further out.
        let blurred = 0.38 * ((0.309f32.powi(2) + 0.067f32.powi(2)) / 2.0).sqrt();
        let rms = (squares / count as f32).sqrt();
        // What is left is the noise of the planes and where exactly the edge lies.
        assert!(rms < 0.67 * blurred, "{rms} of {blurred}");
    }

    #[test]
    fn unknown_depth_stays_unknown_and_harms_nothing() {
        let mut value = measured();
        for y in 30..60 {
            for x in 20..40 {
                value[(x, y)] = f32::NAN;
            }
        }
        value[(30, 45)] = 0.53;
        let found = found(&value, 0.8);
        assert!(found.depth.value[(25, 40)].is_nan() && found.slope[(25, 40)][0].is_nan());
        // Alone it can only be what was measured.
        assert!((found.depth.value[(30, 45)] - 0.53).abs() < 1e-3);
        assert!((found.depth.value[(12, 45)] - truth(12, 45)).abs() < SIGMA);
    }
}
