//! How much of a lamp a row of pixels sees.

use super::{prepared::Prepared, visibility::Answers};
use drivers::Plane;
use rayon::prelude::*;

/// Where a row's visibility comes from.
pub(super) enum Source<'a> {
    /// No cast shadows.
    AllLit,
    /// Straight from the lines.
    Lines(&'a Answers<'a>),
    /// From what was answered before.
    Known(&'a Plane<f32>),
    /// From a pinhole grid, through a lookup.
    Straightened {
        visibility: Plane<f32>,
        unseen: usize,
        lookup: &'a Plane<u32>,
    },
}

impl<'a> Source<'a> {
    pub(super) fn new(prepared: &'a Prepared, answers: Option<&'a Answers<'a>>) -> Self {
        match (answers, &prepared.straightened) {
            (None, _) => Self::AllLit,
            (Some(answers), None) => Self::Lines(answers),
            (Some(answers), Some(lookup)) => {
                let mut visibility = Plane::filled(prepared.width, prepared.height, 1.0);
                let unseen = visibility
                    .samples_mut()
                    .par_chunks_mut(prepared.width)
                    .enumerate()
                    .map(|(y, row)| answers.row(y, row))
                    .sum();
                Self::Straightened {
                    visibility,
                    unseen,
                    lookup,
                }
            }
        }
    }

    /// Visibility of row `y`; returns the count of lit pixels with an unseen path.
    pub(super) fn row(&self, y: usize, out: &mut [f32]) -> usize {
        match self {
            Self::AllLit => {
                out.fill(1.0);
                0
            }
            Self::Lines(answers) => answers.row(y, out),
            Self::Known(visibility) => {
                out.copy_from_slice(visibility.row(y));
                0
            }
            Self::Straightened {
                visibility,
                unseen,
                lookup,
            } => {
                for (out, &index) in out.iter_mut().zip(lookup.row(y)) {
                    *out = visibility
                        .samples()
                        .get(index as usize)
                        .copied()
                        .unwrap_or(1.0);
                }
                // Counted once for the whole picture.
                if y == 0 { *unseen } else { 0 }
            }
        }
    }
}
