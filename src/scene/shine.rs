//! Whether the photograph shows that surfaces shine, and that they shine differently.

use super::roughness::{CANDIDATES, Evidence, candidate, expected};
use rayon::prelude::*;

/// Pieces with fewer rings of angle than this say nothing about a model that was fitted to half of them.
const FEWEST_RINGS: usize = 6;

/// How well three nested models of the highlights predict the photograph: none, one roughness for
/// all, one for each piece of surface.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shine {
    /// Per piece of surface the mean squared misfit of each model at angles it was not fitted to, in
    /// variances of what was measured there.
    pub held_out: Vec<[f32; 3]>,
    /// −2 × logarithm of the likelihood of each model, fitted to everything, up to a constant.
    pub deviance: [f64; 3],
    /// Roughnesses that each model has.
    pub parameters: [usize; 3],
    /// Angles measured, over all pieces.
    pub samples: usize,
}

/// Weighs the three models against each other, over the pieces of surface that show enough angles.
pub(super) fn shine(evidence: &[Evidence]) -> Shine {
    let pieces: Vec<[Split; 3]> = evidence
        .par_iter()
        .filter_map(|piece| {
            let rings = piece.profile().len();
            (rings >= FEWEST_RINGS).then(|| {
                [
                    Split::new(piece, |_| true),
                    Split::new(piece, |ring| ring % 2 == 0),
                    Split::new(piece, |ring| ring % 2 == 1),
                ]
            })
        })
        .collect();
    if pieces.is_empty() {
        return Shine::default();
    }
    let [whole, even, odd] = [0, 1, 2].map(|half| together(&pieces, half));
    let held_out = pieces.iter().map(|[_, first, second]| {
        // What one half says, asked of the other.
        let cross = |fitted: &Split, asked: &Split, all: usize| {
            let matte = asked.misfit_beside(fitted, None);
            let one = asked.misfit_beside(fitted, Some(candidate(all)));
            let own = asked.misfit_beside(fitted, Some(fitted.roughness()));
            [matte, one, own]
        };
        let (a, b) = (cross(first, second, even), cross(second, first, odd));
        let rings = (first.evidence.profile().len() + second.evidence.profile().len()) as f32;
        std::array::from_fn(|model| (a[model] + b[model]) / rings)
    });
    let sum = |of: &dyn Fn(&Split) -> f32| -> f64 {
        pieces.iter().map(|[all, ..]| f64::from(of(all))).sum()
    };
    Shine {
        held_out: held_out.collect(),
        deviance: [
            sum(&|all| all.matte),
            sum(&|all| all.misfits[whole]),
            sum(&|all| all.misfits.iter().copied().fold(f32::INFINITY, f32::min)),
        ],
        parameters: [0, 1, pieces.len()],
        samples: pieces
            .iter()
            .map(|[all, ..]| all.evidence.profile().len())
            .sum(),
    }
}

/// A piece of surface, or every second ring of it.
struct Split {
    evidence: Evidence,
    misfits: [f32; CANDIDATES],
    /// Without any highlight.
    matte: f32,
}

impl Split {
    fn new(piece: &Evidence, keeps: impl Fn(usize) -> bool) -> Self {
        let evidence = piece.some_rings(keeps);
        Self {
            misfits: evidence.misfits(),
            matte: evidence.misfit(None),
            evidence,
        }
    }

    fn roughness(&self) -> f32 {
        expected(&self.evidence.log_likelihood()).0
    }

    /// Squared misfit in variances, summed over its rings, with the albedo that `fitted` has under
    /// this roughness.
    fn misfit_beside(&self, fitted: &Split, roughness: Option<f32>) -> f32 {
        self.evidence
            .misfit_of(roughness, fitted.evidence.albedo(roughness))
    }
}

/// The candidate that all pieces agree on best.
fn together(pieces: &[[Split; 3]], half: usize) -> usize {
    let mut best = (f32::INFINITY, 0);
    for index in 0..CANDIDATES {
        let total = pieces.iter().map(|piece| piece[half].misfits[index]).sum();
        if total < best.0 {
            best = (total, index);
        }
    }
    best.1
}
