//! How much of a difference of light is seen where the picture is displayed.

/// The light that 99 % of the pixels stay below becomes white.
const WHITE_QUANTILE: f64 = 0.99;

/// What a small difference of light becomes in the sRGB picture, pixel by pixel and channel by
/// channel, and how much noise there is.
#[derive(Debug)]
pub(super) struct Display {
    /// Slope of the encoding at the picture's own light.
    slopes: Vec<[f32; 3]>,
    /// Root mean square, [`super::LEAST_NOISE`] included.
    pub noise: f32,
}

impl Display {
    /// Of a picture and the relative noise of its pixels.
    pub fn new(picture: &[[f32; 3]], relative_noise: impl Iterator<Item = f32>) -> Self {
        let white = white(picture);
        let slopes: Vec<[f32; 3]> = picture
            .iter()
            .map(|pixel| pixel.map(|light| slope(light / white) / white))
            .collect();
        let mut noise = 0.0;
        for ((pixel, slopes), relative) in picture.iter().zip(&slopes).zip(relative_noise) {
            // The albedo is the flash's light over a number, so both are off by the same share.
            let level = relative * pixel.iter().sum::<f32>() / 3.0;
            if level.is_finite() {
                let square = |slope: &f32| f64::from(slope * level).powi(2);
                noise += slopes.iter().map(square).sum::<f64>();
            }
        }
        let mean = noise / (3 * picture.len().max(1)) as f64;
        let least = f64::from(super::LEAST_NOISE);
        Self {
            slopes,
            noise: (mean + least * least).sqrt() as f32,
        }
    }

    /// Of a difference of light, over pixels and channels.
    pub fn root_mean_square(&self, change: &[[f32; 3]]) -> f32 {
        let values = change.as_flattened();
        // Side by side, as a vector; of a few hundred values each, single precision is enough.
        let mut sums = [0.0f32; 16];
        let slopes = self.slopes.as_flattened().chunks(16);
        for (values, slopes) in values.chunks(16).zip(slopes) {
            for ((sum, value), slope) in sums.iter_mut().zip(values).zip(slopes) {
                let shown = value * slope;
                *sum += shown * shown;
            }
        }
        let sum: f64 = sums.map(f64::from).iter().sum();
        (sum / values.len().max(1) as f64).sqrt() as f32
    }

    /// What the difference of 95 % of the pixels (root mean square over channels) stays below.
    pub fn quantile_95(&self, change: &[[f32; 3]]) -> f32 {
        let pixels = change.iter().zip(&self.slopes);
        let mut squares: Vec<f64> = pixels
            .map(|(change, slopes)| square(change, slopes))
            .collect();
        if squares.is_empty() {
            return 0.0;
        }
        let rank = (squares.len() - 1) * 95 / 100;
        squares
            .select_nth_unstable_by(rank, f64::total_cmp)
            .1
            .sqrt() as f32
    }
}

/// Mean over the channels of what is displayed, squared.
fn square(change: &[f32; 3], slopes: &[f32; 3]) -> f64 {
    let channels = change.iter().zip(slopes);
    let sum: f32 = channels
        .map(|(change, slope)| (change * slope).powi(2))
        .sum();
    f64::from(sum) / 3.0
}

fn white(picture: &[[f32; 3]]) -> f32 {
    let mut brightest: Vec<f32> = picture
        .iter()
        .map(|[red, green, blue]| red.max(*green).max(*blue))
        .collect();
    if brightest.is_empty() {
        return 1.0;
    }
    let rank = ((brightest.len() - 1) as f64 * WHITE_QUANTILE) as usize;
    let white = *brightest.select_nth_unstable_by(rank, f32::total_cmp).1;
    if white > 0.0 { white } else { 1.0 }
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
    fn noise_of_one_percent_at_white_is_shown_as_the_encoding_has_it() {
        // The slope at white is 1.055 / 2.4 = 0.4396; 1 % of white becomes 0.0044.
        let display = Display::new(&[[3.0; 3]; 50], std::iter::repeat(0.01));
        let expected =
            (0.004_396f32.powi(2) + crate::relight::light_set::LEAST_NOISE.powi(2)).sqrt();
        assert!(
            (display.noise / expected - 1.0).abs() < 1e-3,
            "{}",
            display.noise
        );
    }
}
