//! One resolution's way to the least total generalised variation.

use super::level::Level;
use fearless_simd::{Level as Vectors, dispatch};
use rayon::prelude::*;

/// Step lengths of the primal-dual method (Chambolle & Pock 2011): value and slope down, their two
/// multipliers up. A slope is some hundredth of the noise, its multiplier some ones, so their steps
/// differ as much. 8·0.04·2 + 0.005·2 + 8·0.005·8 = 0.97 ≤ 1 as convergence asks.
const VALUE_STEP: f32 = 0.04;
const SLOPE_STEP: f32 = 0.005;
const JUMP_STEP: f32 = 2.0;
const BEND_STEP: f32 = 8.0;

/// Pixels that are worth a task.
const PIXELS_PER_TASK: usize = 8192;

/// √½: the mixed derivative counts twice in a bend's square.
const MIXED: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Where the descent stands. Planes as in [`Level`].
#[derive(Debug, Clone)]
pub(super) struct State {
    pub value: Vec<f32>,
    /// Change per pixel to the right and down.
    pub slope: [Vec<f32>; 2],
    /// Twice the newest value less the one before, and the same of the slopes.
    ahead: [Vec<f32>; 3],
    /// Multiplier of what the slope does not explain of the change to the right and below.
    jump: [Vec<f32>; 2],
    /// Multiplier of the slope's change: across, down, mixed.
    bend: [Vec<f32>; 3],
}

impl State {
    /// Starts at what was measured, flat.
    pub fn new(level: &Level) -> Self {
        let nothing = || vec![0.0; level.len()];
        Self {
            value: level.measured.clone(),
            slope: std::array::from_fn(|_| nothing()),
            ahead: std::array::from_fn(|_| nothing()),
            jump: std::array::from_fn(|_| nothing()),
            bend: std::array::from_fn(|_| nothing()),
        }
    }

    /// Goes on from half the resolution, multipliers included; planes are continued within a pixel,
    /// never mixed with their neighbours.
    pub fn finer(&self, from: &Level, to: &Level) -> Self {
        let mut fine = Self::new(to);
        for y in 0..to.height {
            for x in 0..to.width {
                let (at, coarse) = (to.place(x, y), from.place(x / 2, y / 2));
                if to.trust[at] == 0.0 {
                    continue;
                }
                let off = [x, y].map(|i| if i % 2 == 0 { -0.25 } else { 0.25 });
                fine.value[at] = self.value[coarse]
                    + off[0] * self.slope[0][coarse]
                    + off[1] * self.slope[1][coarse];
                for (fine, coarse_plane) in fine.slope.iter_mut().zip(&self.slope) {
                    fine[at] = 0.5 * coarse_plane[coarse];
                }
                for (fine, coarse_plane) in fine.jump.iter_mut().zip(&self.jump) {
                    fine[at] = 2.0 * coarse_plane[coarse];
                }
                for (fine, coarse_plane) in fine.bend.iter_mut().zip(&self.bend) {
                    fine[at] = 4.0 * coarse_plane[coarse];
                }
            }
        }
        fine
    }

    /// `steps` steps toward the least sum of half the squared misfit, `jump_cost` for what slopes do not
    /// explain and `bend_cost` for how slopes change.
    pub fn descend(&mut self, level: &Level, jump_cost: f32, bend_cost: f32, steps: usize) {
        self.ahead[0].copy_from_slice(&self.value);
        self.ahead[1].copy_from_slice(&self.slope[0]);
        self.ahead[2].copy_from_slice(&self.slope[1]);
        for _ in 0..steps {
            self.up(level, jump_cost, bend_cost);
            self.down(level);
        }
    }

