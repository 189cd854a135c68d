//! Polynomial texture maps: a pixel's brightness as a polynomial of degree two in the lamp's direction.
//!
//! Malzbender, Gelb, Wolters, "Polynomial Texture Maps", SIGGRAPH 2001; the file as in their "PTM format" of 2001,
//! LRGB: `brightness = a0 u² + a1 v² + a2 uv + a3 u + a4 v + a5`, (u, v) the first two coordinates of the unit
//! vector toward the lamp (x right, y up), times a color of eight bits.

use crate::{
    radiometry::transfer::srgb_encode,
    relight::{Lamp, Prepared, RelightOptions},
};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

/// Rings of lamps around the view, degrees from it, and lamps on each.
const RINGS: [(f32, usize); 4] = [(0.0, 1), (25.0, 8), (50.0, 14), (72.0, 18)];
const TERMS: usize = 6;

fn terms(u: f32, v: f32) -> SVector<f32, TERMS> {
    SVector::from([u * u, v * v, u * v, u, v, 1.0])
}

fn lamps() -> Vec<Lamp> {
    let ring = |(degrees, count): (f32, usize)| {
        let (away, toward) = degrees.to_radians().sin_cos();
        (0..count).map(move |index| {
            let (y, x) = (index as f32 * std::f32::consts::TAU / count as f32).sin_cos();
            Lamp::from_person([away * x, away * y, toward]).expect("a direction")
        })
    };
    RINGS.into_iter().flat_map(ring).collect()
}

pub(super) fn encoded(prepared: &Prepared) -> Vec<u8> {
    let lamps = lamps();
    // Least squares: every lamp adds its brightness times these weights to the coefficients.
    let rows = lamps.iter().map(|lamp| {
        let [u, v, _] = lamp.person_direction();
        terms(u, v)
    });
    let rows: Vec<_> = rows.collect();
    let normal: SMatrix<f32, TERMS, TERMS> = rows.iter().map(|row| row * row.transpose()).sum();
    let inverse = normal.try_inverse().expect("41 directions span six terms");
    let (width, height) = prepared.size();
    let mut fitted = vec![[0.0f32; TERMS]; width * height];
    let mut mean = vec![[0.0f32; 3]; width * height];
    for (lamp, row) in lamps.iter().zip(&rows) {
        let weights = inverse * row;
        let light = prepared.relight(lamp, RelightOptions::default()).light.0;
        let pixels = fitted.par_iter_mut().zip(&mut mean).zip(light.samples());
        pixels.for_each(|((fitted, mean), light)| {
            // As it is shown: viewers put the bytes on the screen, and what is unknown is black.
            let light = light.map(|value| {
                let known = if value.is_nan() { 0.0 } else { value };
                srgb_encode(known.clamp(0.0, 1.0))
            });
            let brightness = light.iter().sum::<f32>() / 3.0;
            for (term, weight) in fitted.iter_mut().zip(weights.iter()) {
                *term += weight * brightness;
            }
            for (sum, value) in mean.iter_mut().zip(light) {
                *sum += value;
            }
        });
    }
    // The color is that of the mean picture, as bright as fits a byte; the rest is the polynomial's.
    let colors: Vec<[u8; 3]> = mean
        .iter()
        .map(|mean| {
            let most = mean.iter().fold(1e-6f32, |most, value| most.max(*value));
            mean.map(|value| (255.0 * value / most).round() as u8)
        })
        .collect();
    for (fitted, color) in fitted.iter_mut().zip(&colors) {
        let own = color.iter().map(|value| f32::from(*value)).sum::<f32>() / 3.0;
        fitted
            .iter_mut()
            .for_each(|term| *term *= 255.0 / own.max(1.0));
    }
    // Viewers take (byte − bias) × scale for a coefficient of brightness in bytes.
    let range = |term: usize| {
        let values = fitted.iter().map(|fitted| fitted[term]);
        values.fold((0.0f32, 0.0f32), |(least, most), value| {
            (least.min(value), most.max(value))
        })
    };
    let ranges: [(f32, f32); TERMS] = std::array::from_fn(range);
    let scales = ranges.map(|(least, most)| (most - least).max(1e-6));
    let biases: [f32; TERMS] =
        std::array::from_fn(|term| (-255.0 * ranges[term].0 / scales[term]).round());
    let line = |values: &mut dyn Iterator<Item = String>| values.collect::<Vec<_>>().join(" ");
    let mut file = format!(
        "PTM_1.2\nPTM_FORMAT_LRGB\n{width}\n{height}\n{}\n{}\n",
        line(&mut scales.iter().map(|scale| format!("{scale:.7}"))),
        line(&mut biases.iter().map(|bias| format!("{bias:.0}"))),
    )
    .into_bytes();
    // Rows from the bottom up; all polynomials, then all colors.
    for y in (0..height).rev() {
        for fitted in &fitted[y * width..(y + 1) * width] {
            file.extend((0..TERMS).map(|term| {
                let value = 255.0 * fitted[term] / scales[term] + biases[term];
                value.round().clamp(0.0, 255.0) as u8
            }));
        }
    }
    for y in (0..height).rev() {
        file.extend(colors[y * width..(y + 1) * width].as_flattened());
    }
    file
}
