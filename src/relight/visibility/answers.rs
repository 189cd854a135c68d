//! From line samples back to pixels.

use super::{
    lines::{BAND, Fan},
    sweep::{LIT, Swept, UNSEEN},
};
use fearless_simd::{Level, dispatch};

/// Finds every pixel's answer among the lines of a finished sweep.
#[derive(Debug)]
pub struct Answers<'a> {
    vanishing_point: [f64; 2],
    above: Option<Side<'a>>,
    below: Option<Side<'a>>,
    left: Option<Side<'a>>,
    right: Option<Side<'a>>,
    /// Per column, how the fan left or right of the vanishing point is asked.
    columns: Questions,
}

/// How the lines are asked at one major coordinate after another.
#[derive(Debug, Default)]
struct Questions {
    /// The line nearest to minor coordinate n, plus half, is `n · gain + offset`.
    gain: Vec<f32>,
    offset: Vec<f32>,
    /// Rounds a line's index down to one that is asked here.
    mask: Vec<u32>,
    /// Where the answers of this major coordinate start in every band.
    start: Vec<u32>,
}

/// How the lines are asked at one major coordinate; fields as in [`Questions`].
#[derive(Debug, Clone, Copy, Default)]
struct Question {
    gain: f32,
    offset: f32,
    mask: u32,
    start: u32,
}

impl Question {
    fn new(fan: &Fan, major: usize) -> Self {
        let major = major.clamp(fan.from, fan.to);
        let (gain, offset) = fan.line_index_at(major);
        let apart = 1u32 << fan.crowding(major);
        Self {
            gain,
            offset: offset + apart as f32 * 0.5,
            mask: !(apart - 1),
            start: ((major - fan.from) * BAND) as u32,
        }
    }

    /// Index of the answer for minor coordinate `minor` among those of a fan of so many lines in
    /// bands of so many answers.
    #[inline(always)]
    fn place(self, minor: f32, lines: usize, band: u32) -> u32 {
        // Floats of this size count in ones: a conversion to an integer by adding.
        const ONES: f32 = 8_388_608.0;
        let most = (lines - 1) as f32 + 0.5;
        let line = minor * self.gain + self.offset;
        let line = (line.max(0.5).min(most) - 0.5 + ONES).to_bits() & 0x7f_ffff & self.mask;
        line / BAND as u32 * band + line % BAND as u32 + self.start
    }
}

impl Questions {
    fn push(&mut self, question: Question) {
        self.gain.push(question.gain);
        self.offset.push(question.offset);
        self.mask.push(question.mask);
        self.start.push(question.start);
    }
}

/// Pixels whose places are found together, before any answer is looked up: the one is arithmetic
/// on many numbers, the other a load each.
const PIECE: usize = 512;

/// A fan and what its lines answered.
#[derive(Debug, Clone, Copy)]
struct Side<'a> {
    fan: &'a Fan,
    answers: &'a [u8],
}

impl Side<'_> {
    fn band(&self) -> u32 {
        (self.fan.steps() * BAND) as u32
    }

    /// Answers for pixels (first, y), (first + 1, y), … of a fan above or below.
    fn along_row(&self, y: usize, first: usize, out: &mut [u8]) {
        let question = Question::new(self.fan, y);
        let (lines, band) = (self.fan.lines, self.band());
        let mut places = [0u32; PIECE];
        for (n, out) in out.chunks_mut(PIECE).enumerate() {
            let first = (first + n * PIECE) as f32;
            let places = &mut places[..out.len()];
            dispatch!(Level::new(), _simd => {
                for (n, place) in places.iter_mut().enumerate() {
                    *place = question.place(first + n as f32, lines, band);
                }
            });
            self.look_up(places, out);
        }
    }

    /// Answers for pixels (first, y), (first + 1, y), … of a fan on the left or right.
    fn across_row(&self, y: usize, columns: &Questions, first: usize, out: &mut [u8]) {
        let (lines, band, y) = (self.fan.lines, self.band(), y as f32);
        let mut places = [0u32; PIECE];
        for (n, out) in out.chunks_mut(PIECE).enumerate() {
            let range = first + n * PIECE..first + n * PIECE + out.len();
            let places = &mut places[..out.len()];
            let (gain, offset) = (&columns.gain[range.clone()], &columns.offset[range.clone()]);
            let (mask, start) = (&columns.mask[range.clone()], &columns.start[range]);
            dispatch!(Level::new(), _simd => {
                let questions = gain.iter().zip(offset).zip(mask).zip(start);
                for (place, (((&gain, &offset), &mask), &start)) in places.iter_mut().zip(questions) {
                    let question = Question { gain, offset, mask, start };
                    *place = question.place(y, lines, band);
                }
            });
            self.look_up(places, out);
        }
    }

    fn look_up(&self, places: &[u32], out: &mut [u8]) {
        for (out, &place) in out.iter_mut().zip(places) {
            *out = self.answers.get(place as usize).copied().unwrap_or(LIT);
        }
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
                .map(|(fan, answers)| Side { fan, answers })
        };
        let (left, right) = (find(true, false), find(true, true));
        let mut columns = Questions::default();
        for x in 0..width {
            let side = if (x as f64) < swept.fans.vanishing_point[0] {
                left
            } else {
                right
            };
            columns.push(side.map_or(Question::default(), |side| Question::new(side.fan, x)));
        }
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
            Some(side) => side.along_row(y, first, middle),
            None => middle.fill(LIT),
        }
        for (out, from, side) in [(left, from, self.left), (right, end, self.right)] {
            match side {
                Some(side) => side.across_row(y, &self.columns, from, out),
                None => out.fill(LIT),
            }
        }
    }
}
