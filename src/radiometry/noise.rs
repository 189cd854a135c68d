//! How much a pixel scatters: shot, read and quantisation noise.
//!
//! `variance(u) = read + shot · u` for light `u` as a fraction of white (Foi, Trimeche, Katkovnik &
//! Egiazarian, "Practical Poissonian–Gaussian noise modeling and fitting for single-image raw-data",
//! IEEE TIP 2008); quantisation is added by the curve of each frame.

use super::LinearImage;
use rayon::prelude::*;

/// What a sensor's data sheet says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Electrons at white level and base gain; > 0.
    pub full_well_electrons: f32,
    /// Read noise in electrons, standard deviation; ≥ 0.
    pub read_electrons: f32,
    /// Depth of its converter in bits; 1 to 16.
    pub bits: u32,
}

/// Variance of light as an affine function of light.
///
/// Light is meant as a fraction of white, before division by the exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Variance in the dark; ≥ 0.
    pub read_variance: f32,
    /// Growth of the variance with light; ≥ 0.
    pub shot_slope: f32,
}

impl NoiseModel {
    /// The model of a known sensor at a linear gain.
    ///
    /// White level is `full_well / gain` electrons; the converter's own step counts as read noise.
    pub fn of_sensor(sensor: &Sensor, gain: f32) -> Self {
        let electrons_at_white = sensor.full_well_electrons / gain;
        let steps = (1u32 << sensor.bits.clamp(1, 16)) as f32 - 1.0;
        Self {
            read_variance: (sensor.read_electrons / electrons_at_white).powi(2)
                + (1.0 / steps).powi(2) / 12.0,
            shot_slope: electrons_at_white.recip(),
        }
    }

    /// Variance of light `relative` to white, squared fraction of white.
    pub fn variance(&self, relative: f32) -> f32 {
        self.read_variance + self.shot_slope * relative.max(0.0)
    }

    /// Estimates the model from the picture itself, where the sensor is unknown.
    ///
    /// Each sample's noise shows in the second-difference mask of Immerkær ("Fast noise variance
    /// estimation", CVIU 1996), which cancels planes. The answers are sorted by brightness into
    /// bins; of each bin the lower quartile counts, which texture hardly reaches, and an affine
    /// model is fitted to the bins by least relative deviation. Denoised or strongly compressed
    /// pictures have correlated noise and come out too quiet.
    ///
    /// `light` is at unit exposure and was divided by `factor`.
    pub(super) fn estimate(light: &LinearImage, factor: f32, grid: Grid) -> Self {
        let bins = scatter_by_brightness(light, factor, grid);
        fit(&bins)
    }
}

/// Which samples of a picture are independent of each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Grid {
    /// Every pixel, every channel.
    Full,
    /// Only the green samples of a mosaic; the offset is that of even rows.
    BayerGreen {
        /// Column of the first green sample in row 0.
        offset: usize,
    },
}

/// Positions looked at, at most.
const POSITIONS: usize = 24_000;
/// Brightness bins.
const BINS: usize = 24;
/// `|x|` of a unit normal lies below this with probability ¼.
const LOWER_QUARTILE_OF_NORMAL: f32 = 0.318_64;

