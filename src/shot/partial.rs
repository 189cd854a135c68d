//! A flash that lit a part of the rows: what a rolling shutter shows of one that came too late, ended
//! too soon, or was shorter than the shutter took to run down the picture.
//!
//! Rows that were closed hold no light of the flash at all, in any column, up to the picture's edge;
//! beside them lie rows that hold all of it. A table in front of a room that is too far to be lit looks
//! alike but for one thing: there the room's own light changes at the same rows. A flash that burns for
//! long fades in over many rows, which no picture alone tells from a floor that runs away from the
//! camera; that is for whoever knows the times ([`drivers::trigger`]).

/// Cells across and down, and samples across and down in one. Rows are narrow, as an edge that spans
/// several rows of cells counts as no edge.
pub(super) const COLUMNS: usize = 8;
pub(super) const ROWS: usize = 48;
pub(super) const SAMPLES: usize = 4;

/// Relative rise of light under which a cell counts as not lit: noise of sixteen samples of a picture
/// at gain 8 stays under half of it.
const UNLIT: f32 = 0.05;
/// Share of a row's columns that must be lit, or not lit.
const MOST: f32 = 0.75;
const NEARLY_ALL: f32 = 0.9;
/// Share of the picture's rows that both sides must have at least.
const LEAST: usize = 16;
/// Rows of cells that the edge itself may take.
const EDGE: usize = 2;
/// Light of the flash right beside the edge, as a share of what it is farther in, under which it fades
/// in over the scene.
const AT_ONCE: f32 = 0.5;
/// Relative change of the room's light across the edge, in half of the columns, that makes it an edge
/// of the scene.
const SCENE_EDGE: f32 = 0.1;

/// A picture's light on narrow rows; +∞ = clipped, NaN = unknown.
#[derive(Debug, Clone)]
pub(super) struct Strips {
    columns: usize,
    cells: Vec<f32>,
}

#[derive(Clone, Copy, PartialEq)]
enum Row {
    /// By this relative rise, at the median.
    Lit(f32),
    Unlit,
    Mixed,
}

impl Strips {
    pub fn new(columns: usize, cells: Vec<f32>) -> Self {
        Self { columns, cells }
    }

    /// Whether the light that `ambient` lacks ends at one row all across the picture; `rise` and `dark`
    /// as for whole pictures.
    pub fn partly_lit(&self, ambient: &Self, rise: f32, dark: f32) -> bool {
        let lit = self.cells.chunks(self.columns);
        let rows: Vec<Row> = lit
            .zip(ambient.cells.chunks(self.columns))
            .map(|(lit, unlit)| row(lit, unlit, rise, dark))
            .collect();
        let least = (rows.len() / LEAST).max(2);
        let downward = closed(rows.iter(), least);
        let upward = closed(rows.iter().rev(), least);
        let ends = [
            downward,
            upward.map(|(unlit, lit)| (rows.len() - 1 - unlit, rows.len() - 1 - lit)),
        ];
        ends.into_iter()
            .flatten()
            .any(|(unlit, lit)| !ambient.has_edge(unlit, lit, dark))
    }

    /// Whether most columns differ between two rows.
    fn has_edge(&self, one: usize, other: usize, dark: f32) -> bool {
        let row = |y: usize| &self.cells[y * self.columns..(y + 1) * self.columns];
        let pairs = row(one).iter().zip(row(other));
        let differing = pairs.filter(|(a, b)| {
            let apart = (*a - *b).abs() / a.max(**b).max(dark);
            // Clipped or unknown: no evidence that they are alike.
            apart.is_nan() || apart >= SCENE_EDGE
        });
        2 * differing.count() >= self.columns
    }
}

fn row(lit: &[f32], unlit: &[f32], rise: f32, dark: f32) -> Row {
    let mut rises = Vec::with_capacity(lit.len());
    let (mut risen, mut alike) = (0.0, 0.0);
    for (lit, unlit) in lit.iter().zip(unlit) {
        let relative = (lit - unlit) / unlit.max(dark);
        if relative.is_nan() {
            continue;
        }
        rises.push(relative);
        risen += f32::from(relative >= rise);
        alike += f32::from(relative.abs() < UNLIT);
    }
    let known = rises.len() as f32;
    if rises.is_empty() {
        Row::Mixed
    } else if risen >= MOST * known {
        Row::Lit(median(&mut rises))
    } else if alike >= NEARLY_ALL * known {
        Row::Unlit
    } else {
        Row::Mixed
    }
}

/// The last of the unlit rows from the edge of the picture on, and the first of the lit rows right
/// behind them; `None` where either are too few.
fn closed<'a>(rows: impl Iterator<Item = &'a Row> + Clone, least: usize) -> Option<(usize, usize)> {
    let unlit = rows.clone().take_while(|row| **row == Row::Unlit).count();
    let edge = rows
        .clone()
        .skip(unlit)
        .take_while(|row| !matches!(row, Row::Lit(_)))
        .count();
    let mut rises: Vec<f32> = rows
        .skip(unlit + edge)
        .map_while(|row| match row {
            Row::Lit(rise) => Some(*rise),
            _ => None,
        })
        .collect();
    if unlit < least || rises.len() < least || edge > EDGE {
        return None;
    }
    // The first row may be lit in a part of its height.
    let beside = rises[1];
    (beside >= AT_ONCE * median(&mut rises)).then(|| (unlit - 1, unlit + edge))
}

fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
