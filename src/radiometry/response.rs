//! A camera's transfer curve, from pictures of one still scene at several exposures.
//!
//! Debevec & Malik, "Recovering high dynamic range radiance maps from photographs" (SIGGRAPH 1997):
//! the logarithm of the response that makes all exposures of a pixel agree, smooth and, here, made
//! monotone. Every pixel takes part: its own radiance is eliminated from the normal equations in
//! closed form, so that only the 256 values of the curve are left to solve for.

use super::flow::solve;
use drivers::{Plane, Transfer};
use thiserror::Error;

/// A transfer curve and how well it explains the stack.
#[derive(Debug, Clone, PartialEq)]
pub struct RecoveredResponse {
    /// A [`Transfer::Response`]: light of 256 values, 0 at black and 1 at white.
    pub transfer: Transfer,
    /// Root mean square difference, in 8-bit codes, between the values seen and those the curve
    /// predicts from the other exposures of the same pixel.
    pub residual_codes: f32,
    /// Lowest and highest code the stack holds evidence for; beyond them the curve is continued.
    pub codes_seen: [u8; 2],
}

/// Why no curve could be recovered.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ResponseError {
    /// Too few pictures.
    #[error("a response needs at least 2 pictures at different exposures, not {found}")]
    TooFewExposures {
        /// Different exposures given.
        found: usize,
    },
    /// An exposure that cannot be.
    #[error("exposure factor {factor} of picture {index} must be positive and finite")]
    BadExposure {
        /// Position in the stack.
        index: usize,
        /// The factor given.
        factor: f32,
    },
    /// Pictures of different size, or empty.
    #[error(
        "picture {index} is {found_width}×{found_height}, the first {width}×{height}; \
         all must share one size of at least one pixel"
    )]
    SizesDiffer {
        /// Position in the stack.
        index: usize,
        /// Pixels per row of the first picture.
        width: usize,
        /// Rows of the first picture.
        height: usize,
        /// Pixels per row.
        found_width: usize,
        /// Rows.
        found_height: usize,
    },
    /// The pictures do not reach enough of the curve.
    #[error(
        "the stack shows only {codes} of 256 values well; take pictures from nearly black to \
         nearly white, of a scene with bright and dark parts"
    )]
    TooLittleRange {
        /// Codes with evidence.
        codes: usize,
    },
}

/// Codes of a curve.
const CODES: usize = 256;
/// Codes that need evidence.
const CODES_AT_LEAST: usize = 128;
/// Weight of the smoothness of the curve, `∫ (d² ln light / d(ln code)²)²`, against the mean
/// evidence per code. Exposures a factor of two apart leave ripples of that period open, which
/// this closes: at a tenth of it a linear curve still comes back within 0.1 % of white.
const STIFFNESS: f64 = 0.001;
/// Samples used, at most; more only average the same codes again.
const SAMPLES: usize = 400_000;
/// Rounds of fitting; each weighs codes by the slope found in the last.
const ROUNDS: usize = 3;