/// Mean light and variance of each brightness bin.
fn scatter_by_brightness(light: &LinearImage, factor: f32, grid: Grid) -> Vec<[f32; 2]> {
    let (width, height) = light.0.size();
    let (reach, channels) = match grid {
        Grid::Full => (1, 0..3),
        Grid::BayerGreen { .. } => (2, 1..2),
    };
    if width <= 2 * reach || height <= 2 * reach {
        return Vec::new();
    }
    let stride = ((width * height / POSITIONS) as f32).sqrt().ceil().max(1.0) as usize;
    let seen: Vec<[f32; 2]> = (reach..height - reach)
        .into_par_iter()
        .step_by(stride)
        .flat_map_iter(|y| {
            let rows = [
                light.0.row(y - reach),
                light.0.row(y),
                light.0.row(y + reach),
            ];
            let channels = channels.clone();
            (reach..width - reach).step_by(stride).flat_map(move |x| {
                let x = match grid {
                    Grid::Full => x,
                    // Step to the green sample at or just left of x.
                    Grid::BayerGreen { offset } => {
                        x - usize::from((x + y + offset) % 2 == 1 && x > reach)
                    }
                };
                channels.clone().filter_map(move |channel| {
                    let at = |row: usize, column: usize| rows[row][column][channel];
                    let (l, r) = (x - reach, x + reach);
                    let corners = at(0, l) + at(0, r) + at(2, l) + at(2, r);
                    let sides = at(0, x) + at(1, l) + at(1, r) + at(2, x);
                    let answer = (corners - 2.0 * sides + 4.0 * at(1, x)) / 6.0;
                    let mean = (corners + sides + at(1, x)) / 9.0;
                    answer
                        .is_finite()
                        .then_some([mean * factor, (answer * factor).abs()])
                })
            })
        })
        .collect();
    if seen.is_empty() {
        return Vec::new();
    }
    let mut bins = by_brightness(&seen);
    bins.retain(|bin| !bin.is_empty());
    bins.iter_mut()
        .map(|bin| {
            let mean = bin.iter().map(|sample| sample[0]).sum::<f32>() / bin.len() as f32;
            let quartile = bin.len() / 4;
            let (_, answer, _) = bin.select_nth_unstable_by(quartile, |a, b| a[1].total_cmp(&b[1]));
            [mean, (answer[1] / LOWER_QUARTILE_OF_NORMAL).powi(2)]
        })
        .collect()
}

/// Samples in [`BINS`] bins of rising brightness and nearly as many in each: what is alike to one part in a hundred stays
/// together.
fn by_brightness(seen: &[[f32; 2]]) -> Vec<Vec<[f32; 2]>> {
    // The upper half of a number's bits, in the order of the numbers.
    let place = |sample: &[f32; 2]| {
        let bits = sample[0].to_bits() >> 16;
        (if bits & 0x8000 == 0 {
            bits | 0x8000
        } else {
            !bits & 0xffff
        }) as usize
    };
    let mut before = vec![0usize; 1 << 16];
    for sample in seen {
        before[place(sample)] += 1;
    }
    let mut sum = 0;
    for count in &mut before {
        sum += std::mem::replace(count, sum);
    }
    let mut bins = vec![Vec::new(); BINS];
    for sample in seen {
        bins[before[place(sample)] * BINS / seen.len()].push(*sample);
    }
    bins
}

/// Least relative deviation by reweighting, both coefficients held at or above zero.
fn fit(bins: &[[f32; 2]]) -> NoiseModel {
    let mut model = NoiseModel {
        read_variance: 0.0,
        shot_slope: 0.0,
    };
    if bins.is_empty() {
        return model;
    }
    let floor = bins.iter().map(|bin| bin[1]).fold(0.0, f32::max).max(1e-12) * 1e-3;
    let mut weights: Vec<f64> = bins
        .iter()
        .map(|bin| f64::from(bin[1].max(floor)).powi(-2))
        .collect();
    for _ in 0..10 {
        let [mut s, mut sx, mut sxx, mut sy, mut sxy] = [0.0f64; 5];
        for (bin, w) in bins.iter().zip(&weights) {
            let (x, y) = (f64::from(bin[0].max(0.0)), f64::from(bin[1]));
            s += w;
            sx += w * x;
            sxx += w * x * x;
            sy += w * y;
            sxy += w * x * y;
        }
        let determinant = s * sxx - sx * sx;
        let (mut read, mut shot) = if determinant > 1e-9 * s * sxx {
            (
                (sxx * sy - sx * sxy) / determinant,
                (s * sxy - sx * sy) / determinant,
            )
        } else {
            (sy / s, 0.0)
        };
        if shot < 0.0 {
            (read, shot) = (sy / s, 0.0);
        } else if read < 0.0 {
            (read, shot) = (0.0, if sxx > 0.0 { sxy / sxx } else { 0.0 });
        }
        model = NoiseModel {
            read_variance: read as f32,
            shot_slope: shot as f32,
        };
        for (bin, w) in bins.iter().zip(&mut weights) {
            let scale = f64::from(bin[1].max(floor));
            let off = (f64::from(bin[1] - model.variance(bin[0])) / scale).abs();
            *w = 1.0 / (scale * scale * off.max(0.05));
        }
    }
    model
}
