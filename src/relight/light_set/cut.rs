//! Which clusters of an environment's cells have one light each, and what the scene says to that.

use super::{display::Display, sample::Sample, tree::Tree};
use crate::relight::Lamp;
use std::ops::Range;

/// Most that a lamp's light is raised to be that of its cells.
const MOST_GAIN: f32 = 4.0;

/// Clusters that together hold every cell once, and how far the picture under their lights is from
/// that under all cells.
pub(super) struct Cut<'a> {
    tree: &'a Tree,
    sums: &'a Sums,
    sample: &'a Sample,
    display: &'a Display,
    chosen: Vec<Candidate>,
    /// Light of each pixel under the clusters' lights less that under all cells.
    change: Vec<[f32; 3]>,
}

impl<'a> Cut<'a> {
    /// Everything as one cluster.
    pub fn new(tree: &'a Tree, sums: &'a Sums, sample: &'a Sample, display: &'a Display) -> Self {
        let mut cut = Self {
            tree,
            sums,
            sample,
            display,
            chosen: Vec::new(),
            change: sums.of(0..tree.leaves.len()),
        };
        for value in cut.change.as_flattened_mut() {
            *value = -*value;
        }
        if !tree.clusters.is_empty() {
            cut.choose(0);
        }
        cut
    }

    /// The cells whose shadows the lights have, and the lights.
    pub fn lights(&self) -> impl Iterator<Item = (usize, Lamp)> {
        let light =
            |candidate: &Candidate| (self.tree.clusters[candidate.cluster].cell, candidate.lamp);
        self.chosen.iter().map(light)
    }

    /// The change as displayed, root mean square.
    pub fn rms_change(&self) -> f32 {
        self.display.root_mean_square(&self.change)
    }

    /// The change as displayed that 95 % of the pixels stay below.
    pub fn change_95(&self) -> f32 {
        self.display.quantile_95(&self.change)
    }

    /// Puts its two parts in the place of the cluster whose light errs most; false where every cell
    /// has its own.
    pub fn halve_worst(&mut self) -> bool {
        let parts = |candidate: &Candidate| self.tree.clusters[candidate.cluster].parts;
        let worst = self
            .chosen
            .iter()
            .enumerate()
            .filter_map(|(place, candidate)| Some((place, candidate.error, parts(candidate)?)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((place, _, parts)) = worst else {
            return false;
        };
        let whole = self.chosen.swap_remove(place);
        let lit = whole.lit.as_flattened();
        for (change, lit) in self.change.as_flattened_mut().iter_mut().zip(lit) {
            *change -= lit;
        }
        for part in parts {
            self.choose(part);
        }
        true
    }

    fn choose(&mut self, cluster: usize) {
        let part = Candidate::new(cluster, self.tree, self.sums, self.sample, self.display);
        add(&mut self.change, &part.lit);
        self.chosen.push(part);
    }
}

/// A cluster whose light may be in the set.
struct Candidate {
    cluster: usize,
    lamp: Lamp,
    /// The pixels under its one light.
    lit: Vec<[f32; 3]>,
    /// How far that is from the pixels under all its cells, root mean square as displayed.
    error: f32,
}

impl Candidate {
    /// The lamp is as bright as its cells: the pixels together get from it, channel by channel, what
    /// they get from them.
    fn new(index: usize, tree: &Tree, sums: &Sums, sample: &Sample, display: &Display) -> Self {
        let cluster = &tree.clusters[index];
        let cells = sums.of(cluster.range.clone());
        if cluster.parts.is_none() {
            return Self {
                cluster: index,
                lamp: cluster.lamp,
                lit: cells,
                error: 0.0,
            };
        }
        let mut lit = sample.lit(cluster.cell, &cluster.lamp);
        let (wanted, given) = (sample.mean(&cells), sample.mean(&lit));
        let gain: [f32; 3] = std::array::from_fn(|channel| {
            let gain = (wanted[channel] / given[channel]) as f32;
            // Of a lamp that hardly anything sees, no brightness makes the others.
            if (0.0..=MOST_GAIN).contains(&gain) {
                gain
            } else {
                1.0
            }
        });
        let mut change = cells;
        for (change, lit) in change.iter_mut().zip(&mut lit) {
            for channel in 0..3 {
                lit[channel] *= gain[channel];
                change[channel] -= lit[channel];
            }
        }
        let color = std::array::from_fn(|channel| cluster.lamp.color[channel] * gain[channel]);
        Self {
            cluster: index,
            lamp: cluster.lamp.with_color(color).unwrap_or(cluster.lamp),
            lit,
            error: display.root_mean_square(&change),
        }
    }
}

/// The pixels under the first cell, the first two cells and so on: under any range by a subtraction.
pub(super) struct Sums(Vec<Vec<[f32; 3]>>);

impl Sums {
    /// Of the leaves of a tree; `lit` says what the pixels, so many, are under a cell.
    pub fn new<'a>(pixels: usize, tree: &Tree, lit: impl Fn(usize) -> &'a Vec<[f32; 3]>) -> Self {
        let mut sum = vec![[0.0; 3]; pixels];
        let mut sums = vec![sum.clone()];
        for leaf in &tree.leaves {
            add(&mut sum, lit(leaf.cell));
            sums.push(sum.clone());
        }
        Self(sums)
    }

    pub fn of(&self, cells: Range<usize>) -> Vec<[f32; 3]> {
        let (before, until) = (&self.0[cells.start], &self.0[cells.end]);
        let pixels = until.iter().zip(before);
        pixels
            .map(|(until, before)| std::array::from_fn(|c| until[c] - before[c]))
            .collect()
    }
}

pub(super) fn add(sum: &mut [[f32; 3]], lit: &[[f32; 3]]) {
    for (sum, lit) in sum.as_flattened_mut().iter_mut().zip(lit.as_flattened()) {
        *sum += lit;
    }
}
