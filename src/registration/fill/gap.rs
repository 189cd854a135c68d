//! What an unknown pixel makes of the measurements around it.

use super::sweep::Look;

/// Sum of color edges (255ths of √light) after which a measurement counts 1/e.
const EDGE_SCALE: f32 = 12.0;
/// Reach as a fraction of the longer side; beyond it a gap is not filled.
const REACH: f32 = 1.0 / 10.0;
/// Reach past the rim of all measurements, where nothing on the other side confirms, as a fraction.
const REACH_UNCONFIRMED: f32 = 1.0 / 160.0;
/// Relative step of depth that is one surface however near the measurements lie.
const SAME_SURFACE: f32 = 0.02;
/// Slope of a surface that runs through a gap (tangent).
const SLOPE_THROUGH_GAP: f32 = 2.0;
/// Standard deviation of a surface's slope inside a gap (tangent).
const SLOPE_SIGMA: f32 = 0.3;
/// How much the farther of two surfaces is preferred, with and without a guide.
const BACKGROUND_PREFERENCE: f32 = 2.0;
const BACKGROUND_PREFERENCE_BLIND: f32 = 50.0;
/// Relative depth error expected when every way to a measurement crosses a strong edge.
const BEHIND_EDGE_SIGMA: f32 = 0.1;

/// Weighs the four answers.
pub(super) struct Judge {
    reach: u16,
    reach_unconfirmed: u16,
    per_focal: f32,
    background: f32,
    /// `exp(−edges / EDGE_SCALE)`.
    openness: Vec<f32>,
}

/// One answer: inverse depth, metres, sigma, weight, pixels away.
#[derive(Clone, Copy)]
struct Answer {
    inverse: f32,
    metres: f32,
    sigma: f32,
    weight: f32,
    distance: f32,
}

impl Judge {
    pub fn new(longer_side: usize, focal_pixels: f32, guided: bool) -> Self {
        let reach = |share: f32| (share * longer_side as f32).clamp(2.0, 60_000.0) as u16;
        Self {
            reach: reach(REACH),
            reach_unconfirmed: reach(REACH_UNCONFIRMED),
            per_focal: 1.0 / focal_pixels,
            background: if guided {
                BACKGROUND_PREFERENCE
            } else {
                BACKGROUND_PREFERENCE_BLIND
            },
            openness: (0..256)
                .map(|edges| (-(edges as f32) / EDGE_SCALE).exp())
                .collect(),
        }
    }

    /// Measurements on two opposite sides within reach, or one very near.
    #[inline(always)]
    pub fn may_answer(&self, looks: [Look; 4]) -> bool {
        let [left, right, up, down] = looks.map(Look::distance);
        left.max(right) <= self.reach
            || up.max(down) <= self.reach
            || left.min(right).min(up.min(down)) <= self.reach_unconfirmed
    }

    /// `[metres, sigma]` from the measurement `source(n)` each direction sees.
    pub fn answer(&self, looks: [Look; 4], source: impl Fn(usize) -> [f32; 2]) -> Option<[f32; 2]> {
        let mut answers = [Answer {
            inverse: 0.0,
            metres: 0.0,
            sigma: 0.0,
            weight: 0.0,
            distance: 0.0,
        }; 4];
        let mut count = 0;
        let mut openest = 0.0f32;
        for (n, look) in looks.into_iter().enumerate() {
            if look.distance() > self.reach {
                continue;
            }
            let [metres, sigma] = source(n);
            let distance = f32::from(look.distance());
            let openness = self.openness[usize::from(look.edges().min(255))];
            openest = openest.max(openness);
            // Kept above 0 so that a gap fenced in by edges is still an average.
            let weight = openness.max(1e-9) / distance;
            answers[count] = Answer {
                inverse: 1.0 / metres,
                metres,
                sigma,
                weight,
                distance,
            };
            count += 1;
        }
        let answers = &mut answers[..count];
        answers.sort_unstable_by(|a, b| a.metres.total_cmp(&b.metres));
        let cut = self.widest_step(answers)?;
        let (near, far) = answers.split_at(cut);
        let weight = |side: &[Answer]| side.iter().map(|a| a.weight).sum::<f32>();
        let (for_near, for_far) = (weight(near), self.background * weight(far));
        let (chosen, lost) = if for_near > for_far {
            (near, for_far)
        } else {
            (far, for_near)
        };
        let doubt = lost / (for_near + for_far);
        let total = weight(chosen);
        let inverses = chosen.iter().map(|a| a.weight * a.inverse);
        let metres = 1.0 / (inverses.sum::<f32>() / total);
        let nearness: f32 = chosen.iter().map(|a| 1.0 / a.distance).sum();
        let step = if near.is_empty() {
            0.0
        } else {
            mean_of(far) - mean_of(near)
        };
        let scatter = |a: &Answer| a.sigma * a.sigma + (a.metres - metres) * (a.metres - metres);
        let scatters = chosen.iter().map(|a| a.weight * scatter(a));
        let variance = scatters.sum::<f32>() / total
            + (SLOPE_SIGMA * metres * self.per_focal / nearness).powi(2)
            + doubt * step * step
            + (1.0 - openest) * (BEHIND_EDGE_SIGMA * metres).powi(2);
        Some([metres, variance.sqrt()])
    }

    /// Where sorted answers fall into a near and a far surface; 0 when they lie on one.
    fn widest_step(&self, answers: &[Answer]) -> Option<usize> {
        let (first, last) = (answers.first()?, answers.last()?);
        let span: f32 = answers.iter().map(|a| a.distance).fold(0.0, f32::max);
        let one = first.metres * (SAME_SURFACE + SLOPE_THROUGH_GAP * self.per_focal * span)
            + 3.0 * (first.sigma + last.sigma);
        if last.metres - first.metres <= one {
            return Some(0);
        }
        (1..answers.len()).max_by(|&a, &b| {
            let step = |n: usize| answers[n].metres - answers[n - 1].metres;
            step(a).total_cmp(&step(b))
        })
    }
}

fn mean_of(side: &[Answer]) -> f32 {
    side.iter().map(|a| a.metres).sum::<f32>() / side.len() as f32
}
