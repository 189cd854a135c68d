//! From line samples back to pixels.

use super::{
    lines::{Fan, LANES},
    sweep::{LIT, Swept, UNSEEN},
};

/// Finds every pixel's answer among the lines of a finished sweep.
#[derive(Debug)]
pub struct Answers<'a> {
    width: usize,
    vanishing_point: [f64; 2],
    above: Option<(&'a Fan, &'a [u8])>,
    below: Option<(&'a Fan, &'a [u8])>,
    left: Option<(&'a Fan, &'a [u8])>,
    right: Option<(&'a Fan, &'a [u8])>,
    /// Per column, the line index as `y · gain + offset` for the fan left or right of the
    /// vanishing point.
    columns: Vec<(f32, f32)>,
}

impl<'a> Answers<'a> {
    /// Looks into `swept`, whose occluders were `width` pixels wide.
    pub fn new(swept: &'a Swept, width: usize) -> Self {
        let find = |along_x: bool, grows_outward: bool| {
            swept
                .fans
                .fans
                .iter()
                .zip(&swept.answers)
                .find(|(fan, _)| fan.along_x == along_x && fan.grows_outward == grows_outward)
                .map(|(fan, answers)| (fan, answers.as_slice()))
        };
        let (left, right) = (find(true, false), find(true, true));
        let columns = (0..width)
            .map(|x| {
                let side = if (x as f64) < swept.fans.vanishing_point[0] {
                    left
                } else {
                    right
                };
                side.map_or((0.0, 0.0), |(fan, _)| {
                    fan.line_index_at(x.clamp(fan.from, fan.to))
                })
            })
            .collect();
        Self {
            width,
            vanishing_point: swept.fans.vanishing_point,
            above: find(false, false),
            below: find(false, true),
            left,
            right,
            columns,
        }
    }

    /// Visibility of row `y` into `visibility` (0 = blocked, 1 = lit); returns how many lit
    /// pixels have a path to the lamp that leaves the frame too early to be sure.
    pub fn row(&self, y: usize, visibility: &mut [f32]) -> usize {
        let mut unseen = 0;
        self.each(y, |x, answer| {
            let lit = answer & LIT;
            visibility[x] = f32::from(lit) * (1.0 / LIT as f32);
            unseen += usize::from(answer & UNSEEN != 0 && lit > LIT / 2);
        });
        unseen
    }

    /// Calls `found(x, answer)` for every pixel of row `y`.
    #[inline(always)]
    pub(super) fn each(&self, y: usize, mut found: impl FnMut(usize, u8)) {
        let [vx, vy] = self.vanishing_point;
        let dy = y as f64 - vy;
        let limit = self.width as f64;
        let first = (vx - dy.abs()).ceil().clamp(0.0, limit) as usize;
        let end = ((vx + dy.abs()).floor() + 1.0).clamp(first as f64, limit) as usize;
        let middle = if dy < 0.0 { self.above } else { self.below };
        if let Some((fan, answers)) = middle {
            let major = y.clamp(fan.from, fan.to);
            let (gain, offset) = fan.line_index_at(major);
            for x in first..end {
                found(x, answer(fan, answers, major, x as f32 * gain + offset));
            }
        } else {
            (first..end).for_each(|x| found(x, LIT));
        }
        for (range, side) in [(0..first, self.left), (end..self.width, self.right)] {
            if let Some((fan, answers)) = side {
                for x in range {
                    let (gain, offset) = self.columns[x];
                    let major = x.clamp(fan.from, fan.to);
                    found(x, answer(fan, answers, major, y as f32 * gain + offset));
                }
            } else {
                range.for_each(|x| found(x, LIT));
            }
        }
    }
}

#[inline(always)]
fn answer(fan: &Fan, answers: &[u8], major: usize, line: f32) -> u8 {
    let line = ((line + 0.5).max(0.0) as usize).min(fan.lines - 1);
    answers[(line / LANES * fan.steps() + major - fan.from) * LANES + line % LANES]
}
