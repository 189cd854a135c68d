//! From line samples back to pixels.

use super::{
    lines::{BAND, Fan},
    sweep::{LIT, Swept, UNSEEN},
};

/// Finds every pixel's answer among the lines of a finished sweep.
#[derive(Debug)]
pub struct Answers<'a> {
    vanishing_point: [f64; 2],
    above: Option<(&'a Fan, &'a [u8])>,
    below: Option<(&'a Fan, &'a [u8])>,
    left: Option<(&'a Fan, &'a [u8])>,
    right: Option<(&'a Fan, &'a [u8])>,
    /// Per column, how the fan left or right of the vanishing point is asked.
    columns: Vec<Question>,
}

/// How the lines at one major coordinate are asked.
#[derive(Debug, Clone, Copy, Default)]
struct Question {
    /// The line nearest to minor coordinate n is `n · gain + offset`.
    gain: f32,
    offset: f32,
    /// Rounds a line's index down to one that is asked here, after `half` was added.
    mask: u32,
    half: f32,
    /// Where the answers of this major coordinate start in every band.
    start: u32,
}

impl Question {
    fn new(fan: &Fan, major: usize) -> Self {
        let major = major.clamp(fan.from, fan.to);
        let (gain, offset) = fan.line_index_at(major);
        let apart = 1u32 << fan.crowding(major);
        Self {
            gain,
            offset,
            mask: !(apart - 1),
            half: apart as f32 * 0.5,
            start: ((major - fan.from) * BAND) as u32,
        }
    }

    /// Index of the answer for minor coordinate `minor` among those of `fan`.
    #[inline(always)]
    fn place(&self, fan: &Fan, minor: f32) -> u32 {
        // Floats of this size count in ones: a conversion to an integer by adding.
        const ONES: f32 = 8_388_608.0;
        let line = minor * self.gain + (self.offset + self.half);
        let most = (fan.lines - 1) as f32 + 0.5;
        let line = (line.max(0.5).min(most) - 0.5 + ONES).to_bits() & 0x7f_ffff & self.mask;
        line / BAND as u32 * (fan.steps() * BAND) as u32 + line % BAND as u32 + self.start
    }
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
                side.map_or(Question::default(), |(fan, _)| Question::new(fan, x))
            })
            .collect();
        Self {
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
        // In pieces that stay in the nearest cache and are turned to floats many at a time.
        const PIECE: usize = 512;
        let mut answers = [0u8; PIECE];
        for (index, visibility) in visibility.chunks_mut(PIECE).enumerate() {
            let answers = &mut answers[..visibility.len()];
            self.part(y, index * PIECE, answers);
            unseen += answers
                .iter()
                .map(|answer| u32::from(*answer > UNSEEN + LIT / 2))
                .sum::<u32>() as usize;
            for (visibility, answer) in visibility.iter_mut().zip(answers) {
                *visibility = f32::from(*answer & LIT) * (1.0 / LIT as f32);
            }
        }
        unseen
    }

    /// Answers for the pixels of row `y` from column `from` on.
    pub(super) fn part(&self, y: usize, from: usize, out: &mut [u8]) {
        let [vx, vy] = self.vanishing_point;
        let dy = y as f64 - vy;
        let (least, limit) = (from as f64, (from + out.len()) as f64);
        let first = (vx - dy.abs()).ceil().clamp(least, limit) as usize;
        let end = ((vx + dy.abs()).floor() + 1.0).clamp(first as f64, limit) as usize;
        let (left, rest) = out.split_at_mut(first - from);
        let (middle, right) = rest.split_at_mut(end - first);
        match if dy < 0.0 { self.above } else { self.below } {
            Some((fan, answers)) => {
                let question = Question::new(fan, y);
                for (out, x) in middle.iter_mut().zip(first..) {
                    let place = question.place(fan, x as f32);
                    *out = answers.get(place as usize).copied().unwrap_or(LIT);
                }
            }
            None => middle.fill(LIT),
        }
        for (out, from, side) in [(left, from, self.left), (right, end, self.right)] {
            match side {
                Some((fan, answers)) => {
                    for (out, question) in out.iter_mut().zip(&self.columns[from..]) {
                        let place = question.place(fan, y as f32);
                        *out = answers.get(place as usize).copied().unwrap_or(LIT);
                    }
                }
                None => out.fill(LIT),
            }
        }
    }
}
