//! From found patches to one motion of the whole picture: the simplest that predicts patches it
//! has not seen.

use super::patch::Match;
use super::warp::Warp;

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
    let mut distances: Vec<f64> = matches.iter().map(|found| distance(found, warp)).collect();
    distances.sort_unstable_by(f64::total_cmp);
    distances
        .get(distances.len() / 2)
        .map_or(0.0, |&middle| middle as f32)
}

fn held_out_losses(matches: &[Match], motion: Motion, width: usize, height: usize) -> Vec<f64> {
    let mut losses = vec![0.0; matches.len()];
    for fold in 0..FOLDS {
        let kept: Vec<Match> = matches
            .iter()
            .enumerate()
            .filter(|(i, _)| i % FOLDS != fold)
            .map(|(_, m)| *m)
            .collect();
        let warp = fit(&kept, motion, width, height);
        for (i, found) in matches
            .iter()
            .enumerate()
            .filter(|(i, _)| i % FOLDS == fold)
        {
            losses[i] = distance(found, &warp).min(LOST).powi(2);
        }
    }
    losses
}

fn distance(found: &Match, warp: &Warp) -> f64 {
    let [dx, dy] = warp.displacement(found.centre[0], found.centre[1]);
    (found.displacement[0] - dx).hypot(found.displacement[1] - dy)
}

/// Rounds of reweighting by least absolute deviation, then by the biweight.
const ROUNDS: usize = 12;
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
    let middle = |axis: usize| {
        let mut values: Vec<f64> = matches.iter().map(|m| m.displacement[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values[values.len() / 2]
    };
    warp = Warp::new(
        width,
        height,
        [middle(0), 0.0, 0.0, middle(1), 0.0, 0.0, 0.0, 0.0],
    );
    for round in 0..2 * ROUNDS {
        let distances: Vec<f64> = matches.iter().map(|found| distance(found, &warp)).collect();
        let weights: Vec<f64> = if round < ROUNDS {
            distances
                .iter()
                .map(|d| 1.0 / d.max(SIGMA_AT_LEAST))
                .collect()
        } else {
            let mut sorted = distances.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            // The median length of a 2-D normal error is 1.1774 sigma.
            let sigma = (sorted[sorted.len() / 2] / 1.177_4).max(SIGMA_AT_LEAST);
            distances
                .iter()
                .map(|d| (1.0 - (d / (BIWEIGHT * sigma)).powi(2)).max(0.0).powi(2))
                .collect()
        };
        match weighted(matches, &weights, motion, &warp) {
            Some(next) => warp = next,
            None => break,
        }
    }
    warp
}

/// One weighted least squares fit; `None` when the patches do not determine it.
fn weighted(matches: &[Match], weights: &[f64], motion: Motion, frame: &Warp) -> Option<Warp> {
    let used = motion.parameters();
    let size = used.len();
    let mut system = vec![vec![0.0f64; size + 1]; size];
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
            for (i, &a) in used.iter().enumerate() {
                for (j, &b) in used.iter().enumerate() {
                    system[i][j] += weight * row[a] * row[b];
                }
                system[i][size] += weight * row[a] * value;
            }
        }
    }
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