/// Recovers the transfer curve from `(exposure factor, picture)` pairs of one still scene, camera
/// fixed; the three channels are taken to share one curve.
///
/// Two exposures leave the curve open to ripples that repeat from one to the next; three or more,
/// a factor of two or less apart, do not.
///
/// # Errors
/// [`ResponseError::TooFewExposures`] under two different exposures, [`ResponseError::BadExposure`]
/// and [`ResponseError::SizesDiffer`] for an unusable stack, [`ResponseError::TooLittleRange`] when
/// the pictures leave more than half of the codes without evidence.
pub fn recover_response(
    stack: &[(f32, Plane<[u8; 3]>)],
) -> Result<RecoveredResponse, ResponseError> {
    check(stack)?;
    let logs: Vec<f64> = stack
        .iter()
        .map(|(factor, _)| f64::from(*factor).ln())
        .collect();
    let samples = sampled(stack);
    let seen = evidence(&samples);
    let strong: Vec<usize> = (1..CODES - 1).filter(|&code| seen[code] > 0.0).collect();
    let (Some(&lowest), Some(&highest)) = (strong.first(), strong.last()) else {
        return Err(ResponseError::TooLittleRange { codes: 0 });
    };
    if strong.len() < CODES_AT_LEAST.min(highest - lowest + 1) || highest - lowest < CODES_AT_LEAST
    {
        return Err(ResponseError::TooLittleRange {
            codes: strong.len(),
        });
    }
    // A start from which slopes are near enough to weigh codes by: a camera-like power curve.
    let mut curve: Vec<f64> = (0..CODES)
        .map(|code| 2.2 * (code.max(1) as f64 / 255.0).ln())
        .collect();
    for _ in 0..ROUNDS {
        let slopes = slopes(&curve);
        let Some(next) = fit(&samples, &logs, &slopes) else {
            return Err(ResponseError::TooLittleRange {
                codes: strong.len(),
            });
        };
        curve = monotone(&next, &seen);
    }
    let residual_codes = residual(&samples, &logs, &curve);
    let white = curve[CODES - 1];
    let mut light: Vec<f32> = curve
        .iter()
        .map(|log| ((log - white).exp() as f32).min(1.0))
        .collect();
    // Code 0 has no logarithm: black is black, and the curve rises from it.
    light[0] = 0.0;
    light[CODES - 1] = 1.0;
    Ok(RecoveredResponse {
        transfer: Transfer::Response(light),
        residual_codes,
        codes_seen: [lowest as u8, highest as u8],
    })
}

fn check(stack: &[(f32, Plane<[u8; 3]>)]) -> Result<(), ResponseError> {
    let mut factors: Vec<f32> = Vec::new();
    for (index, (factor, picture)) in stack.iter().enumerate() {
        if !(factor.is_normal() && *factor > 0.0) {
            return Err(ResponseError::BadExposure {
                index,
                factor: *factor,
            });
        }
        let ((width, height), (found_width, found_height)) = (stack[0].1.size(), picture.size());
        if (width, height) != (found_width, found_height) || picture.is_empty() {
            return Err(ResponseError::SizesDiffer {
                index,
                width,
                height,
                found_width,
                found_height,
            });
        }
        if factors
            .iter()
            .all(|known| (known / factor - 1.0).abs() > 0.01)
        {
            factors.push(*factor);
        }
    }
    if factors.len() < 2 {
        return Err(ResponseError::TooFewExposures {
            found: factors.len(),
        });
    }
    Ok(())
}

/// Codes of one channel of one pixel at every exposure, side by side.
fn sampled(stack: &[(f32, Plane<[u8; 3]>)]) -> Vec<Vec<u8>> {
    let pixels = stack[0].1.len();
    let stride = (pixels * 3 * stack.len() / SAMPLES).max(1);
    (0..pixels)
        .step_by(stride)
        .flat_map(|i| (0..3).map(move |channel| (i, channel)))
        .map(|(i, channel)| stack.iter().map(|(_, p)| p.samples()[i][channel]).collect())
        .collect()
}

/// Trust in a code: the hat of the paper; the ends, where values clip, count nothing.
fn trust(code: u8) -> f64 {
    f64::from(code.min(255 - code)) / 127.0
}

/// Samples that say something about each code: those with two exposures off the ends.
fn evidence(samples: &[Vec<u8>]) -> [f64; CODES] {
    let mut seen = [0.0; CODES];
    for codes in samples {
        if codes.iter().filter(|&&code| trust(code) > 0.0).count() >= 2 {
            for &code in codes {
                seen[usize::from(code)] += trust(code);
            }
        }
    }
    seen
}

/// Slope of the logarithm over each code, kept positive.
fn slopes(curve: &[f64]) -> [f64; CODES] {
    std::array::from_fn(|code| {
        let (low, high) = (code.saturating_sub(1).max(1), (code + 1).min(CODES - 1));
        ((curve[high] - curve[low]) / (high - low).max(1) as f64).max(1e-4)
    })
}

