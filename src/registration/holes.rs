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

/// Metres across holes whose rims, left and right as well as above and below, lie on one surface;
/// NaN elsewhere.
#[derive(Debug, Clone, Default)]
pub(super) struct Holes {
    pub metres: Vec<f32>,
    /// Per column, the row of the last answer.
    last: Vec<Option<usize>>,
}

impl Holes {
    pub fn span(&mut self, metres: &[f32], width: usize, height: usize) {
        self.metres.clear();
        self.metres.resize(width * height, f32::NAN);
        self.last.clear();
        self.last.resize(width, None);
        let longest = |side: usize| (LONGEST * side as f32) as usize;
        for (y, row) in metres.chunks(width).enumerate() {
            for (x, (&z, last)) in row.iter().zip(&mut self.last).enumerate() {
                if z.is_nan() {
                    continue;
                }
                if let Some(above) = last.replace(y).filter(|above| y - above > 1) {
                    let first = metres[above * width + x];
                    if y - above <= longest(height) && same_surface(first, z) {
                        for between in above + 1..y {
                            let t = (between - above) as f32 / (y - above) as f32;
                            self.metres[between * width + x] = first + t * (z - first);
                        }
                    }
                }
            }
        }
        self.metres
            .par_chunks_mut(width)
            .zip(metres.par_chunks(width))
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
}

/// False for NaN.
fn same_surface(a: f32, b: f32) -> bool {
    (a - b).abs() <= SAME_SURFACE * a.min(b)
}
