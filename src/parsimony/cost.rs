//! What terms cost on this machine.

use super::terms::{Bounced, Geometry, Shadow, Terms};
use crate::{relight::networks::compact::MOST_PIXELS, scene::Material};
use serde::{Deserialize, Serialize};

/// Milliseconds as a straight line over pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Without any pixel, milliseconds; ≥ 0.
    pub fixed_ms: f64,
    /// Milliseconds per million pixels; ≥ 0.
    pub per_megapixel_ms: f64,
}

impl Line {
    /// The line through two measurements `(pixels, milliseconds)`, never falling and never below 0.
    pub fn through(small: (usize, f64), large: (usize, f64)) -> Self {
        let megapixels = |(pixels, _): (usize, f64)| pixels as f64 / 1e6;
        let rise = (large.1 - small.1) / (megapixels(large) - megapixels(small)).max(1e-9);
        let per_megapixel_ms = rise.clamp(0.0, (large.1 / megapixels(large)).max(0.0));
        Self {
            fixed_ms: (large.1 - per_megapixel_ms * megapixels(large)).max(0.0),
            per_megapixel_ms,
        }
    }

    /// Milliseconds for so many pixels.
    pub fn at(&self, pixels: usize) -> f64 {
        self.fixed_ms + self.per_megapixel_ms * pixels as f64 / 1e6
    }

    fn is_usable(&self) -> bool {
        let usable = |value: f64| value.is_finite() && (0.0..1e7).contains(&value);
        usable(self.fixed_ms) && usable(self.per_megapixel_ms)
    }
}

/// What every step costs on one machine, with its threads. Pixels are those of the working grid but
/// for `radiometry`, `alignment`, `reduce` and `enlarge`, which take the photograph's.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CostModel {
    /// Flash − ambient, as they lie.
    pub radiometry: Line,
    /// What aligning the pair adds.
    pub alignment: Line,
    /// The photograph on a coarser grid, once a shot.
    pub reduce: Line,
    /// Depth on the color grid.
    pub registration: Line,
    /// Matte surfaces on one plane.
    pub flat: Line,
    /// What measured shape adds.
    pub shape: Line,
    /// What one roughness adds.
    pub one_roughness: Line,
    /// What varying roughness adds to that.
    pub varying: Line,
    /// Slabs to cast shadows.
    pub slabs: Line,
    /// What each surface sees of the others.
    pub obscurance: Line,
    /// A lamp without shadows.
    pub lamp: Line,
    /// What cast shadows add to a lamp.
    pub sweep: Line,
    /// What a network's correction adds to a lamp, without the network itself.
    pub correction: Line,
    /// The compact network of surfaces, once a shot; pixels are those of its own grid.
    pub surfaces_network: Line,
    /// The compact network of light, once a lamp; pixels are those of its own grid.
    pub light_network: Line,
    /// From a coarser grid to the photograph's, a lamp.
    pub enlarge: Line,
    /// A look at the small copy.
    pub glance: Line,
    /// Bringing both networks into memory, once.
    pub network_load_ms: f64,
}

/// What a shot asks of the terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workload {
    /// Of the photograph.
    pub pixels: usize,
    /// Most pixels of a working grid.
    pub working_pixels: usize,
    /// Lamps.
    pub lamps: usize,
}

impl CostModel {
    /// Whether every number can be one.
    pub fn is_usable(mut self) -> bool {
        let (lines, times) = self.parts();
        lines.iter().all(|line| line.is_usable())
            && times
                .iter()
                .all(|ms| ms.is_finite() && (0.0..1e7).contains(*ms))
    }

    /// The costs when everything takes `pace` times as long.
    #[must_use]
    pub fn at_pace(mut self, pace: f64) -> Self {
        let (lines, times) = self.parts();
        for line in lines {
            line.fixed_ms *= pace;
            line.per_megapixel_ms *= pace;
        }
        for ms in times {
            *ms *= pace;
        }
        self
    }

    fn parts(&mut self) -> ([&mut Line; 17], [&mut f64; 1]) {
        let lines = [
            &mut self.radiometry,
            &mut self.alignment,
            &mut self.reduce,
            &mut self.registration,
            &mut self.flat,
            &mut self.shape,
            &mut self.one_roughness,
            &mut self.varying,
            &mut self.slabs,
            &mut self.obscurance,
            &mut self.lamp,
            &mut self.sweep,
            &mut self.correction,
            &mut self.surfaces_network,
            &mut self.light_network,
            &mut self.enlarge,
            &mut self.glance,
        ];
        (lines, [&mut self.network_load_ms])
    }

    /// Milliseconds from the flash's light to the relit pictures, on a grid reduced by `factor` a side.
    pub fn rest_ms(&self, terms: Terms, factor: usize, work: Workload) -> f64 {
        let grid = work.pixels / (factor * factor).max(1);
        let mut shot = self.registration.at(grid) + self.flat.at(grid);
        if terms.geometry != Geometry::Plane {
            shot += self.shape.at(grid);
        }
        if terms.material != Material::Matte {
            shot += self.one_roughness.at(grid);
        }
        if terms.material == Material::Varying {
            shot += self.varying.at(grid);
        }
        if terms.shadow != Shadow::None {
            shot += self.slabs.at(grid);
        }
        if terms.indirect == Bounced::Predicted {
            shot += self.obscurance.at(grid);
        }
        let mut lamp = self.lamp.at(grid);
        if terms.shadow != Shadow::None {
            lamp += self.sweep.at(grid);
        }
        if terms.shadow == Shadow::Network {
            let own = grid.min(MOST_PIXELS);
            lamp += self.light_network.at(own) + self.correction.at(grid);
            // Thinner and thicker slabs are made ready too.
            shot += self.network_load_ms + self.surfaces_network.at(own) + self.slabs.at(grid);
        }
        if factor > 1 {
            shot += self.reduce.at(work.pixels);
            lamp += self.enlarge.at(work.pixels);
        }
        shot + lamp * work.lamps as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_meets_both_measurements_and_never_falls() {
        let line = Line::through((100_000, 3.0), (300_000, 7.0));
        assert!((line.at(100_000) - 3.0).abs() < 1e-9 && (line.at(300_000) - 7.0).abs() < 1e-9);
        let falling = Line::through((100_000, 5.0), (300_000, 4.0));
        assert!((falling.at(300_000) - 4.0).abs() < 1e-9 && falling.per_megapixel_ms == 0.0);
        let steep = Line::through((100_000, 0.1), (300_000, 9.0));
        assert!(steep.fixed_ms == 0.0 && (steep.at(300_000) - 9.0).abs() < 1e-9);
    }

    #[test]
    fn more_terms_never_cost_less() {
        let line = Line {
            fixed_ms: 0.1,
            per_megapixel_ms: 10.0,
        };
        let costs = CostModel {
            registration: line,
            flat: line,
            shape: line,
            varying: line,
            slabs: line,
            obscurance: line,
            lamp: line,
            sweep: line,
            light_network: line,
            ..CostModel::default()
        };
        let work = Workload {
            pixels: 250_000,
            working_pixels: 2_000_000,
            lamps: 3,
        };
        let ms = |terms| costs.rest_ms(terms, 1, work);
        assert!(ms(Terms::FEWEST) < ms(Terms::CLOSED) && ms(Terms::CLOSED) < ms(Terms::EVERYTHING));
        assert!(costs.rest_ms(Terms::CLOSED, 2, work) < ms(Terms::CLOSED));
    }
}
