//! Takes the sensor's grain out of the light, as far as grain explains what neighbours differ by.

use crate::radiometry::FlashOnly;
use drivers::Plane;
use rayon::prelude::*;

/// Half a window, pixels.
const REACH: usize = 2;

/// Sums over the known pixels of one column of a window.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f32,
    light: [f32; 3],
    /// Of the squares of all channels.
    square: f32,
    /// Of the variances of all channels.
    noise: f32,
}

/// What of a pixel its window explains.
struct Share {
    mean: [f32; 3],
    /// Share by which the pixel is drawn to the mean, in [0, 1]; 0 where nothing is known.
    grain: f32,
    /// Share of the variance that is left.
    left: f32,
}

impl Sums {
    /// Of one pixel; nothing of an unknown one.
    fn of(light: [f32; 3], variance: f32) -> Self {
        let square = light.iter().map(|v| v * v).sum::<f32>();
        // False for NaN.
        if square + variance < f32::INFINITY {
            Self {
                count: 1.0,
                light,
                square,
                noise: 3.0 * variance,
            }
        } else {
            Self::default()
        }
    }

    /// Of a whole window.
    fn share(&self) -> Share {
        let per = 1.0 / self.count.max(1.0);
        let mean = self.light.map(|sum| sum * per);
        let spread = self.square * per - mean.iter().map(|m| m * m).sum::<f32>();
        let noise = self.noise * per;
        // NaN, where nothing is known, keeps everything.
        let grain = (noise / spread.max(noise)).max(0.0);
        Share {
            mean,
            grain,
            left: 1.0 - grain * (1.0 - per),
        }
    }

    fn add(&mut self, other: Self) {
        self.count += other.count;
        for (sum, light) in self.light.iter_mut().zip(other.light) {
            *sum += light;
        }
        self.square += other.square;
        self.noise += other.noise;
    }
}

/// Light with less grain, and its variance (of one channel). `variance` is that of one channel of
/// `light`; NaN stays NaN.
///
/// Each pixel is drawn to the mean of its window by the share of the window's spread that noise
/// explains (Lee, "Digital Image Enhancement and Noise Filtering by Use of Local Statistics", 1980),
/// one share for the three channels. Light without noise is left alone.
pub(super) fn shrunk(
    light: &Plane<[f32; 3]>,
    variance: &Plane<f32>,
) -> (Plane<[f32; 3]>, Plane<f32>) {
    let (width, height) = light.size();
    let (mut clean, mut left) = (light.clone(), variance.clone());
    let rows = clean
        .samples_mut()
        .par_chunks_mut(width.max(1))
        .zip(left.samples_mut().par_chunks_mut(width.max(1)));
    rows.enumerate().for_each_init(
        || vec![Sums::default(); width],
        |columns, (y, (clean, left))| {
            columns.fill(Sums::default());
            for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
                let pixels = light.row(row).iter().zip(variance.row(row));
                for (column, (&light, &variance)) in columns.iter_mut().zip(pixels) {
                    column.add(Sums::of(light, variance));
                }
            }
            for x in 0..width {
                let mut window = Sums::default();
                for column in &columns[x.saturating_sub(REACH)..(x + REACH + 1).min(width)] {
                    window.add(*column);
                }
                let Share {
                    mean,
                    grain,
                    left: share,
                } = window.share();
                if grain > 0.0 {
                    for (clean, mean) in clean[x].iter_mut().zip(mean) {
                        *clean += grain * (mean - *clean);
                    }
                    left[x] *= share;
                }
            }
        },
    );
    (clean, left)
}

/// Variance (of one channel) that [`super::estimate`] leaves in the light of pixel (x, y) as it
/// becomes albedo; NaN where it is unknown.
///
/// # Panics
/// When the planes differ in size or the pixel lies outside: a bug of the caller.
pub fn variance_left(flash: &FlashOnly, (x, y): (usize, usize)) -> f32 {
    let (width, height) = flash.light.0.size();
    let mut window = Sums::default();
    for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
        for column in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
            let at = (column, row);
            window.add(Sums::of(flash.light.0[at], flash.variance[at]));
        }
    }
    flash.variance[(x, y)] * window.share().left
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of unit variance, roughly normal.
    fn noise(i: usize) -> f32 {
        let uniform = |salt: u64| {
            let mut h = (i as u64 * 4 + salt).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            h = (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((h ^ (h >> 31)) >> 40) as f32 / 16_777_216.0 - 0.5
        };
        (uniform(0) + uniform(1) + uniform(2) + uniform(3)) * 3f32.sqrt()
    }

    #[test]
    fn grain_goes_and_an_edge_stays() {
        let sigma = 0.02;
        let truth = |x: usize| if x < 32 { 0.2 } else { 0.8 };
        let light = Plane::from_fn(64, 48, |x, y| {
            std::array::from_fn(|c| truth(x) + sigma * noise((y * 64 + x) * 3 + c))
        });
        let (clean, variance) = shrunk(&light, &light.map(|_| sigma * sigma));
        let error = |columns: std::ops::Range<usize>| {
            let count = columns.len() * 48;
            let sum = columns
                .flat_map(|x| (0..48).map(move |y| (x, y)))
                .map(|(x, y)| (clean[(x, y)][0] - truth(x)).powi(2))
                .sum::<f32>();
            (sum / count as f32).sqrt()
        };
        assert!(error(4..28) < 0.45 * sigma, "{}", error(4..28));
        assert!(error(30..34) < 1.05 * sigma, "{}", error(30..34));
        assert!(variance[(10, 10)] < 0.4 * sigma * sigma);
    }

    #[test]
    fn light_without_noise_and_unknown_light_are_left_alone() {
        let mut light = Plane::from_fn(9, 7, |x, y| [x as f32, y as f32, 1.0]);
        light[(4, 3)] = [f32::NAN; 3];
        let (clean, variance) = shrunk(&light, &Plane::filled(9, 7, 0.0));
        for (a, b) in clean.samples().iter().zip(light.samples()) {
            assert!(a == b || a[0].is_nan() && b[0].is_nan());
        }
        assert!(variance.samples().iter().all(|v| *v == 0.0));
    }
}
