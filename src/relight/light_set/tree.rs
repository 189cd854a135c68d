//! Lights that may stand for several: clusters of an environment's cells, halved and halved again.
//!
//! A cluster is cut where the spread of its light around the two new middles is least (Viriyothai &
//! Debevec, "Variance minimization light probe sampling", 2009).

use crate::relight::{Lamp, visibility::map::cell};
use glam::Vec3;
use std::ops::Range;

/// Clusters; the first holds everything, and each is followed by its parts.
#[derive(Debug)]
pub(super) struct Tree {
    /// Ordered so that each cluster is a range of them.
    pub leaves: Vec<Leaf>,
    pub clusters: Vec<Cluster>,
}

/// A cell, its lamp, and what that counts; ≥ 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaf {
    pub cell: usize,
    pub lamp: Lamp,
    pub weight: f32,
}

impl Leaf {
    fn moment(&self) -> Vec3 {
        self.weight * self.lamp.toward()
    }
}

/// Some neighbouring cells and the one lamp that stands for them.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    /// Of the leaves.
    pub range: Range<usize>,
    /// The two clusters it falls into; `None` for a single cell.
    pub parts: Option<[usize; 2]>,
    /// The one of its cells whose shadows are its lamp's.
    pub cell: usize,
    pub lamp: Lamp,
    /// Weight times squared distance on the unit sphere from the cluster's middle.
    pub spread: f32,
}

impl Tree {
    pub fn new(leaves: Vec<Leaf>) -> Self {
        let mut tree = Self {
            leaves,
            clusters: Vec::new(),
        };
        if !tree.leaves.is_empty() {
            tree.clusters.push(cluster(&tree.leaves, 0));
        }
        let mut next = 0;
        while next < tree.clusters.len() {
            let range = tree.clusters[next].range.clone();
            if range.len() > 1 {
                let (left, right) = (tree.clusters.len(), tree.clusters.len() + 1);
                let middle = range.start + halve(&mut tree.leaves[range.clone()]);
                for part in [range.start..middle, middle..range.end] {
                    let start = part.start;
                    tree.clusters.push(cluster(&tree.leaves[part], start));
                }
                tree.clusters[next].parts = Some([left, right]);
            }
            next += 1;
        }
        tree
    }
}

/// All three channels of a lamp together.
pub(super) fn power(lamp: &Lamp) -> f32 {
    lamp.color.iter().sum()
}

/// One lamp in the place of some.
///
/// It stands at the middle of their weight and has of each light what falls onto a surface that faces
/// it. Where light itself is the weight, the sum of light times direction stays what it was: a matte
/// surface that sees and faces all of them cannot tell them from the one.
fn cluster(leaves: &[Leaf], start: usize) -> Cluster {
    let range = start..start + leaves.len();
    if let [leaf] = leaves {
        return Cluster {
            range,
            parts: None,
            cell: leaf.cell,
            lamp: leaf.lamp,
            spread: 0.0,
        };
    }
    let sum: Vec3 = leaves.iter().map(Leaf::moment).sum();
    let total: f32 = leaves.iter().map(|leaf| leaf.weight).sum();
    let heaviest = leaves
        .iter()
        .max_by(|a, b| a.weight.total_cmp(&b.weight))
        .expect("a cluster holds cells");
    // Lights on opposite sides have their middle where no light can stand; such a cluster is as wide
    // as the sky and soon halved.
    let lamp = Lamp::from_person([sum.x, -sum.y, -sum.z])
        .ok()
        .filter(|lamp| cell(lamp.toward()).is_some())
        .unwrap_or(heaviest.lamp);
    let toward = lamp.toward();
    // The middle of a bent cluster can lie in a cell of another.
    let near = |leaf: &Leaf| leaf.lamp.toward().dot(toward);
    let nearest = leaves.iter().max_by(|a, b| near(a).total_cmp(&near(b)));
    let color = std::array::from_fn(|channel| {
        let facing = |leaf: &Leaf| leaf.lamp.color[channel] * leaf.lamp.toward().dot(toward);
        leaves.iter().map(facing).sum::<f32>().max(0.0)
    });
    Cluster {
        range,
        parts: None,
        cell: nearest.unwrap_or(heaviest).cell,
        lamp: lamp.with_color(color).unwrap_or(lamp),
        // Of unit vectors: total · (1 − |mean|²).
        spread: (total - sum.length_squared() / total.max(f32::MIN_POSITIVE)).max(0.0),
    }
}

/// Orders the cells along the axis and returns the place where cutting leaves the least spread.
fn halve(leaves: &mut [Leaf]) -> usize {
    let mut best = (f32::NEG_INFINITY, 0, leaves.len() / 2);
    for axis in 0..3 {
        sort(leaves, axis);
        let all: Vec3 = leaves.iter().map(Leaf::moment).sum();
        let total: f32 = leaves.iter().map(|leaf| leaf.weight).sum();
        let (mut before, mut weight) = (Vec3::ZERO, 0.0);
        for (place, leaf) in leaves[..leaves.len() - 1].iter().enumerate() {
            before += leaf.moment();
            weight += leaf.weight;
            // What the spread of the two halves is less than that of all by, but for a constant.
            let kept =
                |moment: Vec3, weight: f32| moment.length_squared() / weight.max(f32::MIN_POSITIVE);
            let kept = kept(before, weight) + kept(all - before, total - weight);
            if kept > best.0 {
                best = (kept, axis, place + 1);
            }
        }
    }
    sort(leaves, best.1);
    best.2
}

fn sort(leaves: &mut [Leaf], axis: usize) {
    leaves.sort_by(|a, b| {
        let along = a.lamp.toward()[axis].total_cmp(&b.lamp.toward()[axis]);
        along.then(a.cell.cmp(&b.cell))
    });
}
