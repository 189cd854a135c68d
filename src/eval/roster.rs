//! Which rows a table has, in its order, and why those that are missing are.

use super::methods::{ClosedForm, DoNothing, Matte, Method};
use crate::relight::RelightOptions;
use thiserror::Error;

/// Row 4, trained on clean depth.
pub const PAPER_CLEAN: &str = "paper's networks, trained on clean depth";
/// Row 4, trained on noisy depth.
pub const PAPER_NOISY: &str = "paper's networks, trained on noisy depth";
/// Row 4, surfaces alone, of a photograph with the room's light left in.
pub const PAPER_ENV: &str = "paper's Env network, room light left in";
/// Row 5.
pub const SIPS: &str = "SIPS: surfaces without depth";
/// Row 8, with every term: closed forms corrected by the compact networks.
pub const OURS_EVERYTHING: &str = "ours, everything (compact networks)";
/// Row 8, with the terms that a shot needs.
pub const OURS_AUTO: &str = "ours, auto";
/// Row 8, with the terms that held-out samples ask for.
pub const OURS_ONE_STANDARD_ERROR: &str = "ours, terms by one standard error";
/// Row 8, with the terms that the Bayesian information criterion asks for.
pub const OURS_BIC: &str = "ours, terms by BIC";

const NOT_ASKED: &str = "not asked";

/// Rows that every table has beyond the first three: number, name, why they are missing unless
/// [`Roster::fill`] or [`Roster::miss`] says otherwise.
const STANDING: [(u8, &str, &str); 10] = [
    (4, PAPER_CLEAN, "no trained networks at hand"),
    (4, PAPER_NOISY, "no trained networks at hand"),
    (4, PAPER_ENV, "no trained networks at hand"),
    (5, SIPS, "no trained networks at hand"),
    (
        6,
        "OSS: five lights in, one network",
        "no answers given (--answers 6=DIR)",
    ),
    (
        7,
        "reconstruction: mesh, path-traced",
        "no answers given (--answers 7=DIR)",
    ),
    (8, OURS_EVERYTHING, NOT_ASKED),
    (8, OURS_AUTO, NOT_ASKED),
    (8, OURS_ONE_STANDARD_ERROR, NOT_ASKED),
    (8, OURS_BIC, NOT_ASKED),
];

/// A row that the roster already holds.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("row {number}, \"{name}\", stands there twice; give one of them another name")]
pub struct RowTwice {
    /// Its number.
    pub number: u8,
    /// Its name.
    pub name: String,
}

/// One row of the table.
pub struct Row {
    /// Its number.
    pub number: u8,
    /// Its number, with a letter where several rows share it: `4a`.
    pub label: String,
    /// What it is called.
    pub name: String,
    /// How it answers, or why there is nothing that does.
    pub(super) method: Result<Box<dyn Method>, String>,
}

impl std::fmt::Display for Row {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{} {}", self.label, self.name)?;
        match &self.method {
            Ok(_) => Ok(()),
            Err(reason) => write!(out, " (missing: {reason})"),
        }
    }
}

/// The rows of one table.
pub struct Roster(Vec<Row>);

impl Roster {
    /// Rows 1 to 3, and 4 to 8 as missing.
    pub fn standing(closed_form: RelightOptions) -> Self {
        let mut roster = Self(Vec::new());
        let methods: [Box<dyn Method>; 3] = [
            Box::new(DoNothing),
            Box::new(Matte),
            Box::new(ClosedForm {
                options: closed_form,
            }),
        ];
        for method in methods {
            roster.insert(method.row(), method.name().to_owned(), Ok(method));
        }
        for (number, name, reason) in STANDING {
            roster.insert(number, name.to_owned(), Err(reason.to_owned()));
        }
        roster.relabel();
        roster
    }

    /// The rows in the order of the table.
    pub fn rows(&self) -> &[Row] {
        &self.0
    }

    /// The name that a further row of this number takes when it is given none: of the first that is
    /// missing.
    pub fn missing_name(&self, number: u8) -> Option<&str> {
        let missing = |row: &&Row| row.number == number && row.method.is_err();
        self.0.iter().find(missing).map(|row| row.name.as_str())
    }

