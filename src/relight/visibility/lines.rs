//! Which image lines a sweep walks: four fans around the light's vanishing point.
//!
//! Each fan holds the lines that advance one pixel per step along one axis (the *major* axis);
//! neighbouring lines are one pixel apart at the far end of the fan. A pixel belongs to the fan
//! whose direction it lies in, and takes its answer from the line that passes nearest.
//!
//! Toward the vanishing point lines crowd. So every other line is asked only where lines lie more
//! than half a pixel apart, and half of the rest only where they lie more than a quarter apart.

use crate::relight::Origin;
use drivers::Intrinsics;
use glam::{DVec3, Vec3};

/// Lines walked side by side.
pub const LANES: usize = 16;

/// Neighbouring lines whose answers are kept together.
pub const BAND: usize = 64;

/// Lines of a band that are walked together: they are asked over the same stretch.
#[derive(Debug, Clone, Copy)]
pub struct Strand {
    /// First line, counted within the band.
    pub first: usize,
    /// From one lane's line to the next one's.
    pub stride: usize,
    /// Asked where [`Fan::crowding`] is at most this.
    crowding: u32,
}

/// The strands of a band: each of its lines is in one of them.
pub const STRANDS: [Strand; BAND / LANES] = [
    strand(1, 2, 0),
    strand(33, 2, 0),
    strand(2, 4, 1),
    strand(0, 4, MOST_CROWDING),
];

const fn strand(first: usize, stride: usize, crowding: u32) -> Strand {
    Strand {
        first,
        stride,
        crowding,
    }
}

/// Where lines crowd most, one of 2 to this power is asked.
const MOST_CROWDING: u32 = 2;

/// One of the four fans, in (major, minor) coordinates: (y, x) for the fans above and below the
/// vanishing point, (x, y) for those left and right of it.
#[derive(Debug, Clone)]
pub struct Fan {
    /// True when the major axis is x.
    pub along_x: bool,
    /// First major coordinate of the fan (inclusive).
    pub from: usize,
    /// Last major coordinate of the fan (inclusive).
    pub to: usize,
    /// True when the vanishing point lies at smaller major coordinates than the fan.
    pub grows_outward: bool,
    /// Number of lines.
    pub lines: usize,
    /// Minor coordinate of line j at major m is `base + j·spread + m·(slope + j·spread_slope)`.
    base: f64,
    spread: f64,
    slope: f64,
    spread_slope: f64,
    /// Vanishing point (major, minor).
    vanishing: [f64; 2],
    /// Slope of line 0 and slope difference of neighbouring lines (minor per major).
    first_slope: f64,
    slope_step: f64,
}

impl Fan {
    /// Minor coordinate at major 0, and slope, of line `j`.
    pub fn line(&self, j: usize) -> (f32, f32) {
        let j = j as f64;
        (
            (self.base + j * self.spread) as f32,
            (self.slope + j * self.spread_slope) as f32,
        )
    }

    /// `(gain, offset)` such that at major coordinate m the line nearest to minor n is
    /// `n · gain + offset`.
    pub fn line_index_at(&self, major: usize) -> (f32, f32) {
        let gain = 1.0 / ((major as f64 - self.vanishing[0]) * self.slope_step);
        (
            (gain) as f32,
            (-self.vanishing[1] * gain - self.first_slope / self.slope_step) as f32,
        )
    }

    /// Number of bands of [`BAND`] lines.
    pub fn bands(&self) -> usize {
        self.lines.div_ceil(BAND)
    }

    /// At major coordinate m only every 2^crowding-th line is asked.
    pub fn crowding(&self, major: usize) -> u32 {
        let apart = ((major as f64 - self.vanishing[0]) * self.slope_step).abs();
        u32::from(apart <= 0.5) + u32::from(apart <= 0.25)
    }

    /// Major coordinates, first and last, outside which a strand is never asked.
    pub fn asked(&self, strand: Strand) -> (usize, usize) {
        if strand.crowding == MOST_CROWDING {
            return (self.from, self.to);
        }
        let apart = 0.5f64.powi(strand.crowding as i32 + 1) / self.slope_step;
        if self.grows_outward {
            let first = (self.vanishing[0] + apart).floor() as usize;
            (first.clamp(self.from, self.to), self.to)
        } else {
            let last = (self.vanishing[0] - apart).ceil() as usize;
            (self.from, last.clamp(self.from, self.to))
        }
    }

    /// Major steps of the fan.
    pub fn steps(&self) -> usize {
        self.to - self.from + 1
    }
}

