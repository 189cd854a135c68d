//! How far normals and roughness are from the truth.

use super::light_error::{GridMismatch, same_grid};
use drivers::Plane;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// The error of unit normals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NormalError {
    /// Mean squared error of the components in [-1, 1].
    pub signed_mse: f64,
    /// Mean squared error of the components stored as (n + 1) / 2 in [0, 1]: a quarter of the other.
    pub unsigned_mse: f64,
    /// Mean angle, degrees.
    pub mean_degrees: f64,
    /// Median angle, degrees.
    pub median_degrees: f64,
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that count and have a truth, but were not answered; not in the means.
    pub unanswered: usize,
}

/// Compares normals in the same axes where `counts` is true; `None` when no pixel can be compared.
///
/// # Errors
/// [`GridMismatch`] when the three planes do not share one size.
pub fn normal_error(
    found: &Plane<Vec3>,
    truth: &Plane<Vec3>,
    counts: &Plane<bool>,
) -> Result<Option<NormalError>, GridMismatch> {
    same_grid("normal", found.size(), &[truth.size(), counts.size()])?;
    let mut squares = 0.0;
    let mut degrees = Vec::new();
    let mut unanswered = 0;
    for ((found, truth), counts) in found
        .samples()
        .iter()
        .zip(truth.samples())
        .zip(counts.samples())
    {
        if !counts || !truth.is_finite() || truth.length_squared() < 0.25 {
            continue;
        }
        if !found.is_finite() || found.length_squared() < 0.25 {
            unanswered += 1;
            continue;
        }
        let (found, truth) = (found.normalize().as_dvec3(), truth.normalize().as_dvec3());
        squares += (found - truth).length_squared();
        // atan2 keeps its digits near 0°, where acos of a dot product loses them.
        degrees.push(
            found
                .cross(truth)
                .length()
                .atan2(found.dot(truth))
                .to_degrees(),
        );
    }
    let pixels = degrees.len();
    if pixels == 0 {
        return Ok(None);
    }
    let signed_mse = squares / (3 * pixels) as f64;
    let mean_degrees = degrees.iter().sum::<f64>() / pixels as f64;
    let median_degrees = super::cost::percentile(&mut degrees, 0.5).unwrap_or(f64::NAN);
    Ok(Some(NormalError {
        signed_mse,
        unsigned_mse: signed_mse / 4.0,
        mean_degrees,
        median_degrees,
        pixels,
        unanswered,
    }))
}

/// The error of a single number per pixel in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RoughnessError {
    /// Mean squared error.
    pub mse: f64,
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that count and have a truth, but were not answered; not in the mean.
    pub unanswered: usize,
}

/// Compares roughness where `counts` is true; `None` when no pixel can be compared.
///
/// # Errors
/// [`GridMismatch`] when the three planes do not share one size.
pub fn roughness_error(
    found: &Plane<f32>,
    truth: &Plane<f32>,
    counts: &Plane<bool>,
) -> Result<Option<RoughnessError>, GridMismatch> {
    same_grid("roughness", found.size(), &[truth.size(), counts.size()])?;
    let (mut squares, mut pixels, mut unanswered) = (0.0, 0, 0);
    for ((found, truth), counts) in found
        .samples()
        .iter()
        .zip(truth.samples())
        .zip(counts.samples())
    {
        if !counts || !truth.is_finite() {
            continue;
        }
        if found.is_finite() {
            squares += f64::from(found - truth).powi(2);
            pixels += 1;
        } else {
            unanswered += 1;
        }
    }
    Ok((pixels > 0).then(|| RoughnessError {
        mse: squares / pixels as f64,
        pixels,
        unanswered,
    }))
}