    /// Puts a method where its row is missing: that of its number and name, else the only one of its
    /// number; else beneath those of its number.
    ///
    /// # Errors
    /// [`RowTwice`] when a method of that number and name is there.
    pub fn fill(&mut self, method: Box<dyn Method>) -> Result<(), RowTwice> {
        let (number, name) = (method.row(), method.name().to_owned());
        let of_number: Vec<usize> = (0..self.0.len())
            .filter(|&index| self.0[index].number == number)
            .collect();
        let named = of_number
            .iter()
            .copied()
            .find(|&index| self.0[index].name == name);
        let only = match of_number.as_slice() {
            [only] if self.0[*only].method.is_err() => Some(*only),
            _ => None,
        };
        match named.or(only) {
            Some(index) if self.0[index].method.is_ok() => {
                return Err(RowTwice { number, name });
            }
            Some(index) => {
                self.0[index].name = name;
                self.0[index].method = Ok(method);
            }
            None => self.insert(number, name, Ok(method)),
        }
        self.relabel();
        Ok(())
    }

    /// Says why the row of that number and name is missing, unless a method fills it.
    pub fn miss(&mut self, number: u8, name: &str, reason: String) {
        let row = self
            .0
            .iter_mut()
            .find(|row| row.number == number && row.name == name);
        match row {
            Some(row) if row.method.is_err() => row.method = Err(reason),
            Some(_) => {}
            None => self.insert(number, name.to_owned(), Err(reason)),
        }
        self.relabel();
    }

    fn insert(&mut self, number: u8, name: String, method: Result<Box<dyn Method>, String>) {
        let place = self.0.partition_point(|row| row.number <= number);
        let label = String::new();
        let row = Row {
            number,
            label,
            name,
            method,
        };
        self.0.insert(place, row);
    }

    fn relabel(&mut self) {
        let numbers: Vec<u8> = self.0.iter().map(|row| row.number).collect();
        for (index, row) in self.0.iter_mut().enumerate() {
            let first = numbers.partition_point(|number| *number < row.number);
            let end = numbers.partition_point(|number| *number <= row.number);
            row.label = if end - first > 1 {
                format!("{}{}", row.number, letters(index - first))
            } else {
                row.number.to_string()
            };
        }
    }
}

/// a … z, then aa, ab …
fn letters(index: usize) -> String {
    let letter = char::from(b'a' + (index % 26) as u8);
    match index / 26 {
        0 => letter.to_string(),
        before => format!("{}{letter}", letters(before - 1)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::methods::{MethodError, Study, Subject};

    struct Named(u8, &'static str);

    impl Method for Named {
        fn row(&self) -> u8 {
            self.0
        }

        fn name(&self) -> &str {
            self.1
        }

        fn study<'a>(&'a self, _: Subject<'a>) -> Result<Box<dyn Study + 'a>, MethodError> {
            Err(MethodError::Silent("says nothing".to_owned()))
        }
    }

    fn labels(roster: &Roster) -> Vec<&str> {
        let labels = roster.rows().iter().map(|row| row.label.as_str());
        labels.collect()
    }

    #[test]
    fn a_method_takes_the_place_of_its_missing_row_and_further_ones_stand_beneath() {
        let mut roster = Roster::standing(RelightOptions::default());
        let standing = [
            "1", "2", "3", "4a", "4b", "4c", "5", "6", "7", "8a", "8b", "8c", "8d",
        ];
        assert_eq!(labels(&roster), standing);
        for (number, name) in [(4, PAPER_NOISY), (6, "OSS of another seed")] {
            roster.fill(Box::new(Named(number, name))).unwrap();
            assert_eq!(labels(&roster), standing, "{name}");
        }
        assert!(roster.rows()[4].method.is_ok() && roster.rows()[3].method.is_err());
        assert_eq!(roster.rows()[7].name, "OSS of another seed");
        roster
            .fill(Box::new(Named(6, "OSS, three lights")))
            .unwrap();
        assert_eq!(labels(&roster)[7..9], ["6a", "6b"]);
        let refused = roster.fill(Box::new(Named(6, "OSS, three lights")));
        assert!(refused.unwrap_err().to_string().contains("three lights"));
    }

    #[test]
    fn a_reason_reaches_a_missing_row_and_no_other() {
        let mut roster = Roster::standing(RelightOptions::default());
        roster.fill(Box::new(Named(5, SIPS))).unwrap();
        for (number, name) in [(4, PAPER_ENV), (5, SIPS)] {
            roster.miss(number, name, "the file is damaged".to_owned());
        }
        let method = |label: &str| {
            let row = roster.rows().iter().find(|row| row.label == label);
            row.unwrap().method.as_ref().map(|_| ())
        };
        assert_eq!(method("4c").unwrap_err(), "the file is damaged");
        assert!(method("5").is_ok());
    }
}
