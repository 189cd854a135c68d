//! As few lights for an environment as its picture needs.
//!
//! An environment's cells are clusters of clusters; lights stand for clusters, and the cluster whose
//! one light errs most *in the picture of this scene* is replaced by its two parts until the picture
//! is as good as that of all cells within its own noise. The error is not bounded from the materials
//! (Walter et al., "Lightcuts", 2005) but measured on a few thousand pixels that are lit by every cell
//! (Hašan, Pellacini & Bala, "Matrix row-column sampling for the many-light problem", 2007).

mod cut;
pub(super) mod display;
mod sample;
mod tree;

use super::{
    Environment, Lamp, Prepared,
    visibility::{
        VisibilityMap,
        map::{Cells, DIRECTIONS, cell},
    },
};
use cut::{Cut, Sums, add};
use display::Display;
use drivers::Plane;
use rayon::prelude::*;
use sample::Sample;
use tree::{Leaf, Tree, power};

/// Half a step of an 8-bit picture: less is not seen even where there is no noise.
pub const LEAST_NOISE: f32 = 1.0 / 512.0;
/// Share of the noise at which the sample counts as within it: of a few thousand pixels, not of all.
pub(super) const MARGIN: f32 = 0.8;
/// Of what scatters normally, 95 % lies within so many standard deviations.
pub(super) const NORMAL_95: f32 = 1.96;

/// The lights that stand for an environment.
#[derive(Debug, Clone, PartialEq)]
pub struct LightSet {
    /// Swept by themselves at full size, the brightest first.
    pub(super) strong: Vec<Lamp>,
    /// The others: the cell whose shadow each casts, and its lamp.
    pub(super) weak: Vec<(usize, Lamp)>,
}

/// What a set of lights was chosen by. Changes and noise are those of the sRGB picture in which 99 %
/// of the pixels stay below white, white = 1.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Found {
    /// Lights of the set.
    pub lights: usize,
    /// Lights of the environment, one per cell with light in it.
    pub of: usize,
    /// How far the picture under the set is from that under all of them, root mean square over
    /// pixels and channels; 0 where the set is all of them.
    pub rms_change: f32,
    /// The change (root mean square over channels) that 95 % of the pixels stay below.
    pub change_95: f32,
    /// Noise of the picture, root mean square; at least [`LEAST_NOISE`].
    pub noise: f32,
    /// True when no smaller set was within the noise.
    pub capped: bool,
}

impl LightSet {
    /// One light per cell.
    pub fn whole(environment: &Environment) -> Self {
        let strong = environment.strong();
        let (strong, weak) = parted(environment, &strong);
        Self { strong, weak }
    }

    /// A light in every direction: what a visibility map is asked that must do for any environment.
    pub fn everywhere() -> Self {
        let even = Environment::new(&Plane::filled(64, 32, [1.0; 3]));
        Self::whole(&even.expect("an even map has its shape and is not dark"))
    }

    /// At most so many lights (at least one), whatever the scene: the clusters with the widest light
    /// are halved first.
    pub fn of_count(environment: &Environment, count: usize) -> Self {
        let mut strong = environment.strong();
        strong.truncate(count.saturating_sub(1));
        let (strong, weak) = parted(environment, &strong);
        let leaf = |(cell, lamp): (usize, Lamp)| Leaf {
            cell,
            lamp,
            weight: power(&lamp),
        };
        let tree = Tree::new(weak.into_iter().map(leaf).collect());
        let mut cut: Vec<usize> = (0..tree.clusters.len().min(1)).collect();
        while strong.len() + cut.len() < count {
            let spread = |place: &usize| tree.clusters[cut[*place]].spread;
            let splittable =
                (0..cut.len()).filter(|&place| tree.clusters[cut[place]].parts.is_some());
            let Some(widest) = splittable.max_by(|a, b| spread(a).total_cmp(&spread(b))) else {
                break;
            };
            let [left, right] = tree.clusters[cut[widest]].parts.expect("splittable");
            cut[widest] = left;
            cut.push(right);
        }
        let lamp = |cluster: usize| (tree.clusters[cluster].cell, tree.clusters[cluster].lamp);
        Self::new(strong, cut.into_iter().map(lamp))
    }