    fn up(&mut self, level: &Level, jump_cost: f32, bend_cost: f32) {
        let stride = level.stride();
        let end = level.len() - stride;
        let [value, across, down] = &self.ahead;
        let [right, below] = &mut self.jump;
        let [first, second, mixed] = &mut self.bend;
        let tasks = right[stride..end]
            .par_chunks_mut(PIXELS_PER_TASK)
            .zip(below[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(first[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(second[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(mixed[stride..end].par_chunks_mut(PIXELS_PER_TASK));
        tasks
            .enumerate()
            .for_each(|(i, ((((right, below), first), second), mixed))| {
                let from = stride + i * PIXELS_PER_TASK;
                let ascent = Ascent {
                    ahead: [value, across, down].map(|plane| Around::new(plane, from, right.len(), stride)),
                    bonds: [&level.right, &level.below].map(|plane| &plane[from..][..right.len()]),
                    jump_cost,
                    bend_cost,
                };
                dispatch!(Vectors::new(), _simd => ascent.run([right, below], [first, second, mixed]));
            });
    }

    fn down(&mut self, level: &Level) {
        let stride = level.stride();
        let end = level.len() - stride;
        let Self {
            value,
            slope: [across, down],
            ahead: [value_ahead, across_ahead, down_ahead],
            jump,
            bend,
        } = self;
        let tasks = value[stride..end]
            .par_chunks_mut(PIXELS_PER_TASK)
            .zip(across[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(down[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(value_ahead[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(across_ahead[stride..end].par_chunks_mut(PIXELS_PER_TASK))
            .zip(down_ahead[stride..end].par_chunks_mut(PIXELS_PER_TASK));
        tasks.enumerate().for_each(
            |(i, (((((value, across), down), value_ahead), across_ahead), down_ahead))| {
                let from = stride + i * PIXELS_PER_TASK;
                let around = |plane| Before::new(plane, from, value.len(), stride);
                let descent = Descent {
                    jump: jump.each_ref().map(|plane| around(plane)),
                    bend: bend.each_ref().map(|plane| around(plane)),
                    bonds: [around(&level.right), around(&level.below)],
                    measured: &level.measured[from..][..value.len()],
                    trust: &level.trust[from..][..value.len()],
                };
                dispatch!(Vectors::new(), _simd => descent.run(
                    [value, across, down],
                    [value_ahead, across_ahead, down_ahead],
                ));
            },
        );
    }
}

/// A stretch of a plane with the pixels to the right and below.
struct Around<'a> {
    here: &'a [f32],
    right: &'a [f32],
    below: &'a [f32],
}

impl<'a> Around<'a> {
    fn new(plane: &'a [f32], from: usize, count: usize, stride: usize) -> Self {
        Self {
            here: &plane[from..][..count],
            right: &plane[from + 1..][..count],
            below: &plane[from + stride..][..count],
        }
    }

    /// Here, right, below: all of one length, so that no bound is checked.
    #[inline(always)]
    fn parts(&self, count: usize) -> (&'a [f32], &'a [f32], &'a [f32]) {
        (
            &self.here[..count],
            &self.right[..count],
            &self.below[..count],
        )
    }
}

/// A stretch of a plane with the pixels to the left and above.
struct Before<'a> {
    here: &'a [f32],
    left: &'a [f32],
    above: &'a [f32],
}

impl<'a> Before<'a> {
    fn new(plane: &'a [f32], from: usize, count: usize, stride: usize) -> Self {
        Self {
            here: &plane[from..][..count],
            left: &plane[from - 1..][..count],
            above: &plane[from - stride..][..count],
        }
    }

    /// Here, left, above.
    #[inline(always)]
    fn parts(&self, count: usize) -> (&'a [f32], &'a [f32], &'a [f32]) {
        (
            &self.here[..count],
            &self.left[..count],
            &self.above[..count],
        )
    }
}

/// What a step of the multipliers reads.
struct Ascent<'a> {
    ahead: [Around<'a>; 3],
    bonds: [&'a [f32]; 2],
    jump_cost: f32,
    bend_cost: f32,
}

impl Ascent<'_> {
    #[inline(always)]
    fn run(&self, [right, below]: [&mut [f32]; 2], [first, second, mixed]: [&mut [f32]; 3]) {
        let count = right.len();
        let (below, first) = (&mut below[..count], &mut first[..count]);
        let (second, mixed) = (&mut second[..count], &mut mixed[..count]);
        let [bond_right, bond_below] = self.bonds.map(|plane| &plane[..count]);
        let [value, across, down] = self.ahead.each_ref().map(|plane| plane.parts(count));
        for i in 0..count {
            let (to_right, to_below) = (bond_right[i], bond_below[i]);
            let x = right[i] + JUMP_STEP * to_right * (value.1[i] - value.0[i] - across.0[i]);
            let y = below[i] + JUMP_STEP * to_below * (value.2[i] - value.0[i] - down.0[i]);
            let share = self.jump_cost / (x * x + y * y).sqrt().max(self.jump_cost);
            right[i] = share * x;
            below[i] = share * y;
            let x = first[i] + BEND_STEP * to_right * (across.1[i] - across.0[i]);
            let y = second[i] + BEND_STEP * to_below * (down.2[i] - down.0[i]);
            let both = to_below * (across.2[i] - across.0[i]) + to_right * (down.1[i] - down.0[i]);
            let both = mixed[i] + BEND_STEP * MIXED * both;
            let share = self.bend_cost / (x * x + y * y + both * both).sqrt().max(self.bend_cost);
            first[i] = share * x;
            second[i] = share * y;
            mixed[i] = share * both;
        }
    }
}

/// What a step of value and slope reads.
struct Descent<'a> {
    jump: [Before<'a>; 2],
    bend: [Before<'a>; 3],
    bonds: [Before<'a>; 2],
    measured: &'a [f32],
    trust: &'a [f32],
}

impl Descent<'_> {
    #[inline(always)]
    fn run(&self, [value, across, down]: [&mut [f32]; 3], ahead: [&mut [f32]; 3]) {
        let count = value.len();
        let (across, down) = (&mut across[..count], &mut down[..count]);
        let [value_ahead, across_ahead, down_ahead] = ahead.map(|plane| &mut plane[..count]);
        let (measured, trust) = (&self.measured[..count], &self.trust[..count]);
        let [right, below] = self.jump.each_ref().map(|plane| plane.parts(count));
        let [first, second, mixed] = self.bend.each_ref().map(|plane| plane.parts(count));
        let [bond_right, bond_below] = self.bonds.each_ref().map(|plane| plane.parts(count));
        for i in 0..count {
            let (r, l) = (bond_right.0[i], bond_right.1[i]);
            let (b, a) = (bond_below.0[i], bond_below.2[i]);
            let (jump_right, jump_below) = (r * right.0[i], b * below.0[i]);
            let pull = jump_right - l * right.1[i] + jump_below - a * below.2[i];
            let weight = VALUE_STEP * trust[i];
            let moved = (value[i] + VALUE_STEP * pull + weight * measured[i]) / (1.0 + weight);
            value_ahead[i] = 2.0 * moved - value[i];
            value[i] = moved;
            let pull = jump_right + r * first.0[i] - l * first.1[i]
                + MIXED * (b * mixed.0[i] - a * mixed.2[i]);
            let moved = across[i] + SLOPE_STEP * pull;
            across_ahead[i] = 2.0 * moved - across[i];
            across[i] = moved;
            let pull = jump_below + b * second.0[i] - a * second.2[i]
                + MIXED * (r * mixed.0[i] - l * mixed.1[i]);
            let moved = down[i] + SLOPE_STEP * pull;
            down_ahead[i] = 2.0 * moved - down[i];
            down[i] = moved;
        }
    }
}
