//! Surfaces assumed across holes, only to hide what lies behind them.
//!
//! A thing that the depth camera answers only in part (gloss, black print) still hides the
//! background from the color camera. Without this, background seen past the thing's rim would
//! shine through its holes.

use rayon::prelude::*;

/// Longest hole that is spanned, as a fraction of the row or column.
const LONGEST: f32 = 1.0 / 6.0;
/// Largest relative difference of depth between the two rims of a hole in one surface.
const SAME_SURFACE: f32 = 0.05;

/// Columns looked at together.
const BLOCK: usize = 32;

/// Metres across holes whose rims, left and right as well as above and below, lie on one surface;
/// NaN elsewhere.
#[derive(Debug, Clone, Default)]
pub(super) struct Holes {
    pub metres: Vec<f32>,
}

impl Holes {
    pub fn span(&mut self, metres: &[f32], width: usize, height: usize) {
        self.metres.clear();
        self.metres.resize(width * height, f32::NAN);
        let longest = |side: usize| (LONGEST * side as f32) as usize;
        for y in 1..height {
            let [above, row] = [y - 1, y].map(|y| &metres[y * width..][..width]);
            for first in (0..width).step_by(BLOCK) {
                let block = first..(first + BLOCK).min(width);
                let ends = |(above, z): (&f32, &f32)| above.is_nan() & !z.is_nan();
                // A hole seldom ends here: asked of all columns of a block together.
                let pairs = above[block.clone()].iter().zip(&row[block.clone()]);
                if !pairs.map(ends).fold(false, |a, b| a | b) {
                    continue;
                }
                for x in block {
                    if ends((&above[x], &row[x])) {
                        self.span_column(metres, width, [x, y], longest(height));
                    }
                }
            }
        }
        self.metres
            .par_chunks_mut(width)
            .zip(metres.par_chunks(width))
            .with_min_len(16)
            .for_each(|(holes, row)| {
                let mut x = 0;
                while x < width {
                    if !row[x].is_nan() {
                        x += 1;
                        continue;
                    }
                    let end = (x..width).find(|&end| !row[end].is_nan()).unwrap_or(width);
                    let rims = (x > 0 && end < width && end - x < longest(width))
                        .then(|| (row[x - 1], row[end]))
                        .filter(|&(left, right)| same_surface(left, right));
                    for (step, hole) in holes[x..end].iter_mut().enumerate() {
                        let across = rims.map_or(f32::NAN, |(left, right)| {
                            let t = (step + 1) as f32 / (end + 1 - x) as f32;
                            left + t * (right - left)
                        });
                        *hole = if same_surface(*hole, across) {
                            0.5 * (*hole + across)
                        } else {
                            f32::NAN
                        };
                    }
                    x = end;
                }
            });
    }

    /// The hole that ends above (x, y).
    fn span_column(&mut self, metres: &[f32], width: usize, [x, y]: [usize; 2], longest: usize) {
        let known = |row: &usize| !metres[row * width + x].is_nan();
        let Some(above) = (y.saturating_sub(longest)..y).rev().find(known) else {
            return;
        };
        let (first, last) = (metres[above * width + x], metres[y * width + x]);
        if same_surface(first, last) {
            for between in above + 1..y {
                let t = (between - above) as f32 / (y - above) as f32;
                self.metres[between * width + x] = first + t * (last - first);
            }
        }
    }
}

/// False for NaN.
fn same_surface(a: f32, b: f32) -> bool {
    (a - b).abs() <= SAME_SURFACE * a.min(b)
}
