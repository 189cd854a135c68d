//! Bayer mosaic → three channels per pixel.
//!
//! Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned
//! color images" (ICASSP 2004): bilinear interpolation plus a Laplacian correction by the known
//! channel, 5×5 taps. The picture is continued by reflection, which keeps the filter order.

use super::{LinearImage, RadiometryError};
use drivers::{BayerPattern, Plane};
use rayon::prelude::*;

/// Smallest side that reflection about the edge can serve.
const SIDE_AT_LEAST: usize = 3;

/// Column and row (0 or 1) of the red filter.
fn red_site(pattern: BayerPattern) -> (usize, usize) {
    match pattern {
        BayerPattern::Rggb => (0, 0),
        BayerPattern::Grbg => (1, 0),
        BayerPattern::Gbrg => (0, 1),
        BayerPattern::Bggr => (1, 1),
    }
}

/// Column offset of the green filters in even rows.
pub(super) fn green_offset(pattern: BayerPattern) -> usize {
    let (x, y) = red_site(pattern);
    (x + y + 1) % 2
}

/// Interpolates the missing channels and divides by `factor`.
///
/// `mosaic` is linear light with NaN = clipped. A pixel is NaN when its own sample or one of the
/// eight around it is; a clipped sample further out only takes the Laplacian correction away.
///
/// # Errors
/// [`RadiometryError::UnusableSize`] under 3×3 pixels.
pub(super) fn demosaic(
    mosaic: &Plane<f32>,
    pattern: BayerPattern,
    factor: f32,
) -> Result<LinearImage, RadiometryError> {
    let (width, height) = mosaic.size();
    if width < SIDE_AT_LEAST || height < SIDE_AT_LEAST {
        return Err(RadiometryError::UnusableSize {
            layout: "Bayer",
            width,
            height,
            problem: "a mosaic needs at least 3×3 pixels",
        });
    }
    let (red_x, red_y) = red_site(pattern);
    let scale = factor.recip();
    let mut light = Plane::filled(width, height, [0.0f32; 3]);
    light
        .samples_mut()
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, out)| {
            let rows: [&[f32]; 5] =
                std::array::from_fn(|i| mosaic.row(reflect(y as isize + i as isize - 2, height)));
            let red_row = y % 2 == red_y;
            for (x, pixel) in out.iter_mut().enumerate() {
                let columns: [usize; 5] = if (2..width - 2).contains(&x) {
                    [x - 2, x - 1, x, x + 1, x + 2]
                } else {
                    std::array::from_fn(|i| reflect(x as isize + i as isize - 2, width))
                };
                let at = |dx: usize, dy: usize| rows[dy][columns[dx]];
                let taps = Taps {
                    centre: at(2, 2),
                    across: at(1, 2) + at(3, 2),
                    down: at(2, 1) + at(2, 3),
                    diagonal: at(1, 1) + at(3, 1) + at(1, 3) + at(3, 3),
                    far_across: at(0, 2) + at(4, 2),
                    far_down: at(2, 0) + at(2, 4),
                };
                let rgb = match (red_row, x % 2 == red_x) {
                    (true, true) => [taps.centre, taps.green(), taps.opposite()],
                    (true, false) => [taps.beside(), taps.centre, taps.above()],
                    (false, true) => [taps.above(), taps.centre, taps.beside()],
                    (false, false) => [taps.opposite(), taps.green(), taps.centre],
                };
                // Sums over the eight neighbours carry any NaN; every channel shares its fate.
                let fate = (taps.across + taps.down + taps.diagonal + taps.centre) * 0.0;
                *pixel = rgb.map(|channel| channel * scale + fate);
            }
        });
    Ok(LinearImage(light))
}

/// Sums of samples around one pixel.
struct Taps {
    centre: f32,
    across: f32,
    down: f32,
    diagonal: f32,
    far_across: f32,
    far_down: f32,
}

impl Taps {
    /// Green at a red or blue sample.
    fn green(&self) -> f32 {
        let bilinear = (self.across + self.down) * 0.25;
        corrected(
            bilinear,
            0.5 * self.centre - (self.far_across + self.far_down) * 0.125,
        )
    }

    /// The channel whose samples stand left and right of a green sample.
    fn beside(&self) -> f32 {
        let correction = 0.625 * self.centre - 0.125 * (self.far_across + self.diagonal)
            + 0.0625 * self.far_down;
        corrected(self.across * 0.5, correction)
    }

    /// The channel whose samples stand above and below a green sample.
    fn above(&self) -> f32 {
        let correction = 0.625 * self.centre - 0.125 * (self.far_down + self.diagonal)
            + 0.0625 * self.far_across;
        corrected(self.down * 0.5, correction)
    }

    /// Red at a blue sample, or blue at a red one.
    fn opposite(&self) -> f32 {
        let correction = 0.75 * self.centre - 0.1875 * (self.far_across + self.far_down);
        corrected(self.diagonal * 0.25, correction)
    }
}

fn corrected(bilinear: f32, correction: f32) -> f32 {
    if correction.is_nan() {
        bilinear
    } else {
        bilinear + correction
    }
}

fn reflect(index: isize, length: usize) -> usize {
    let last = length as isize - 1;
    let index = index.abs();
    (if index > last {
        2 * last - index
    } else {
        index
    }) as usize
}
