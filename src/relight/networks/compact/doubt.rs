//! What a sweep is unsure of: how thick bodies are.

use crate::relight::{Emitter, Indirect, Prepared, RelightOptions, Shadows, networks::resampled};
use drivers::Plane;

/// Pixels that bodies are made thinner and thicker on, at most: the network sees no more than half of them.
const MOST_PIXELS: usize = 2 * super::MOST_PIXELS;

/// Bodies may be so many times thinner or thicker than guessed.
const THICKNESS_DOUBT: f32 = 2.5;

/// The light that comes straight from the lamp, as if nothing stood in its way.
pub const UNSHADOWED: RelightOptions = RelightOptions {
    shadows: Shadows::None,
    indirect: Indirect::None,
};

/// A scene with bodies as thick as guessed, thinner and thicker, on a grid near the network's.
#[derive(Debug, Clone)]
pub struct Doubt {
    /// Absent where that grid is the photograph's.
    guessed: Option<Prepared>,
    thin: Prepared,
    thick: Prepared,
}

impl Doubt {
    /// Of a scene that casts shadows.
    pub fn of(prepared: &Prepared) -> Self {
        let (small, factor) = prepared.reduced(MOST_PIXELS);
        Self {
            thin: small.with_thickness(1.0 / THICKNESS_DOUBT),
            thick: small.with_thickness(THICKNESS_DOUBT),
            guessed: (factor > 1).then_some(small),
        }
    }

    /// Visibility with bodies as thick as guessed, thinner and thicker, on a grid of `size`; `seen` is the first of them on
    /// the photograph's.
    pub fn seen(&self, lamp: Emitter, seen: &Plane<f32>, size: (usize, usize)) -> [Plane<f32>; 3] {
        // A sweep of few pixels takes less time than means over many.
        let guessed = self.guessed.as_ref().map_or_else(
            || resampled(seen, size),
            |small| resampled(&small.seen(lamp).visibility, size),
        );
        let [thin, thick] =
            [&self.thin, &self.thick].map(|scene| resampled(&scene.seen(lamp).visibility, size));
        [guessed, thin, thick]
    }
}
