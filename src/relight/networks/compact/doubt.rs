//! What a sweep is unsure of: how thick bodies are.

use crate::relight::{Emitter, Indirect, Prepared, RelightOptions, Shadows};
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

/// A scene with bodies thinner and thicker than guessed, on a grid near the network's.
#[derive(Debug, Clone)]
pub struct Doubt {
    thin: Prepared,
    thick: Prepared,
}

impl Doubt {
    /// Of a scene that casts shadows.
    pub fn of(prepared: &Prepared) -> Self {
        let (small, _) = prepared.reduced(MOST_PIXELS);
        Self {
            thin: small.with_thickness(1.0 / THICKNESS_DOUBT),
            thick: small.with_thickness(THICKNESS_DOUBT),
        }
    }

    /// Visibility with bodies thinner than guessed, and thicker, on that grid.
    pub fn others(&self, lamp: Emitter) -> [Plane<f32>; 2] {
        [&self.thin, &self.thick].map(|scene| scene.seen(lamp).visibility)
    }
}
