//! How much of a difference of light is seen where the picture is displayed.

/// The light that 99 % of the pixels stay below becomes white.
const WHITE_QUANTILE: f64 = 0.99;

/// What a small difference of light becomes in the sRGB picture, pixel by pixel and channel by
/// channel, and how much noise there is.
#[derive(Debug)]
pub(in crate::relight) struct Display {
    /// Slope of the encoding at the picture's own light.
    slopes: Vec<[f32; 3]>,
    /// How many pixels each stands for, relative to the mean.
    weights: Vec<f32>,
    /// Root mean square, [`super::LEAST_NOISE`] included.
    pub noise: f32,
}

impl Display {
    /// Of a picture, how many pixels each of its pixels stands for, and their relative noise.
    pub fn new(
        picture: &[[f32; 3]],
        weights: &[f32],
        relative_noise: impl Iterator<Item = f32>,
    ) -> Self {
        let brightest = |[red, green, blue]: &[f32; 3]| red.max(*green).max(*blue);
        let brightest = picture.iter().map(brightest).zip(weights.iter().copied());
        let white = match quantile(brightest.collect(), WHITE_QUANTILE) {
            white if white > 0.0 => white,
            _ => 1.0,
        };
        let slopes: Vec<[f32; 3]> = picture
            .iter()
            .map(|pixel| pixel.map(|light| slope(light / white) / white))
            .collect();
        let mut noise = 0.0;
        let pixels = picture.iter().zip(&slopes).zip(weights);
        for (((pixel, slopes), weight), relative) in pixels.zip(relative_noise) {
            // The albedo is the flash's light over a number, so both are off by the same share.
            let level = relative * pixel.iter().sum::<f32>() / 3.0;
            if level.is_finite() {
                let square = |slope: &f32| f64::from(slope * level).powi(2);
                noise += f64::from(*weight) * slopes.iter().map(square).sum::<f64>();
            }
        }
        let mean = noise / (3 * picture.len().max(1)) as f64;
        let least = f64::from(super::LEAST_NOISE);
        Self {
            slopes,
            weights: weights.to_vec(),
            noise: (mean + least * least).sqrt() as f32,
        }
    }

    /// Of a difference of light, over pixels and channels.
    pub fn root_mean_square(&self, change: &[[f32; 3]]) -> f32 {
        let pixels = change.iter().zip(&self.slopes).zip(&self.weights);
        // Side by side, as a vector; of a few hundred values each, single precision is enough.
        let mut sums = [0.0f32; 8];
        for (place, ((change, slopes), weight)) in pixels.enumerate() {
            sums[place % 8] += weight * square(change, slopes);
        }
        let sum: f64 = sums.map(f64::from).iter().sum();
        (sum / change.len().max(1) as f64).sqrt() as f32
    }

    /// What the difference of 95 % of the pixels (root mean square over channels) stays below.
    pub fn quantile_95(&self, change: &[[f32; 3]]) -> f32 {
        let pixels = change.iter().zip(&self.slopes);
        let squares = pixels.map(|(change, slopes)| square(change, slopes));
        quantile(squares.zip(self.weights.iter().copied()).collect(), 0.95).sqrt()
    }
}

/// Mean over the channels of what is displayed, squared.
fn square(change: &[f32; 3], slopes: &[f32; 3]) -> f32 {
    let channels = change.iter().zip(slopes);
    let squares = channels.map(|(change, slope)| (change * slope).powi(2));
    squares.sum::<f32>() / 3.0
}

/// What values that hold `share` of all weight stay below; 0 of none.
fn quantile(mut weighted: Vec<(f32, f32)>, share: f64) -> f32 {
    weighted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut left: f64 = share
        * weighted
            .iter()
            .map(|(_, weight)| f64::from(*weight))
            .sum::<f64>();
    let reached = weighted.iter().find(|(_, weight)| {
        left -= f64::from(*weight);
        left < 0.0
    });
    reached.or(weighted.last()).map_or(0.0, |(value, _)| *value)
}

/// Of the sRGB encoding (IEC 61966-2-1) at `light`, white = 1.
fn slope(light: f32) -> f32 {
    if light <= 0.003_130_8 {
        12.92
    } else {
        1.055 / 2.4 * light.powf(1.0 / 2.4 - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_the_encoding() {
        use crate::radiometry::transfer::srgb_encode;
        for light in [0.001, 0.01, 0.2, 0.7, 1.5] {
            let step = 1e-3 * light;
            let found = (srgb_encode(light + step) - srgb_encode(light - step)) / (2.0 * step);
            assert!((slope(light) / found - 1.0).abs() < 1e-2, "{light}");
        }
    }

    #[test]
    fn a_pixel_counts_as_many_times_as_it_stands_for() {
        let weighted = vec![(3.0, 0.5), (1.0, 2.0), (2.0, 0.5)];
        assert_eq!(quantile(weighted.clone(), 0.6), 1.0);
        assert_eq!(quantile(weighted.clone(), 0.7), 2.0);
        assert_eq!(quantile(weighted, 0.99), 3.0);
        let two = Display::new(&[[1.0; 3]; 2], &[0.5, 1.5], std::iter::repeat(0.0));
        let four = Display::new(&[[1.0; 3]; 4], &[1.0; 4], std::iter::repeat(0.0));
        let [a, b] = [[0.1; 3], [0.3; 3]];
        let (few, many) = (
            two.root_mean_square(&[a, b]),
            four.root_mean_square(&[a, b, b, b]),
        );
        assert!((few / many - 1.0).abs() < 1e-6, "{few} {many}");
    }

    #[test]
    fn noise_of_one_percent_at_white_is_shown_as_the_encoding_has_it() {
        // The slope at white is 1.055 / 2.4 = 0.4396; 1 % of white becomes 0.0044.
        let display = Display::new(&[[3.0; 3]; 50], &[1.0; 50], std::iter::repeat(0.01));
        let expected =
            (0.004_396f32.powi(2) + crate::relight::light_set::LEAST_NOISE.powi(2)).sqrt();
        assert!(
            (display.noise / expected - 1.0).abs() < 1e-3,
            "{}",
            display.noise
        );
    }
}
