//! What choosing terms per capture saves and costs against modelling every term.

use super::report::{CaptureReport, Report, RowReport};
use super::roster::{OURS_AUTO, OURS_EVERYTHING};
use super::summary::{RowFigures, mean};
use crate::parsimony::{Bounced, Geometry, Shadow, Terms};
use crate::scene::Material;

/// Lamps that a person asks for: a capture's time is stated for so few, too.
const FEW: usize = 4;
/// The terms, each with its levels from none to all.
pub(super) const TERMS: [(&str, [&str; 3]); 4] = [
    ("geometry", ["one plane", "smooth", "full"]),
    ("material", ["matte", "one roughness", "varying"]),
    ("shadow", ["none", "swept", "with network"]),
    ("bounced", ["none", "even", "by what is near"]),
];
/// Levels above the lowest of all terms together.
pub(super) const MOST_TERMS: usize = 8;

/// One capture: terms chosen against every term.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Saving {
    pub(super) capture: String,
    /// Level of each of [`TERMS`], 0 to 2.
    pub(super) levels: [u8; 4],
    /// Choosing, developing and all lamps of the capture, percent of the time that every term takes.
    pub(super) saved_percent: f64,
    /// The same with [`FEW`] lamps.
    pub(super) saved_with_few_percent: f64,
    /// PSNR in linear light.
    pub(super) lost_db: f64,
}

impl Saving {
    /// Levels above the lowest, all terms together: 0 to [`MOST_TERMS`].
    pub(super) fn terms(&self) -> usize {
        self.levels.iter().map(|level| usize::from(*level)).sum()
    }

    fn of(capture: &str, chosen: &RowReport, full: &RowReport) -> Option<Self> {
        let decibel = |row: &RowReport| {
            let decibel = row.relit.as_ref()?.mean.linear_psnr_db.0;
            decibel.is_finite().then_some(decibel)
        };
        let lamps = full.relit.as_ref()?.lights.len();
        let saved = |lamps| {
            let share = milliseconds(chosen, lamps)? / milliseconds(full, lamps)?;
            Some(100.0 * (1.0 - share))
        };
        Some(Self {
            capture: capture.to_owned(),
            levels: levels(&chosen.terms?.terms),
            saved_percent: saved(lamps)?,
            saved_with_few_percent: saved(FEW)?,
            lost_db: decibel(full)? - decibel(chosen)?,
        })
    }
}

/// Choosing, developing and so many lamps.
fn milliseconds(row: &RowReport, lamps: usize) -> Option<f64> {
    let terms = row.terms?;
    let lamp = row.relit.as_ref()?.relight?.mean_ms;
    Some(terms.choosing_ms + terms.developing_ms + lamps as f64 * lamp)
}

fn levels(terms: &Terms) -> [u8; 4] {
    let geometry = match terms.geometry {
        Geometry::Plane => 0,
        Geometry::Smooth => 1,
        Geometry::Full => 2,
    };
    let material = match terms.material {
        Material::Matte => 0,
        Material::OneRoughness => 1,
        Material::Varying => 2,
    };
    let shadow = match terms.shadow {
        Shadow::None => 0,
        Shadow::Swept => 1,
        Shadow::Network => 2,
    };
    let indirect = match terms.indirect {
        Bounced::None => 0,
        Bounced::Constant => 1,
        Bounced::Predicted => 2,
    };
    [geometry, material, shadow, indirect]
}

/// All captures of a report.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Savings {
    pub(super) captures: Vec<Saving>,
    /// Percent saved, dB lost: means over captures.
    pub(super) mean: Option<(f64, f64)>,
    /// What is compared, and the means.
    pub(super) words: String,
    /// Why there is nothing to compare; empty where there is.
    pub(super) missing: String,
}

impl Savings {
    /// Row "auto" against row "everything", as the captures came.
    pub(super) fn of(report: &Report) -> Self {
        let summary = |name: &str| report.rows.iter().find(|row| row.name == name);
        let label = |name| summary(name).map_or_else(String::new, |row| row.label.clone());
        let (auto, full) = (label(OURS_AUTO), label(OURS_EVERYTHING));
        let captures = report
            .captures
            .iter()
            .filter_map(|capture: &CaptureReport| {
                let of_label = |label: &str| capture.rows.iter().find(|row| row.label == label);
                Saving::of(&capture.name, of_label(&auto)?, of_label(&full)?)
            });
        let captures: Vec<Saving> = captures.collect();
        let saved = mean(captures.iter().map(|one| one.saved_percent));
        let with_few = mean(captures.iter().map(|one| one.saved_with_few_percent));
        let lost = mean(captures.iter().map(|one| one.lost_db));
        let means = saved.zip(lost);
        let words = means.zip(with_few).map_or_else(String::new, |((saved, lost), few)| {
            format!(
                "row {auto} against row {full}, {} captures: mean {saved:.0} % of the time saved, {lost:.2} dB lost (the cross); time = choosing, developing and all lamps of a capture (with {FEW} lamps {few:.0} %)",
                captures.len()
            )
        });
        let missing = [OURS_AUTO, OURS_EVERYTHING].iter().find_map(|name| {
            match summary(name).map(|row| &row.figures) {
                None => Some(format!("missing: there is no row \"{name}\"")),
                Some(RowFigures::Missing { reason }) => {
                    Some(format!("missing: row \"{name}\": {reason}"))
                }
                Some(RowFigures::Present(_)) => None,
            }
        });
        let missing = match (missing, captures.is_empty()) {
            (Some(missing), _) => missing,
            (None, true) => "missing: no capture was answered by both rows".to_owned(),
            (None, false) => String::new(),
        };
        Self {
            captures,
            mean: means,
            words,
            missing,
        }
    }
}
