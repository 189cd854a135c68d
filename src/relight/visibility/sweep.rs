//! One light, one pass: the union of blocked intervals carried along every line.

use super::{
    lines::{Fan, Fans, LANES, fans},
    occluders::{Occluders, Slab},
};
use glam::Vec3;
use rayon::prelude::*;

/// Disjoint blocked intervals remembered per line; when more would be needed the one met first
/// (nearest to the lamp) is forgotten. Scenes of the test set need three.
const SLOTS: usize = 4;

/// Set in an answer when the path to the lamp leaves the frame inside the scene's depth range.
pub(super) const UNSEEN: u8 = 0x80;
/// Fully lit, in the lower seven bits of an answer.
pub(super) const LIT: u8 = 127;

/// Neighbouring pixels belong to one surface when their depths differ by less than what a
/// surface tilted this many times (tangent) would show.
const STEEPEST_TANGENT: f32 = 8.0;

/// Softness of the comparison in standard deviations of the difference of two depths.
const SIGMAS: f32 = 1.5;

/// Visibility of one light, one answer per line sample.
#[derive(Debug)]
pub struct Swept {
    pub(super) fans: Fans,
    /// Per fan: `[block][step][lane]`, seven bits of visibility and [`UNSEEN`].
    pub(super) answers: Vec<Vec<u8>>,
}

/// Sweeps all lines of the light in direction `toward` (unit, camera axes).
///
/// Cost is proportional to the number of pixels, whatever the direction.
pub fn sweep(occluders: &Occluders, toward: Vec3) -> Swept {
    let fans = fans(&occluders.camera, toward);
    let answers = fans
        .fans
        .iter()
        .map(|fan| {
            let block = fan.steps() * LANES;
            let mut answers = vec![0u8; block * fan.blocks()];
            let arch = pulp::Arch::new();
            answers.par_chunks_mut(block).with_min_len(4).enumerate().for_each(|(index, out)| {
                let walk = Walk::new(occluders, fan, fans.lamp_side_outward, toward, index);
                arch.dispatch(
                    #[inline(always)]
                    || walk.run(out),
                );
            });
            answers
        })
        .collect();
    Swept { fans, answers }
}

type Lanes = [f32; LANES];

#[inline(always)]
fn each(value: impl Fn(usize) -> f32) -> Lanes {
    std::array::from_fn(value)
}

/// Eight neighbouring lines on their way from the lamp's side to the other.
struct Walk<'a> {
    slabs: &'a [Slab],
    /// Samples per step of the major axis.
    stride: usize,
    fan: &'a Fan,
    /// The lamp's side is at the large major coordinates.
    downward: bool,
    start: Lanes,
    slope: Lanes,
    /// |r × L| = `axis_start + m · axis_slope` along the line.
    axis_start: Lanes,
    axis_slope: Lanes,
    /// Value of v / |r × L| = z at the frame's edge under which an occluder outside the frame
    /// can be excluded.
    near_metres: f32,
    leaves_frame: bool,
    edge: f32,
}

impl<'a> Walk<'a> {
    fn new(occluders: &'a Occluders, fan: &'a Fan, lamp_side_outward: bool, toward: Vec3, block: usize) -> Self {
        let camera = &occluders.camera;
        let plane = if fan.along_x { &occluders.by_column } else { &occluders.by_row };
        let mut walk = Self {
            slabs: plane.samples(),
            stride: plane.width(),
            fan,
            downward: lamp_side_outward == fan.grows_outward,
            start: [0.0; LANES],
            slope: [0.0; LANES],
            axis_start: [0.0; LANES],
            axis_slope: [0.0; LANES],
            near_metres: occluders.near_metres,
            leaves_frame: lamp_side_outward,
            edge: STEEPEST_TANGENT / (camera.fx.min(camera.fy) as f32),
        };
        let distance_from_axis = |major: usize, minor: f64| {
            let (x, y) =
                if fan.along_x { (major as f64, minor) } else { (minor, major as f64) };
            let ray =
                glam::DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
            ray.cross(toward.as_dvec3()).length()
        };
        for lane in 0..LANES {
            let (start, slope) = fan.line(block * LANES + lane);
            walk.start[lane] = start;
            walk.slope[lane] = slope;
            let at = |m: usize| distance_from_axis(m, f64::from(start) + f64::from(slope) * m as f64);
            let (first, last) = (at(fan.from), at(fan.to));
            let axis_slope = (last - first) / (fan.to.max(fan.from + 1) - fan.from) as f64;
            walk.axis_slope[lane] = axis_slope as f32;
            walk.axis_start[lane] = (first - axis_slope * fan.from as f64) as f32;
        }
        walk
    }

