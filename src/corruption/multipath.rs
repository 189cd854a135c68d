//! Infrared that reaches a sample over another surface.

use super::{
    CorruptionError,
    depth_grid::{NEAREST_METRES, lens, metres, ray, reflectance, scale, with_metres},
    field::upper,
};
use crate::shot::Shot;
use drivers::{Intrinsics, Plane, chance::Chance};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Points a side between which light is exchanged.
const SIDE: usize = 24;
/// Radians a metre of distance at 80 MHz: 4π f / c.
const WAVENUMBER: f32 = 4.0 * PI * 80e6 / 299_792_458.0;
/// Reflectance of the surfaces that send most back, and of the least.
const REFLECTANCE: [f32; 2] = [0.05, 0.8];
/// Samples, at 256×256, across which a surface's slope is read.
const SLOPE_PIXELS: f32 = 2.0;
/// Depth that differs by more within that, as a share, is that of another surface.
const STEP: f32 = 0.05;
/// A surface seen at less than this cosine is taken as seen at it.
const GRAZING: f32 = 0.1;

/// A piece of surface, in the depth camera's axes.
struct Patch {
    point: Vec3,
    normal: Vec3,
    /// Cosine between normal and the way to the camera.
    cosine: f32,
    /// Square metres.
    area: f32,
    /// Share of infrared sent back.
    reflectance: f32,
}

/// Adds `strength` times the light that bounced once between surfaces and shifts the phase, so that
/// corners seem deeper. Matte surfaces, lamp at the lens, nothing in the light's way; on a grid of
/// 24×24 points, interpolated between. As `models/render/multipath.py` does it.
pub(super) fn on_shot(shot: &Shot, strength: f32, _: Chance) -> Result<Shot, CorruptionError> {
    let clean = metres(shot)?;
    let (width, height) = clean.size();
    let lens = lens(shot);
    let (columns, rows) = (SIDE.min(width), SIDE.min(height));
    let patches = patches(shot, clean, &lens, (columns, rows));
    let phasors = patches.map(|patch| patch.as_ref().map(|at| arriving(at, patches.samples())));
    let longer = Plane::from_fn(width, height, |x, y| {
        let z = clean[(x, y)];
        let place = |at: usize, cells: usize, end: usize| {
            ((at as f32 + 0.5) * cells as f32 / end as f32 - 0.5).clamp(0.0, (cells - 1) as f32)
        };
        let indirect = between(&phasors, place(x, columns, width), place(y, rows, height));
        let (Some(ray), Some(indirect)) = (ray(&lens, x, y), indirect) else {
            return z;
        };
        let indirect = strength * indirect;
        let bias = indirect.y.atan2(1.0 + indirect.x) / WAVENUMBER;
        if z.is_finite() {
            (z + bias / ray.length()).max(NEAREST_METRES)
        } else {
            z
        }
    });
    Ok(with_metres(shot, longer))
}

/// The surface at the middle of each cell; `None` where it is not known.
fn patches(
    shot: &Shot,
    clean: &Plane<f32>,
    lens: &Intrinsics,
    (columns, rows): (usize, usize),
) -> Plane<Option<Patch>> {
    let (width, height) = clean.size();
    let step = (SLOPE_PIXELS * scale(clean.size())).round().max(1.0) as usize;
    let sent = reflectance(shot);
    let bright = upper(sent.samples().iter().copied(), 10.0).unwrap_or(1.0);
    let cells = (width * height) as f32 / (columns * rows) as f32;
    let solid_angle = cells / (lens.fx * lens.fy) as f32;
    let point = |x: usize, y: usize| {
        let z = *clean.get(x, y)?;
        let point = ray(lens, x, y)? * z;
        point.is_finite().then_some(point)
    };
    let beside = |middle: Vec3, x: usize, y: usize| {
        point(x, y).filter(|point| (point.z - middle.z).abs() < STEP * middle.z)
    };
    let patch = |x: usize, y: usize| {
        let middle = point(x, y)?;
        let across = beside(middle, x + step, y)? - beside(middle, x.checked_sub(step)?, y)?;
        let down = beside(middle, x, y + step)? - beside(middle, x, y.checked_sub(step)?)?;
        // Right × down points away from the camera.
        let normal = -across.cross(down).normalize_or_zero();
        let cosine = normal.dot(-middle.normalize());
        let ray_length = middle.length() / middle.z;
        (cosine > 0.0).then(|| Patch {
            point: middle,
            normal,
            cosine: cosine.max(GRAZING),
            area: solid_angle * middle.length_squared()
                / (ray_length.powi(3) * cosine.max(GRAZING)),
            // Unknown counts as the brightest.
            reflectance: (REFLECTANCE[1] * (sent[(x, y)] / bright).min(1.0)).max(REFLECTANCE[0]),
        })
    };
    Plane::from_fn(columns, rows, |column, row| {
        let middle = |cell: usize, cells: usize, end: usize| (2 * cell + 1) * end / (2 * cells);
        patch(middle(column, columns, width), middle(row, rows, height))
    })
}

/// The phasor of what arrives over all other patches, as a share of what comes straight back and
/// counted from its phase. The form factor is that of a disc, finite where surfaces touch.
fn arriving(at: &Patch, senders: &[Option<Patch>]) -> Vec2 {
    let own = at.point.length();
    let sum: Vec2 = senders
        .iter()
        .flatten()
        .map(|from| {
            let way = from.point - at.point;
            let apart2 = way.length_squared().max(1e-8);
            let facing = at.normal.dot(way).max(0.0) * from.normal.dot(-way).max(0.0) / apart2;
            let lit = from.reflectance * from.cosine / from.point.length_squared();
            let light = lit * from.area * facing / (PI * apart2 + from.area);
            let longer = 0.5 * (from.point.length() + apart2.sqrt() - own);
            Vec2::from_angle(WAVENUMBER * longer) * light
        })
        .sum();
    sum * own.powi(2) / at.cosine
}

/// Linear interpolation over the cells that are known; `None` where none of the four is.
fn between(cells: &Plane<Option<Vec2>>, x: f32, y: f32) -> Option<Vec2> {
    let (column, row) = (x.floor(), y.floor());
    let (across, down) = (x - column, y - row);
    let mut sum = Vec2::ZERO;
    let mut weights = 0.0;
    for (dx, dy, weight) in [
        (0, 0, (1.0 - across) * (1.0 - down)),
        (1, 0, across * (1.0 - down)),
        (0, 1, (1.0 - across) * down),
        (1, 1, across * down),
    ] {
        if let Some(Some(cell)) = cells.get(column as usize + dx, row as usize + dy) {
            sum += weight * *cell;
            weights += weight;
        }
    }
    (weights > 0.0).then(|| sum / weights)
}