/// Least squares over the curve alone.
///
/// For one pixel with logarithms `g(zⱼ) − tⱼ = ln E`, the best `ln E` is their weighted mean, and
/// putting it back leaves `diag(w) − w wᵀ/Σw` in the normal equations. An error of one code is an
/// error of one slope in the logarithm, hence the weights `trust / slope²`.
fn fit(samples: &[Vec<u8>], logs: &[f64], slopes: &[f64; CODES]) -> Option<Vec<f64>> {
    let mut system = vec![vec![0.0f64; CODES + 1]; CODES];
    for codes in samples {
        let weights: Vec<f64> = codes
            .iter()
            .map(|&code| trust(code) / slopes[usize::from(code)].powi(2))
            .collect();
        let total: f64 = weights.iter().sum();
        if total <= 0.0 {
            continue;
        }
        let mean_log = weights.iter().zip(logs).map(|(w, t)| w * t).sum::<f64>() / total;
        for ((&code, &weight), &log) in codes.iter().zip(&weights).zip(logs) {
            let row = &mut system[usize::from(code)];
            row[usize::from(code)] += weight;
            row[CODES] += weight * (log - mean_log);
            for (&other, &other_weight) in codes.iter().zip(&weights) {
                row[usize::from(other)] -= weight * other_weight / total;
            }
        }
    }
    let evidence = (0..CODES).map(|i| system[i][i]).sum::<f64>() / CODES as f64;
    // Smooth against ln(code), in which every power curve is a straight line.
    let position = |code: usize| (code as f64 + 0.5).ln();
    for code in 1..CODES - 1 {
        let (before, here, after) = (position(code - 1), position(code), position(code + 1));
        let second = [
            1.0 / (here - before),
            -1.0 / (here - before) - 1.0 / (after - here),
            1.0 / (after - here),
        ];
        let weight = STIFFNESS * evidence * 2.0 / (after - before);
        for (i, a) in second.iter().enumerate() {
            for (j, b) in second.iter().enumerate() {
                system[code - 1 + i][code - 1 + j] += weight * a * b;
            }
        }
    }
    // The scale of the curve is free: white is 0.
    system[CODES - 1][CODES - 1] += evidence;
    solve(system)
}

/// The nearest non-decreasing curve: pool adjacent violators (Ayer et al. 1955).
fn monotone(curve: &[f64], seen: &[f64; CODES]) -> Vec<f64> {
    let mut pools: Vec<(f64, f64, usize)> = Vec::new();
    for (&value, &seen) in curve.iter().zip(seen) {
        pools.push((value, seen + 1e-3, 1));
        while let [.., low, high] = pools[..]
            && low.0 > high.0
        {
            let weight = low.1 + high.1;
            let mean = (low.0 * low.1 + high.0 * high.1) / weight;
            pools.truncate(pools.len() - 2);
            pools.push((mean, weight, low.2 + high.2));
        }
    }
    pools
        .into_iter()
        .flat_map(|(value, _, count)| std::iter::repeat_n(value, count))
        .collect()
}

