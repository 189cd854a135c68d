//! Where depth steps, and whether the photograph shows something there.

use super::{
    Finding,
    finding::percent,
    look::{Look, quantile},
};
use drivers::Plane;
use rayon::prelude::*;

/// Least step, as a share of the nearer depth, that a slope does not explain.
const STEP: f32 = 0.03;
/// Contrast, in natural logarithms of light, under which the photograph shows nothing.
const UNSEEN: f32 = 0.04;
/// Step from which a surface of one color would look clearly darker behind.
const TALL: f32 = 0.2;
/// Steps looked at, at most.
const MOST_STEPS: usize = 400;
/// How far depth may lie beside the photograph, pixels at 256×256.
const REACH: f32 = 10.0;
/// Distance between photograph and depth that does harm, pixels at 256×256.
const HARMFUL_SHIFT: f32 = 1.4;
/// Share of what the best place of all places gains over a middling one that it must gain over none.
const CLEARLY_BETTER: f32 = 0.12;
/// Length of steps that nothing in the photograph explains, in sides of the picture.
const HARMFUL_UNSEEN: f32 = 0.25;
/// How much less than bright surfaces, in natural logarithms, near things may send.
const DARKEST: f32 = 3.4;
/// How near, as a share of the depth of the far things.
const NEARER: f32 = 0.5;
/// Pixels from one that is asked what it sends to the next.
const EVERY: usize = 3;
/// Share of the picture whose depth its light contradicts.
const HARMFUL_WRAPPED: f32 = 0.004;
/// Share of the picture's rim that nearer things cross.
const HARMFUL_RIM: f32 = 0.7;

/// One pixel of one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// The left or upper of the two pixels.
    pub x: usize,
    pub y: usize,
    /// True between left and right, false between upper and lower.
    pub across: bool,
    /// Its rise as a share of the nearer depth, > 0.
    pub height: f32,
    /// True where the photograph changes there.
    pub seen: bool,
}

/// All steps of the depth.
pub(super) struct Steps {
    pub found: Vec<Step>,
    side: f32,
}

impl Steps {
    pub fn of(look: &Look<'_>) -> Self {
        let (width, height) = look.size();
        let found = (0..height)
            .into_par_iter()
            .with_min_len(16)
            .flat_map_iter(|y| {
                let mut row = Vec::new();
                for x in 0..width {
                    for across in [true, false] {
                        row.extend(step_at(look, x, y, across));
                    }
                }
                row
            })
            .collect();
        Self {
            found,
            side: look.side(),
        }
    }

    /// True where things stand before others: half a side's length of outlines at least.
    pub fn outline(&self, look: &Look<'_>) -> bool {
        self.found.len() as f32 > 0.5 * look.side()
    }

    /// Depth that lies beside the photograph: where the outlines of depth fit the photograph's best.
    pub fn misalignment(&self, look: &Look<'_>) -> Finding {
        let pixel = self.side / 256.0;
        let shift = self.best_shift(&look.light, (REACH * pixel).round() as isize);
        let length = (shift[0] as f32).hypot(shift[1] as f32) / pixel;
        let on_photograph = length * pixel * look.photograph_pixels();
        Finding::new("misalignment", length / HARMFUL_SHIFT, None, || {
            format!(
                "depth lies {on_photograph:.0} pixels beside the photograph; calibrate the rig again and take both pictures at the same moment"
            )
        })
    }

    /// The shift of depth (right, down) under which the photograph changes most at its steps; zero
    /// where no other is clearly better.
    fn best_shift(&self, light: &Plane<f32>, reach: isize) -> [isize; 2] {
        let step = self.found.len().div_ceil(MOST_STEPS).max(1);
        let steps: Vec<Step> = self.found.iter().step_by(step).copied().collect();
        if steps.is_empty() {
            return [0, 0];
        }
        let contrast = |x: isize, y: isize, across: bool| {
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else {
                return 0.0;
            };
            let there = if across {
                light.get(x + 1, y)
            } else {
                light.get(x, y + 1)
            };
            match (light.get(x, y), there) {
                (Some(a), Some(b)) if !(a - b).is_nan() => (a - b).abs().min(0.4),
                _ => 0.0,
            }
        };
        let sum = |dx: isize, dy: isize| -> f32 {
            steps
                .iter()
                .map(|step| contrast(step.x as isize + dx, step.y as isize + dy, step.across))
                .sum()
        };
        let none = sum(0, 0);
        let shifts: Vec<(f32, [isize; 2])> = (-reach..=reach)
            .into_par_iter()
            .flat_map_iter(|dy| (-reach..=reach).map(move |dx| [dx, dy]))
            .map(|[dx, dy]| (sum(dx, dy), [dx, dy]))
            .collect();
        let mean = shifts.iter().map(|(sum, _)| sum).sum::<f32>() / shifts.len() as f32;
        let best = shifts.iter().max_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((best, shift)) if best - none > CLEARLY_BETTER * (best - mean) => *shift,
            _ => [0, 0],
        }
    }

    /// Surfaces that show depth behind them: steps back at which the photograph goes on.
    pub fn mirror(&self, look: &Look<'_>) -> Finding {
        let unseen = self
            .found
            .iter()
            .filter(|step| step.height > TALL && !step.seen)
            .count();
        // Under any light but a flash what is far may be as bright as what is near.
        let tells = look.development.scene.flash_lit;
        let length = f32::from(u8::from(tells)) * unseen as f32 / self.side.max(1.0);
        Finding::new("mirror", length / HARMFUL_UNSEEN, None, || {
            "depth steps where the photograph goes on: something mirrors infrared; turn it, or powder it for the picture".into()
        })
    }

    /// Distances beyond the depth camera's range: what is said to be near sends far too little light.
    pub fn phase_wrap(&self, look: &Look<'_>) -> Finding {
        let Some(sent) = Sent::of(look) else {
            return Finding::new("phase-wrap", 0.0, None, String::new);
        };
        let pixels = look.light.samples().iter().zip(look.metres.samples());
        let pixels = pixels.step_by(EVERY);
        let asked = pixels.len();
        let contradicted = pixels
            .filter(|(light, metres)| sent.contradicts(**light, **metres))
            .count();
        let share = contradicted as f32 / asked.max(1) as f32;
        Finding::new("phase-wrap", share / HARMFUL_WRAPPED, Some(share), || {
            format!(
                "{} of the picture sends too little light for the near depth it has: it lies beyond the depth camera's range; go nearer or choose a longer range",
                percent(share)
            )
        })
    }

    /// Nearer things that the picture's rim cuts: how far they reach is unknown.
    pub fn occluders_outside(&self, look: &Look<'_>) -> Finding {
        let share = cut_share(&rim(&look.metres));
        Finding::new(
            "out-of-frame-occluders",
            share / HARMFUL_RIM,
            Some(share),
            || {
                format!(
                    "things in front cross {} of the picture's rim; their shadows are guessed: step back or aim at their middle",
                    percent(share)
                )
            },
        )
    }
}

