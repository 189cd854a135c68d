//! The printed board: a chessboard with a tag in every white square (ChArUco).

use super::CalibrationError;
use glam::{DVec2, DVec3};

/// Tags in the family 36h11.
const TAGS: usize = 587;

/// A ChArUco board as OpenCV's `CharucoBoard` prints it from the dictionary `DICT_APRILTAG_36h11`:
/// the top left square is black, tags count up row by row from 0.
///
/// Board axes: x right and y down along the squares from the top left corner, z into the board, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    columns: usize,
    rows: usize,
    square_metres: f64,
    tag_metres: f64,
}

impl Board {
    /// A board of `columns`×`rows` squares of this side, with tags of that side (their black border
    /// included) in the middle of the white ones.
    ///
    /// # Errors
    /// [`CalibrationError::Board`] for fewer than 3×3 squares, more tags than there are, or sides that
    /// do not fit into each other.
    pub fn new(
        (columns, rows): (usize, usize),
        square_metres: f64,
        tag_metres: f64,
    ) -> Result<Self, CalibrationError> {
        let refuse = |problem: String| Err(CalibrationError::Board { problem });
        let size = 3..=64;
        if !(size.contains(&columns) && size.contains(&rows)) {
            return refuse(format!("{columns}×{rows} squares; each way 3 to 64"));
        }
        if columns * rows / 2 > TAGS {
            return refuse(format!(
                "{columns}×{rows} squares hold more than the {TAGS} tags of the family 36h11"
            ));
        }
        if !(0.001..=2.0).contains(&square_metres) {
            return refuse(format!("squares of {square_metres} m; 0.001 to 2"));
        }
        if !(tag_metres > 0.3 * square_metres && tag_metres < square_metres) {
            return refuse(format!(
                "tags of {tag_metres} m in squares of {square_metres} m; a tag fills 0.3 to 1 of its square"
            ));
        }
        Ok(Self {
            columns,
            rows,
            square_metres,
            tag_metres,
        })
    }

    /// Side of a square, metres.
    pub fn square_metres(&self) -> f64 {
        self.square_metres
    }

    /// Inner corners of the chessboard, each of which can be seen once in a picture.
    pub fn corner_count(&self) -> usize {
        (self.columns - 1) * (self.rows - 1)
    }

    /// Where an inner corner is.
    pub fn corner(&self, id: usize) -> DVec3 {
        let (column, row) = (id % (self.columns - 1), id / (self.columns - 1));
        DVec3::new((column + 1) as f64, (row + 1) as f64, 0.0) * self.square_metres
    }

    /// Column and row of the white square with tag `id`; `None` for a tag of another board.
    pub(super) fn square_of(&self, id: usize) -> Option<(usize, usize)> {
        let mut left = id;
        for row in 0..self.rows {
            // White squares of even rows begin in the second column.
            let first = (row + 1) % 2;
            let count = (self.columns - first).div_ceil(2);
            if left < count {
                return Some((first + 2 * left, row));
            }
            left -= count;
        }
        None
    }

    /// Middle of a square.
    pub(super) fn middle_of(&self, (column, row): (usize, usize)) -> DVec2 {
        DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * self.square_metres
    }

    /// White squares: as many as tags.
    pub(super) fn white_squares(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..).map_while(|id| self.square_of(id))
    }

    /// Corners of tag `id`, from the top left clockwise.
    pub(super) fn tag_corners(&self, id: usize) -> Option<[DVec2; 4]> {
        let (column, row) = self.square_of(id)?;
        let middle = self.middle_of((column, row));
        let half = 0.5 * self.tag_metres;
        let signs = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        Some(signs.map(|(x, y)| middle + DVec2::new(x, y) * half))
    }

    /// Identities of the inner corners around a square.
    pub(super) fn corners_around(&self, (column, row): (usize, usize)) -> Vec<usize> {
        let mut found = Vec::with_capacity(4);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (column + x, row + y);
            if (1..self.columns).contains(&x) && (1..self.rows).contains(&y) {
                found.push((y - 1) * (self.columns - 1) + x - 1);
            }
        }
        found
    }

    /// Places on plain white paper: in the four corners of a white square, half way between the tag and
    /// the square's corner.
    pub(super) fn paper_in(&self, (column, row): (usize, usize)) -> [DVec3; 4] {
        let margin = 0.25 * (1.0 - self.tag_metres / self.square_metres);
        [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
            let inset = |side: f64| margin + side * (1.0 - 2.0 * margin);
            DVec3::new(column as f64 + inset(x), row as f64 + inset(y), 0.0) * self.square_metres
        })
    }

    /// Whether a place on the board's plane lies on it.
    pub(super) fn holds(&self, place: DVec2) -> bool {
        let inside = |value: f64, squares: usize| {
            value >= 0.0 && value <= squares as f64 * self.square_metres
        };
        inside(place.x, self.columns) && inside(place.y, self.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_and_corners_lie_where_opencv_puts_them() {
        // From cv2.aruco.CharucoBoard((9, 6), 0.03, 0.0225, DICT_APRILTAG_36h11) of OpenCV 5.0.
        let board = Board::new((9, 6), 0.03, 0.0225).unwrap();
        assert_eq!(board.white_squares().count(), 27);
        assert_eq!(board.square_of(0), Some((1, 0)));
        assert_eq!(board.square_of(4), Some((0, 1)));
        assert_eq!(board.square_of(26), Some((8, 5)));
        assert_eq!(board.square_of(27), None);
        let first = board.tag_corners(0).unwrap()[0];
        assert!(first.distance(DVec2::new(0.03375, 0.00375)) < 1e-9);
        assert_eq!(board.corner_count(), 40);
        assert!(board.corner(8).distance(DVec3::new(0.03, 0.06, 0.0)) < 1e-9);
    }

    #[test]
    fn a_board_that_cannot_be_printed_is_refused() {
        for (squares, square, tag) in [
            ((2, 6), 0.03, 0.02),
            ((9, 65), 0.03, 0.02),
            ((60, 60), 0.03, 0.02),
            ((9, 6), 0.0, 0.02),
            ((9, 6), f64::NAN, 0.02),
            ((9, 6), 0.03, 0.03),
            ((9, 6), 0.03, f64::NAN),
        ] {
            assert!(
                Board::new(squares, square, tag).is_err(),
                "{squares:?} {square} {tag}"
            );
        }
    }
}
