//! What the depth samples say about themselves, before anything is made of them.

use super::{
    Finding,
    finding::percent,
    look::{Look, quantile},
};
use drivers::Plane;

/// Samples looked at, about, at most.
const SAMPLES: usize = 22_000;
/// Noise of depth, as a share of it, from which surfaces come out wrong.
const HARMFUL_NOISE: f32 = 0.005;
/// Missing share of the lit picture from which too much is guessed.
const HARMFUL_HOLES: f32 = 0.05;
/// Share of the samples beside depth steps that neither neighbour goes along with.
const HARMFUL_FLYING: f32 = 0.15;
/// Share of all samples that stand alone among missing ones.
const HARMFUL_SPECKLE: f32 = 0.004;
/// Depth samples across the picture (root of their number) under which outlines are lost.
const FEWEST_ACROSS: f32 = 90.0;
/// Least step, as a share of the nearer depth.
const STEP: f32 = 0.05;
/// How far a flying sample lies from both of its neighbours, to the same side, as a share of depth.
const ALONE: f32 = 0.03;

/// Counts over the depth frame.
pub(super) struct Samples {
    /// Standard deviation as a share of depth.
    noise: f32,
    /// Share of the lit picture without an answer.
    missing: f32,
    /// Share of the samples beside steps that lie on neither side's surface.
    flying: f32,
    /// Steps found, as a share of all samples.
    steps: f32,
    /// Share of the samples whose neighbours are mostly missing.
    speckle: f32,
}

impl Samples {
    pub fn of(look: &Look<'_>) -> Self {
        let depth = &look.shot.depth.metres;
        let (width, height) = depth.size();
        let rows = depth.len().div_ceil(SAMPLES).max(1);
        let known = |z: f32| z > 0.0 && z.is_finite();
        let mut second = Vec::new();
        let (mut steps, mut flying, mut speckle, mut looked_at) = (0usize, 0usize, 0usize, 0usize);
        for y in (1..height.saturating_sub(1)).step_by(rows) {
            let [above, row, below] = [y - 1, y, y + 1].map(|y| depth.row(y));
            looked_at += width;
            for x in 1..width.saturating_sub(1) {
                let z = row[x];
                if !known(z) {
                    continue;
                }
                let (left, right, up, down) = (row[x - 1], row[x + 1], above[x], below[x]);
                for (a, c) in [(left, right), (up, down)] {
                    // False for NaN.
                    let step = (z - a).abs() > STEP * z.min(a) || (z - c).abs() > STEP * z.min(c);
                    steps += usize::from(step);
                    let (from_a, from_c) = (z - a, z - c);
                    let alone = from_a * from_c > 0.0 && from_a.abs().min(from_c.abs()) > ALONE * z;
                    flying += usize::from(step && alone);
                }
                let ring = [
                    left,
                    right,
                    up,
                    down,
                    above[x - 1],
                    above[x + 1],
                    below[x - 1],
                    below[x + 1],
                ];
                let missing = ring.iter().filter(|z| !known(**z)).count();
                speckle += usize::from(missing >= 5);
                if missing == 0 && x % 2 == 0 {
                    // Blind to planes and quadratics; 6 sigma for white noise (Immerkær 1996).
                    let w = |z: f32| z.recip();
                    let mixed =
                        w(above[x - 1]) + w(above[x + 1]) + w(below[x - 1]) + w(below[x + 1])
                            - 2.0 * (w(left) + w(right) + w(up) + w(down))
                            + 4.0 * w(z);
                    second.push((mixed * z / 6.0).abs());
                }
            }
        }
        let share = |count: usize, of: usize| count as f32 / of.max(1) as f32;
        Self {
            // The quartile of |x| of a unit normal, which edges hardly reach.
            noise: quantile(second, 0.25).unwrap_or(0.0) / 0.318_64,
            missing: missing(look),
            flying: share(flying, steps),
            steps: share(steps, looked_at),
            speckle: share(speckle, looked_at),
        }
    }

    pub fn noise(&self) -> Finding {
        Finding::new("tof-noise", self.noise / HARMFUL_NOISE, None, || {
            format!(
                "depth is noisy by {} of its distance; go nearer, darken the room or let the depth camera average longer",
                percent(self.noise)
            )
        })
    }

    pub fn holes(&self) -> Finding {
        Finding::new(
            "depth-holes",
            self.missing / HARMFUL_HOLES,
            Some(self.missing),
            || {
                format!(
                    "{} of the lit picture has no depth and is guessed; go nearer, or turn shiny and black things",
                    percent(self.missing)
                )
            },
        )
    }

    pub fn flying(&self) -> Finding {
        // A few steps more or less tell nothing.
        let firm = (self.steps / 0.002).min(1.0);
        let affected = self.flying * self.steps;
        Finding::new(
            "flying-pixels",
            firm * self.flying / HARMFUL_FLYING,
            Some(affected),
            || {
                format!(
                    "at {} of the depth steps samples hang between front and back; outlines are uncertain: go nearer or use a finer depth camera",
                    percent(self.flying)
                )
            },
        )
    }

    pub fn infrared_black(&self) -> Finding {
        Finding::new(
            "infrared-black",
            self.speckle / HARMFUL_SPECKLE,
            Some(self.speckle),
            || {
                format!(
                    "{} of the depth samples stand alone among missing ones: something swallows infrared; light it more, go nearer or turn it",
                    percent(self.speckle)
                )
            },
        )
    }
}

/// Share of the lit picture that has no depth of its own.
fn missing(look: &Look<'_>) -> f32 {
    let measured = &look.development.registered.measured;
    let (width, height) = look.size();
    let on_color = look.shot.rig.depth.is_none();
    let (mut lit, mut without) = (0usize, 0usize);
    for y in 0..height {
        for x in 0..width {
            if look.light[(x, y)].is_nan() {
                continue;
            }
            lit += 1;
            let known = if on_color {
                look.metres[(x, y)].is_finite()
            } else {
                at(measured, x * look.stride, y * look.stride)
            };
            without += usize::from(!known);
        }
    }
    without as f32 / lit.max(1) as f32
}

fn at(plane: &Plane<bool>, x: usize, y: usize) -> bool {
    plane.get(x, y).copied().unwrap_or(false)
}

/// A depth camera too coarse for the picture.
pub(super) fn resolution(look: &Look<'_>) -> Finding {
    let color = &look.shot.rig.color;
    let across = match look.shot.rig.depth {
        None => (look.shot.depth.metres.len() as f32).sqrt(),
        // Samples that fall into the photograph's own field of view.
        Some(camera) => {
            let footprint = (camera.lens.fx * camera.lens.fy / (color.fx * color.fy)).sqrt() as f32;
            footprint * ((color.width * color.height) as f32).sqrt()
        }
    };
    Finding::new("low-depth-resolution", FEWEST_ACROSS / across, None, || {
        format!(
            "only {across:.0} depth samples across the picture; outlines and shadows are coarse: go nearer or use a finer depth camera"
        )
    })
}