    #[inline(always)]
    fn run(&self, out: &mut [u8]) {
        let steps = self.fan.steps();
        let last = (self.stride - 1) as f32;
        let mut lo = [[f32::INFINITY; LANES]; SLOTS];
        let mut hi = [[f32::NEG_INFINITY; LANES]; SLOTS];
        let mut previous_v = [0.0f32; LANES];
        let mut previous_z = [0.0f32; LANES];
        // |r × L| where the line entered the frame: what lies further out was not seen.
        let mut entry = [f32::INFINITY; LANES];
        for step in 0..steps {
            let offset = if self.downward { steps - 1 - step } else { step };
            let major = self.fan.from + offset;
            let m = major as f32;
            let minor = each(|l| self.start[l] + self.slope[l] * m);
            let mut inside = [false; LANES];
            for l in 0..LANES {
                inside[l] = minor[l] >= -0.5 && minor[l] <= last + 0.5;
            }
            if !inside.iter().any(|&is| is) {
                continue;
            }
            let row = &self.slabs[major * self.stride..(major + 1) * self.stride];
            let mut q = [0.0f32; LANES];
            let mut packed = [0u32; LANES];
            for l in 0..LANES {
                let at = minor[l].max(0.0).min(last);
                let index = (at as usize).min(self.stride - 1);
                let fraction = at - index as f32;
                let (a, b) = (row[index], row[(index + 1).min(self.stride - 1)]);
                let nearest = if fraction < 0.5 { a } else { b };
                let between = a.inverse_depth + (b.inverse_depth - a.inverse_depth) * fraction;
                let sigma = f32::from_bits(nearest.thickness_sigma << 16);
                let jump = (self.edge + 2.0 * sigma * nearest.inverse_depth) * nearest.inverse_depth;
                let one_surface = (a.inverse_depth - b.inverse_depth).abs() < jump;
                q[l] = if one_surface { between } else { nearest.inverse_depth };
                packed[l] = nearest.thickness_sigma;
            }
            let z = each(|l| 1.0 / q[l]);
            let known: [bool; LANES] = std::array::from_fn(|l| inside[l] && q[l] > 0.0);
            let axis = each(|l| (self.axis_start[l] + self.axis_slope[l] * m).max(0.0));
            let thickness = each(|l| f32::from_bits(packed[l] & 0xffff_0000));
            let sigma = each(|l| f32::from_bits(packed[l] << 16));
            let v = each(|l| axis[l] * z[l]);
            for l in 0..LANES {
                entry[l] = if inside[l] && entry[l] == f32::INFINITY { axis[l] } else { entry[l] };
            }

            // Compare against what has been passed.
            let softness = each(|l| {
                axis[l] * sigma[l] * (SIGMAS * std::f32::consts::SQRT_2)
                    + 0.5 * self.axis_slope[l].abs() * z[l]
            });
            let per_softness = each(|l| 0.5 / softness[l].max(1e-12));
            let mut blocked = [0.0f32; LANES];
            for k in 0..SLOTS {
                for l in 0..LANES {
                    let under = ((v[l] - lo[k][l]) * per_softness[l]).max(0.0).min(1.0);
                    let over = ((hi[k][l] - v[l]) * per_softness[l] + 0.5).max(0.0).min(1.0);
                    blocked[l] = blocked[l].max(under * over);
                }
            }
            for l in 0..LANES {
                let lit = (LIT as f32 * (1.0 - blocked[l]) + 0.5) as i32 as u8;
                let exit_z = v[l] / entry[l];
                let unseen = self.leaves_frame && exit_z > self.near_metres;
                out[offset * LANES + l] = lit | if unseen { UNSEEN } else { 0 };
            }

            // Add this sample's slab, reaching to its neighbour on the same surface.
            let mut a = [0.0f32; LANES];
            let mut b = [0.0f32; LANES];
            for l in 0..LANES {
                let joined =
                    (z[l] - previous_z[l]).abs() < (2.0 * self.edge + 2.0 * sigma[l] * q[l]) * z[l];
                let front = if joined { v[l].min(previous_v[l]) } else { v[l] };
                let back = axis[l] * (z[l] + thickness[l]);
                let back = if joined { back.max(previous_v[l]) } else { back };
                a[l] = if known[l] { front } else { f32::INFINITY };
                b[l] = if known[l] { back } else { f32::NEG_INFINITY };
                previous_z[l] = if known[l] { z[l] } else { f32::INFINITY };
                previous_v[l] = v[l];
            }
            for k in 0..SLOTS {
                for l in 0..LANES {
                    let overlap = lo[k][l] <= b[l] && hi[k][l] >= a[l];
                    a[l] = if overlap { a[l].min(lo[k][l]) } else { a[l] };
                    b[l] = if overlap { b[l].max(hi[k][l]) } else { b[l] };
                    lo[k][l] = if overlap { f32::INFINITY } else { lo[k][l] };
                    hi[k][l] = if overlap { f32::NEG_INFINITY } else { hi[k][l] };
                }
            }
            for k in 0..SLOTS {
                for l in 0..LANES {
                    // The newest goes first; what it displaces moves on until a slot is free.
                    let full = a[l] <= b[l];
                    let (slot_lo, slot_hi) = (lo[k][l], hi[k][l]);
                    lo[k][l] = if full { a[l] } else { slot_lo };
                    hi[k][l] = if full { b[l] } else { slot_hi };
                    a[l] = if full { slot_lo } else { a[l] };
                    b[l] = if full { slot_hi } else { b[l] };
                }
            }
        }
    }
}
