//! From found patches to one motion of the whole picture: the simplest that predicts patches it
//! has not seen.

use super::patch::Match;
use super::warp::Warp;
use rayon::prelude::*;

/// Motions, each containing those above it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Motion {
    Still,
    Translation,
    Affine,
    Planar,
}

impl Motion {
    /// Parameters of [`Warp`] it uses.
    fn parameters(self) -> &'static [usize] {
        match self {
            Self::Still => &[],
            Self::Translation => &[0, 3],
            Self::Affine => &[0, 1, 2, 3, 4, 5],
            Self::Planar => &[0, 1, 2, 3, 4, 5, 6, 7],
        }
    }

    /// Patches it asks for: a few per parameter, as some are wrong.
    fn matches_at_least(self) -> usize {
        match self {
            Self::Still => 0,
            Self::Translation => MATCHES_AT_LEAST,
            Self::Affine => 16,
            Self::Planar => 32,
        }
    }
}

/// Fewest patches from which anything is said.
pub(super) const MATCHES_AT_LEAST: usize = 8;
/// Residual from which a patch counts as lost, pixels: the loss grows no further.
const LOST: f64 = 0.75;
/// A richer motion has to lower the mean loss by this many standard errors of the decrease …
const STANDARD_ERRORS: f64 = 2.0;
/// … and by this much, squared pixels: less is not worth resampling noise for.
const WORTH: f64 = 0.05 * 0.05;
/// Parameters of a [`Warp`].
const PARAMETERS: usize = 8;
/// Parts the patches are dealt into for cross-validation.
const FOLDS: usize = 4;

/// The richest motion that many patches can carry, at most affine.
pub(super) fn coarse(matches: &[Match], width: usize, height: usize) -> Option<Warp> {
    let motion = [Motion::Affine, Motion::Translation]
        .into_iter()
        .find(|motion| matches.len() >= motion.matches_at_least())?;
    Some(fit(matches, motion, width, height))
}

/// The motion chosen by cross-validation (Stone 1974): a richer one only where it predicts
/// patches left out of its fit significantly better.
pub(super) fn choose(matches: &[Match], width: usize, height: usize) -> (Motion, Warp) {
    let mut best = Motion::Still;
    let mut best_losses = held_out_losses(matches, best, width, height);
    for motion in [Motion::Translation, Motion::Affine, Motion::Planar] {
        if matches.len() < motion.matches_at_least() {
            continue;
        }
        let losses = held_out_losses(matches, motion, width, height);
        let gains: Vec<f64> = best_losses
            .iter()
            .zip(&losses)
            .map(|(a, b)| a - b)
            .collect();
        let count = gains.len() as f64;
        let gain = gains.iter().sum::<f64>() / count;
        let spread = gains.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        if gain > STANDARD_ERRORS * (spread / count).sqrt() && gain > WORTH {
            (best, best_losses) = (motion, losses);
        }
    }
    (best, fit(matches, best, width, height))
}

/// Median distance between patches and a motion, pixels.
pub(super) fn residual(matches: &[Match], warp: &Warp) -> f32 {
    median(matches.iter().map(|found| distance(found, warp)).collect()) as f32
}

fn held_out_losses(matches: &[Match], motion: Motion, width: usize, height: usize) -> Vec<f64> {
    let warps: Vec<Warp> = (0..FOLDS)
        .into_par_iter()
        .map(|fold| {
            let kept = matches
                .iter()
                .enumerate()
                .filter(|(i, _)| i % FOLDS != fold);
            let kept: Vec<Match> = kept.map(|(_, found)| *found).collect();
            fit(&kept, motion, width, height)
        })
        .collect();
    let held_out = matches.iter().enumerate();
    held_out
        .map(|(i, found)| distance(found, &warps[i % FOLDS]).min(LOST).powi(2))
        .collect()
}

fn distance(found: &Match, warp: &Warp) -> f64 {
    let [dx, dy] = warp.displacement(found.centre[0], found.centre[1]);
    (found.displacement[0] - dx).hypot(found.displacement[1] - dy)
}

/// Rounds of reweighting by least absolute deviation, then by the biweight, at most.
const ROUNDS: usize = 12;
/// Change of every parameter in a round with which such rounds end, pixels.
const ARRIVED: f64 = 1e-3;
/// Tukey's constant: 95 % efficiency on normal residuals.
const BIWEIGHT: f64 = 4.685;
/// Standard deviation of patch positions assumed at least, pixels.
const SIGMA_AT_LEAST: f64 = 0.05;

