//! What a network says on its own grid, on that of the photograph.

use super::{
    super::{Channels, grid::resampled},
    finite,
};
use crate::relight::enlarge::Stretch;
use drivers::Plane;

/// A network's answer that varies slowly, row by row of a larger grid; 0 where it says no number.
///
/// It goes there by a coarser grid, that of the network's last layer, which leaves a pattern from pixel to pixel of the finer.
pub(super) struct Told {
    channels: Vec<Plane<f32>>,
    stretch: Stretch,
    width: usize,
}

impl Told {
    /// `answer`, said on a grid `coarser` times coarser than its own, on a grid of `size`.
    pub(super) fn new(answer: &Channels, coarser: usize, size: (usize, usize)) -> Self {
        let (width, height) = answer.size;
        let said = (width / coarser, height / coarser);
        let channel = |index: usize| {
            let samples = answer.channel(index).iter().copied().map(finite).collect();
            resampled(
                &Plane::new(width, height, samples).expect("one per pixel"),
                said,
            )
        };
        Self {
            channels: (0..answer.count).map(channel).collect(),
            stretch: Stretch::new(said, size),
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