    /// All its lamps.
    pub fn lamps(&self) -> impl Iterator<Item = &Lamp> {
        self.strong
            .iter()
            .chain(self.weak.iter().map(|(_, lamp)| lamp))
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.strong.len() + self.weak.len()
    }

    /// Directions that a visibility map is asked about.
    pub(super) fn cells(&self) -> Cells {
        let mut cells = [false; DIRECTIONS];
        let strong = self.strong.iter().filter_map(|lamp| cell(lamp.toward()));
        for cell in self.weak.iter().map(|(cell, _)| *cell).chain(strong) {
            cells[cell] = true;
        }
        cells
    }

    /// Lamps without light are left out.
    fn new(strong: Vec<Lamp>, weak: impl Iterator<Item = (usize, Lamp)>) -> Self {
        let weak = weak.filter(|(_, lamp)| power(lamp) > 0.0).collect();
        Self { strong, weak }
    }
}

/// The lamps of the strong cells, and those of the others.
fn parted(environment: &Environment, strong: &[usize]) -> (Vec<Lamp>, Vec<(usize, Lamp)>) {
    let cells: Vec<(usize, Lamp)> = environment.cells().collect();
    let of = |wanted: &usize| cells.iter().find(|(cell, _)| cell == wanted);
    let strong_lamps = strong
        .iter()
        .filter_map(of)
        .map(|(_, lamp)| *lamp)
        .collect();
    let weak = cells
        .iter()
        .filter(|(cell, _)| !strong.contains(cell))
        .copied();
    (strong_lamps, weak.collect())
}

impl Prepared {
    /// The fewest lights under which the picture is that of the whole environment within its noise,
    /// as far as halving finds them.
    ///
    /// `map` is [`Self::visibility_map`] of the whole environment ([`LightSet::whole`]); it serves the
    /// set that is found as well.
    ///
    /// `relative_noise` is the standard deviation of the light of pixel (x, y) of the scene, divided
    /// by that light; what is not finite counts as none. Strong lights, such as a sun, stay by
    /// themselves.
    pub fn light_set(
        &self,
        environment: &Environment,
        map: &VisibilityMap,
        relative_noise: &dyn Fn(usize, usize) -> f32,
    ) -> (LightSet, Found) {
        let sample = Sample::new(self, map);
        let strong_cells = environment.strong();
        let (strong, weak) = parted(environment, &strong_cells);
        let of = strong.len() + weak.len();
        let lit = weak.par_iter().with_min_len(32);
        let lit: Vec<_> = lit.map(|(cell, lamp)| sample.lit(*cell, lamp)).collect();
        // A light counts by what it does to the picture, and a little where that is nothing.
        let leaf = |((cell, lamp), lit): (&(usize, Lamp), &Vec<[f32; 3]>)| Leaf {
            cell: *cell,
            lamp: *lamp,
            weight: sample.mean(lit).iter().sum::<f64>().max(0.0) as f32 + 1e-3 * power(lamp),
        };
        let tree = Tree::new(weak.iter().zip(&lit).map(leaf).collect());
        let sums = Sums::new(sample.pixels.len(), &tree, |cell| {
            let place = weak.iter().position(|(other, _)| *other == cell);
            &lit[place.expect("a leaf is one of the weak cells")]
        });
        let mut all = sums.of(0..tree.leaves.len());
        for (cell, lamp) in strong_cells.iter().zip(&strong) {
            add(&mut all, &sample.lit(*cell, lamp));
        }
        let noise = sample.pixels.iter().map(|&(x, y)| relative_noise(x, y));
        let display = Display::new(&all, &sample.weights, noise);
        let (rms_enough, enough_95) = (MARGIN * display.noise, MARGIN * NORMAL_95 * display.noise);

        let mut cut = Cut::new(&tree, &sums, &sample, &display);
        while cut.rms_change() > rms_enough || cut.change_95() > enough_95 {
            if !cut.halve_worst() {
                break;
            }
        }
        let capped = tree.leaves.len() > 1 && cut.lights().count() == tree.leaves.len();
        let set = LightSet::new(strong, cut.lights());
        let found = Found {
            lights: set.count(),
            of,
            rms_change: cut.rms_change(),
            change_95: cut.change_95(),
            noise: display.noise,
            capped,
        };
        (set, found)
    }
}
