//! What a network says on its own grid, on that of the photograph.

use super::{
    super::{Channels, grid::resampled},
    finite,
};
use crate::relight::enlarge::Stretch;
use drivers::Plane;

/// A network's answer that varies slowly, row by row of a larger grid; 0 where it says no number.
///
/// It goes there by half the network's grid: its last layer works on half the picture's sides, and leaves a pattern
/// from pixel to pixel.
pub(super) struct Told {
    channels: Vec<Plane<f32>>,
    stretch: Stretch,
    width: usize,
}

impl Told {
    /// `answer` on a grid of `size`.
    pub(super) fn new(answer: &Channels, size: (usize, usize)) -> Self {
        let (width, height) = answer.size;
        let half = (width / 2, height / 2);
        let channel = |index: usize| {
            let samples = answer.channel(index).iter().copied().map(finite).collect();
            resampled(
                &Plane::new(width, height, samples).expect("one per pixel"),
                half,
            )
        };
        Self {
            channels: (0..answer.count).map(channel).collect(),
            stretch: Stretch::new(half, size),
            width: size.0,
        }
    }

    /// Row `y` of every channel.
    pub(super) fn row(&self, y: usize) -> Vec<Vec<f32>> {
        let mut between = Vec::new();
        let channels = self.channels.iter();
        let row = |channel: &Plane<f32>| {
            let mut row = vec![0.0; self.width];
            self.stretch
                .row(channel.samples(), y, &mut between, &mut row);
            row
        };
        channels.map(row).collect()
    }
}
