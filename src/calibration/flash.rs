//! Where the flash sits and how it shines, from the white paper of the boards.

use super::{
    CalibrationError, board::Board, least_squares::minimize, lenses::Camera, range::median,
};
use drivers::{Beam, FlashLamp, Plane};
use glam::{DVec2, DVec3};
use serde::Serialize;

/// How well the flash is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FlashFit {
    /// Standard error of the position, metres.
    pub position_error_metres: f64,
    /// Root mean square difference between seen and predicted light, a fraction.
    pub rms_fraction: f64,
    /// Places on paper that count.
    pub samples: usize,
    /// Places that were left out: glare, dirt, shadow.
    pub outliers: usize,
}

/// Where a piece of paper is, which way it faces, and how bright the flash makes it.
struct Paper {
    place: DVec3,
    normal: DVec3,
    light: f64,
}

/// Fewest places.
const FEWEST: usize = 60;
/// Robust standard deviations beyond which a place is left out, and the least such limit.
const OUTLIER: f64 = 4.0;
const LEAST: f64 = 0.01;

/// Fits the flash to `lights`, the flash-only light (unit exposure) of each view, on paper of this
/// albedo.
///
/// # Errors
/// [`CalibrationError::Views`] with too little lit paper; [`CalibrationError::Unsolved`].
pub(super) fn fit(
    camera: &Camera,
    board: &Board,
    lights: &[&Plane<[f32; 3]>],
    paper_albedo: f64,
) -> Result<(FlashLamp, FlashFit), CalibrationError> {
    let mut papers = Vec::new();
    for (pose, light) in camera.poses.iter().zip(lights) {
        let Some(pose) = pose else { continue };
        // The board's z points into the board.
        let normal = pose.rotation * DVec3::NEG_Z;
        for place in board
            .white_squares()
            .flat_map(|square| board.paper_in(square))
        {
            let place = pose.apply(place);
            let seen = camera
                .lens
                .project(place)
                .and_then(|pixel| value(light, pixel));
            papers.extend(seen.map(|light| Paper {
                place,
                normal,
                light,
            }));
        }
    }
    let all = papers.len();
    if all < FEWEST {
        return Err(CalibrationError::Views {
            camera: "flash",
            problem: format!(
                "it lights {all} places on white paper measurably; {FEWEST} are needed; expose so \
                 that paper does not clip"
            ),
        });
    }
    // Position, logarithm of the intensity, and the beam.
    let mut p = vec![0.0; 7];
    let mut start: Vec<f64> = papers.iter().map(|paper| off(&p, paper)).collect();
    p[3] = -median(&mut start);
    let mut found = None;
    for free in [4, 7, 7, 7] {
        let fixed = p.clone();
        let fit = minimize(p[..free].to_vec(), |q| {
            let mut p = fixed.clone();
            p[..free].copy_from_slice(q);
            papers.iter().map(|paper| off(&p, paper)).collect()
        })
        .ok_or(CalibrationError::Unsolved { camera: "flash" })?;
        p[..free].copy_from_slice(&fit.parameters);
        let mut sizes: Vec<f64> = fit.residuals.iter().map(|off| off.abs()).collect();
        let limit = (OUTLIER * 1.4826 * median(&mut sizes)).max(LEAST);
        papers.retain(|paper| off(&p, paper).abs() <= limit);
        if papers.len() < FEWEST {
            return Err(CalibrationError::Unsolved { camera: "flash" });
        }
        found = Some(fit);
    }
    let fit = found.ok_or(CalibrationError::Unsolved { camera: "flash" })?;
    let squares: f64 = papers.iter().map(|paper| off(&p, paper).powi(2)).sum();
    let lamp = FlashLamp {
        position_metres: DVec3::new(p[0], p[1], p[2]),
        intensity: Some((p[3].exp() / paper_albedo) as f32),
        beam: Beam {
            tilt: [p[4], p[5]],
            falloff: p[6],
        },
    };
    Ok((
        lamp,
        FlashFit {
            position_error_metres: fit.errors[..3].iter().map(|e| e * e).sum::<f64>().sqrt(),
            rms_fraction: (squares / papers.len() as f64).sqrt(),
            samples: papers.len(),
            outliers: all - papers.len(),
        },
    ))
}

/// Logarithm of predicted over seen light.
fn off(p: &[f64], paper: &Paper) -> f64 {
    /// Of paper behind the flash or turned away from it.
    const IMPOSSIBLE: f64 = 20.0;
    let way = paper.place - DVec3::new(p[0], p[1], p[2]);
    let far = way.length();
    let cosine = -paper.normal.dot(way) / far;
    if !(cosine > 1e-3 && way.z > 1e-3) {
        return IMPOSSIBLE;
    }
    let beam = Beam {
        tilt: [p[4], p[5]],
        falloff: p[6],
    };
    let predicted = p[3] + (cosine / (far * far)).ln() + beam.strength(way).ln();
    (predicted - paper.light.ln()).clamp(-IMPOSSIBLE, IMPOSSIBLE)
}

/// Mean light of the pixels around a place between them; `None` outside and where one is unknown or
/// not lit.
fn value(light: &Plane<[f32; 3]>, pixel: DVec2) -> Option<f64> {
    let (x, y) = (pixel.x.floor(), pixel.y.floor());
    if x < 0.0 || y < 0.0 {
        return None;
    }
    let (x, y) = (x as usize, y as usize);
    let (u, v) = (pixel.x.fract(), pixel.y.fract());
    let at = |x: usize, y: usize| {
        let rgb = light.get(x, y)?;
        Some(f64::from(rgb[0] + rgb[1] + rgb[2]) / 3.0)
    };
    let above = at(x, y)? * (1.0 - u) + at(x + 1, y)? * u;
    let below = at(x, y + 1)? * (1.0 - u) + at(x + 1, y + 1)? * u;
    let light = above * (1.0 - v) + below * v;
    (light.is_finite() && light > 0.0).then_some(light)
}