/// The fans of one light, and where they meet.
#[derive(Debug, Clone)]
pub struct Fans {
    /// Fans that contain at least one pixel.
    pub fans: Vec<Fan>,
    /// Vanishing point of the light direction in pixels (x, y), or the image of a near lamp's place,
    /// seen or not; far away for a light parallel to the image.
    pub vanishing_point: [f64; 2],
    /// Of two points on one ray of light, the one nearer to the lamp is seen further from the
    /// vanishing point (true for every distant lamp on the camera's side of the scene, and for every
    /// near one behind the lens).
    pub lamp_side_outward: bool,
    /// Ways to the lamp can leave the frame inside the scene's range of depth.
    pub leaves_frame: bool,
}

/// The least |z| of a direction: vanishing points stay within a million focal lengths.
const LEAST_Z: f64 = 1e-6;

/// The unit vector from the lens toward a lamp, and how far it is in metres (`None` = distant). Of a
/// lamp inside the lens, which casts no shadow that is seen, any direction does.
pub(super) fn axis(origin: Origin) -> (DVec3, Option<f64>) {
    match origin {
        Origin::Distant(toward) => (toward.as_dvec3(), None),
        Origin::Near(position) => {
            let metres = position.as_dvec3().length();
            let toward = position.as_dvec3().normalize_or(Vec3::NEG_Z.as_dvec3());
            (toward, Some(metres))
        }
    }
}

/// Lays the fans of a light over a pinhole camera's grid.
pub fn fans(camera: &Intrinsics, origin: Origin) -> Fans {
    let (toward, metres) = axis(origin);
    let lamp_side_outward = toward.z < LEAST_Z;
    let z = if toward.z.abs() < LEAST_Z {
        -LEAST_Z
    } else {
        toward.z
    };
    let vanishing_point = [
        camera.cx + camera.fx * toward.x / z,
        camera.cy + camera.fy * toward.y / z,
    ];
    let [vx, vy] = vanishing_point;
    let (width, height) = (camera.width as f64, camera.height as f64);
    let sees_lamp = (-0.5..width - 0.5).contains(&vx) && (-0.5..height - 0.5).contains(&vy);
    let mut fans = Vec::with_capacity(4);
    for along_x in [false, true] {
        let (major_size, minor_size, vanishing) = if along_x {
            (camera.width, camera.height, [vx, vy])
        } else {
            (camera.height, camera.width, [vy, vx])
        };
        for grows_outward in [true, false] {
            fans.extend(fan(
                along_x,
                grows_outward,
                major_size,
                minor_size,
                vanishing,
            ));
        }
    }
    Fans {
        fans,
        vanishing_point,
        lamp_side_outward,
        leaves_frame: lamp_side_outward || metres.is_some() && !sees_lamp,
    }
}

fn fan(
    along_x: bool,
    grows_outward: bool,
    major_size: usize,
    minor_size: usize,
    vanishing: [f64; 2],
) -> Option<Fan> {
    let last = major_size as f64 - 1.0;
    let minor_last = minor_size as f64 - 1.0;
    // Half a pixel around the vanishing point has no direction; those pixels go to whichever fan
    // comes nearest.
    const LEAST_STEP: f64 = 0.25;
    let (from, to) = if grows_outward {
        ((vanishing[0] + LEAST_STEP).ceil().max(0.0), last)
    } else {
        (0.0, (vanishing[0] - LEAST_STEP).floor().min(last))
    };
    if from > to {
        return None;
    }
    // Slopes that reach any pixel of the grid within the fan's quarter of the picture.
    let slopes_at = |major: f64| {
        let step = major - vanishing[0];
        let a = (-vanishing[1]) / step;
        let b = (minor_last - vanishing[1]) / step;
        [a.min(b).clamp(-1.0, 1.0), a.max(b).clamp(-1.0, 1.0)]
    };
    let [near, far] = [slopes_at(from), slopes_at(to)];
    let (least, most) = (near[0].min(far[0]), near[1].max(far[1]));
    let outer = if grows_outward { to } else { from };
    let slope_step = 1.0 / (outer - vanishing[0]).abs();
    let lines = ((most - least) / slope_step).ceil() as usize + 1;
    // A fan that no pixel falls into: its slopes collapse onto one edge of the quarter.
    if most - least <= 0.0 && (least.abs() - 1.0).abs() < 1e-12 {
        return None;
    }
    // minor = vanishing_minor + s (major − vanishing_major), s = least + j · slope_step
    Some(Fan {
        along_x,
        from: from as usize,
        to: to as usize,
        grows_outward,
        lines,
        base: vanishing[1] - least * vanishing[0],
        spread: -slope_step * vanishing[0],
        slope: least,
        spread_slope: slope_step,
        vanishing,
        first_slope: least,
        slope_step,
    })
}