/// Root mean square error in codes, each exposure against the mean of all.
fn residual(samples: &[Vec<u8>], logs: &[f64], curve: &[f64]) -> f32 {
    let slopes = slopes(curve);
    let (mut sum, mut count) = (0.0, 0.0);
    for codes in samples {
        let known: Vec<(u8, f64)> = codes
            .iter()
            .zip(logs)
            .filter(|(code, _)| trust(**code) > 0.0)
            .map(|(&code, log)| (code, curve[usize::from(code)] - log))
            .collect();
        if known.len() < 2 {
            continue;
        }
        for (i, (code, log)) in known.iter().enumerate() {
            let others = known.iter().enumerate().filter(|(j, _)| *j != i);
            let (weight, total) = others.fold((0.0, 0.0), |(weight, total), (_, (code, log))| {
                let w = trust(*code) / slopes[usize::from(*code)].powi(2);
                (weight + w, total + w * log)
            });
            let error = (log - total / weight) / slopes[usize::from(*code)];
            // Far down the curve one code is a large step of light; a bound keeps single dark
            // codes from deciding the figure.
            sum += error.clamp(-20.0, 20.0).powi(2);
            count += 1.0;
        }
    }
    if count > 0.0 {
        (sum / count).sqrt() as f32
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::transfer;
    use super::*;

    /// A still scene of 13 stops, seen through `curve` at each factor.
    fn stack(factors: &[f32], curve: impl Fn(f32) -> f32 + Sync) -> Vec<(f32, Plane<[u8; 3]>)> {
        let picture = |factor: f32| {
            Plane::from_fn(96, 64, |x, y| {
                std::array::from_fn(|channel| {
                    let rank = (y * 96 + x) as f32 + channel as f32 / 3.0;
                    let light = 2f32.powf(rank / (96.0 * 64.0) * 13.0 - 10.0);
                    (curve((light * factor).min(1.0)) * 255.0).round() as u8
                })
            })
        };
        factors
            .iter()
            .map(|&factor| (factor, picture(factor)))
            .collect()
    }

    const FACTORS: [f32; 6] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0];

    /// Tolerances: an 8-bit code stands for ±½ step; averaged over many pixels the curve is known
    /// far better, except in the last codes before clipping, which have no weight of their own.
    #[test]
    fn known_curves_come_back_within_half_a_per_cent_of_white() {
        struct Case(
            &'static str,
            Box<dyn Fn(f32) -> f32 + Sync>,
            Box<dyn Fn(f32) -> f32>,
        );
        // An S-curve with a closed inverse, made monotone by its smaller second term.
        let s = |v: f32| v * v * (1.5 - 0.5 * v);
        let s_inverse = move |light: f32| {
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if s(middle) < light {
                    low = middle
                } else {
                    high = middle
                }
            }
            low
        };
        for Case(name, encode, decode) in [
            Case(
                "sRGB",
                Box::new(transfer::srgb_encode),
                Box::new(transfer::srgb_decode),
            ),
            Case(
                "gamma 1.8",
                Box::new(|l| l.powf(1.0 / 1.8)),
                Box::new(|v| v.powf(1.8)),
            ),
            Case("linear", Box::new(|l| l), Box::new(|v| v)),
            Case("S", Box::new(s_inverse), Box::new(s)),
        ] {
            let found = recover_response(&stack(&FACTORS, encode)).unwrap();
            transfer::check(&found.transfer).unwrap();
            let Transfer::Response(light) = &found.transfer else {
                unreachable!()
            };
            let worst = (0..256)
                .map(|code| (light[code] - decode(code as f32 / 255.0)).abs())
                .fold(0.0, f32::max);
            let worst_share = (16..250)
                .map(|code| (light[code] / decode(code as f32 / 255.0) - 1.0).abs())
                .fold(0.0, f32::max);
            assert!(worst < 0.005, "{name}: {worst} of white");
            assert!(worst_share < 0.01, "{name}: {worst_share} of its value");
            assert!(
                found.residual_codes < 1.0,
                "{name}: {} codes",
                found.residual_codes
            );
        }
    }

    #[test]
    fn a_wrong_exposure_shows_in_the_residual() {
        let mut lying = stack(&FACTORS, transfer::srgb_encode);
        let honest = recover_response(&lying).unwrap();
        lying[3].0 *= 1.5;
        let found = recover_response(&lying).unwrap();
        assert!(found.residual_codes > 3.0 * honest.residual_codes);
    }

    #[test]
    fn unusable_stacks_are_refused() {
        let good = stack(&FACTORS, transfer::srgb_encode);
        assert!(matches!(
            recover_response(&[]),
            Err(ResponseError::TooFewExposures { .. })
        ));
        assert!(matches!(
            recover_response(&[good[0].clone(), good[0].clone()]),
            Err(ResponseError::TooFewExposures { found: 1 })
        ));
        let mut bad = good.clone();
        bad[1].0 = f32::NAN;
        assert!(matches!(
            recover_response(&bad),
            Err(ResponseError::BadExposure { index: 1, .. })
        ));
        let mut bad = good.clone();
        bad[2].1 = Plane::filled(3, 3, [0; 3]);
        assert!(matches!(
            recover_response(&bad),
            Err(ResponseError::SizesDiffer { index: 2, .. })
        ));
        let flat: Vec<_> = FACTORS
            .iter()
            .map(|&factor| (factor, Plane::filled(8, 8, [90u8; 3])))
            .collect();
        assert!(matches!(
            recover_response(&flat),
            Err(ResponseError::TooLittleRange { .. })
        ));
    }
}