/// Iteratively reweighted least squares: first absolute deviations, which no minority of wrong
/// patches can lead astray far, then Tukey's biweight around the answer.
fn fit(matches: &[Match], motion: Motion, width: usize, height: usize) -> Warp {
    let mut warp = Warp::identity(width, height);
    if motion == Motion::Still || matches.is_empty() {
        return warp;
    }
    let middle = |axis: usize| median(matches.iter().map(|m| m.displacement[axis]).collect());
    warp = Warp::new(
        width,
        height,
        [middle(0), 0.0, 0.0, middle(1), 0.0, 0.0, 0.0, 0.0],
    );
    for loss in [Loss::Absolute, Loss::Biweight] {
        for _ in 0..ROUNDS {
            let distances: Vec<f64> = matches.iter().map(|found| distance(found, &warp)).collect();
            let Some(next) = weighted(matches, &loss.weights(&distances), motion, &warp) else {
                return warp;
            };
            let parameters = warp.parameters().into_iter().zip(next.parameters());
            let change = parameters.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            warp = next;
            if change < ARRIVED {
                break;
            }
        }
    }
    warp
}

/// What a patch's distance from the motion counts for.
#[derive(Debug, Clone, Copy)]
enum Loss {
    Absolute,
    Biweight,
}

impl Loss {
    fn weights(self, distances: &[f64]) -> Vec<f64> {
        match self {
            Self::Absolute => {
                let weight = |d: &f64| 1.0 / d.max(SIGMA_AT_LEAST);
                distances.iter().map(weight).collect()
            }
            Self::Biweight => {
                // The median length of a 2-D normal error is 1.1774 sigma.
                let sigma = (median(distances.to_vec()) / 1.177_4).max(SIGMA_AT_LEAST);
                let weight = |d: &f64| (1.0 - (d / (BIWEIGHT * sigma)).powi(2)).max(0.0).powi(2);
                distances.iter().map(weight).collect()
            }
        }
    }
}

/// The upper one of two middle values; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// One weighted least squares fit; `None` when the patches do not determine it.
fn weighted(matches: &[Match], weights: &[f64], motion: Motion, frame: &Warp) -> Option<Warp> {
    let used = motion.parameters();
    let mut products = [[0.0f64; PARAMETERS + 1]; PARAMETERS];
    for (found, weight) in matches.iter().zip(weights) {
        let [u, v] = frame.normalised(found.centre[0], found.centre[1]);
        let rows = [
            (
                [1.0, u, v, 0.0, 0.0, 0.0, u * u, u * v],
                found.displacement[0],
            ),
            (
                [0.0, 0.0, 0.0, 1.0, u, v, u * v, v * v],
                found.displacement[1],
            ),
        ];
        for (row, value) in rows {
            for &a in used {
                let weighted = weight * row[a];
                if weighted != 0.0 {
                    for (sum, term) in products[a].iter_mut().zip(row) {
                        *sum += weighted * term;
                    }
                    products[a][PARAMETERS] += weighted * value;
                }
            }
        }
    }
    let columns = |a: usize| {
        used.iter()
            .chain([&PARAMETERS])
            .map(move |&b| products[a][b])
    };
    let system = used.iter().map(|&a| columns(a).collect()).collect();
    let solution = solve(system)?;
    let mut parameters = [0.0; 8];
    for (&index, value) in used.iter().zip(solution) {
        parameters[index] = value;
    }
    Some(frame.with(parameters))
}

/// Gaussian elimination with partial pivoting; each row holds its right side last.
pub(super) fn solve(mut system: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let size = system.len();
    let scale = (0..size).map(|i| system[i][i].abs()).fold(0.0, f64::max);
    for column in 0..size {
        let pivot = (column..size)
            .max_by(|&a, &b| system[a][column].abs().total_cmp(&system[b][column].abs()))?;
        system.swap(column, pivot);
        if system[column][column].abs() <= 1e-12 * scale {
            return None;
        }
        let (done, rest) = system.split_at_mut(column + 1);
        let lead = &done[column];
        for row in rest {
            let factor = row[column] / lead[column];
            if factor != 0.0 {
                for (value, lead) in row[column..].iter_mut().zip(&lead[column..]) {
                    *value -= factor * lead;
                }
            }
        }
    }
    let mut solution = vec![0.0; size];
    for row in (0..size).rev() {
        let known: f64 = (row + 1..size).map(|i| system[row][i] * solution[i]).sum();
        solution[row] = (system[row][size] - known) / system[row][row];
    }
    solution
        .iter()
        .all(|value| value.is_finite())
        .then_some(solution)
}