/// What surfaces send of the flash's light: near things that send far too little are not near.
pub(super) struct Sent {
    bright: f32,
    far: f32,
}

impl Sent {
    /// `None` where the light is not a flash's, or nothing is known.
    pub fn of(look: &Look<'_>) -> Option<Self> {
        let pixels = look.light.samples().iter().zip(look.metres.samples());
        let pixels = || pixels.clone().step_by(EVERY);
        let sent = pixels().map(|(light, metres)| Self::by(*light, *metres));
        let found = Self {
            bright: quantile(sent.collect(), 0.75)?,
            far: quantile(pixels().map(|(_, metres)| *metres).collect(), 0.9)?,
        };
        look.development.scene.flash_lit.then_some(found)
    }

    /// By a surface at a depth, natural logarithm of light at one metre.
    pub fn by(light: f32, metres: f32) -> f32 {
        light + 2.0 * metres.ln()
    }

    /// Whether light speaks against so small a depth.
    pub fn contradicts(&self, light: f32, metres: f32) -> bool {
        Self::by(light, metres) < self.bright - DARKEST && metres < NEARER * self.far
    }
}

fn step_at(look: &Look<'_>, x: usize, y: usize, across: bool) -> Option<Step> {
    let next = if across { (x + 1, y) } else { (x, y + 1) };
    let (here, there) = (look.metres[(x, y)], *look.metres.get(next.0, next.1)?);
    let rise = there - here;
    let least = STEP * here.min(there);
    if rise.is_nan() || rise.abs() <= least {
        return None;
    }
    let at = |plane: &Plane<f32>, steps: isize| {
        let (dx, dy) = if across { (steps, 0) } else { (0, steps) };
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        plane.get(x, y).copied().filter(|value| !value.is_nan())
    };
    let before = at(&look.metres, -1).map_or(0.0, |before| here - before);
    let after = at(&look.metres, 2).map_or(0.0, |after| after - there);
    let unexplained = (rise - before).abs().min((rise - after).abs());
    (unexplained > least).then(|| {
        let light = |steps| at(&look.light, steps).unwrap_or(f32::NAN);
        let (a, b, c, d) = (light(-1), light(0), light(1), light(2));
        let most = (a - d)
            .abs()
            .max((b - c).abs())
            .max((a - b).abs())
            .max((c - d).abs());
        Step {
            x,
            y,
            across,
            height: rise.abs() / here.min(there),
            // Dark or unknown light says nothing against a step.
            seen: b.is_nan() || c.is_nan() || most > UNSEEN,
        }
    })
}

/// Depth along the picture's rim, once around.
fn rim(metres: &Plane<f32>) -> Vec<f32> {
    let (width, height) = metres.size();
    if width < 2 || height < 2 {
        return Vec::new();
    }
    let top = (0..width).map(|x| (x, 0));
    let right = (1..height).map(|y| (width - 1, y));
    let bottom = (0..width - 1).rev().map(|x| (x, height - 1));
    let left = (1..height - 1).rev().map(|y| (0, y));
    top.chain(right)
        .chain(bottom)
        .chain(left)
        .map(|at| metres[at])
        .collect()
}

/// Share of the rim inside runs that begin with a step forward and end with a step back.
fn cut_share(rim: &[f32]) -> f32 {
    let (mut inside, mut run) = (0, None);
    for pair in rim.windows(2) {
        let rise = (pair[1] / pair[0]).ln();
        if let Some(length) = &mut run {
            *length += 1;
        }
        if rise < -STEP {
            run = Some(0);
        } else if rise > STEP {
            inside += run.take().unwrap_or(0);
        }
    }
    inside as f32 / rim.len().max(1) as f32
}
