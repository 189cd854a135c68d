//! The tables of the stability run.

use super::sheet::{Cell, Sheet};
use crate::eval::stability::{COMPARED, HARMED_GROWTH, StabilityReport};

/// One line per row, over all corruptions.
pub(super) fn growth(stability: &StabilityReport) -> Sheet {
    let rows = stability.growth.iter().map(|row| {
        let worse = row.worse_than_nothing.iter();
        let worse: Vec<String> = worse
            .map(|(way, severity)| format!("{way}:{severity}"))
            .collect();
        vec![
            Cell::text(&row.label),
            Cell::text(&row.name),
            Cell::number(row.mean_growth, 2),
            Cell::text(row.worst.map_or("", |(way, _)| way)),
            Cell::number(row.worst.map(|(_, growth)| growth), 2),
            Cell::text(match worse.as_slice() {
                [] if row.label == "1" => "is doing nothing".to_owned(),
                [] => "never".to_owned(),
                some => some.join(", "),
            }),
        ]
    });
    let columns = [
        "row",
        "name",
        "mean error growth ×",
        "suffers most from",
        "growth ×",
        "worse than doing nothing from (corruption:severity)",
    ];
    Sheet {
        stem: "growth",
        caption: format!(
            "Error growth at severity {COMPARED}: mean squared error over that of the same captures as they came (lower is better; 1 = unharmed), mean over {} corruptions. Aim: at most 1.35, and never worse than doing nothing.",
            stability.ways.len()
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}

/// Growth of every row by every corruption.
pub(super) fn growth_by_corruption(stability: &StabilityReport) -> Sheet {
    let severity = if stability.severities.contains(&COMPARED) {
        COMPARED
    } else {
        stability.severities.last().copied().unwrap_or(COMPARED)
    };
    let labels: Vec<&str> = stability
        .growth
        .iter()
        .map(|row| row.label.as_str())
        .collect();
    let mut columns = vec!["corruption".to_owned(), "how much".to_owned()];
    columns.extend(labels.iter().map(|label| format!("row {label}")));
    columns.extend(["not developed".to_owned(), "why not".to_owned()]);
    let rows = stability.ways.iter().map(|way| {
        let level = way.levels[usize::from(severity - 1)];
        let mut cells = vec![
            Cell::text(way.name),
            Cell::text(format!("{level} {}", way.unit)),
        ];
        for label in &labels {
            let curve = way.rows.iter().find(|curve| curve.label == *label);
            cells.push(match curve.and_then(|curve| curve.growth_at(severity)) {
                // Eight times the error is as bad as it gets in color.
                Some(growth) => Cell::Judged(growth, 2, -growth.log2() / 3.0),
                None => Cell::Nothing,
            });
        }
        cells.push(Cell::count(way.refused));
        cells.push(Cell::text(way.first_refusal.as_deref().unwrap_or_default()));
        cells
    });
    Sheet {
        stem: "growth_by_corruption",
        caption: format!(
            "Error growth at severity {severity} by corruption (×, lower is better; orange: the error grew, green: it shrank)."
        ),
        columns,
        rows: rows.collect(),
    }
}

/// How well findings tell harmed captures from clean ones.
pub(super) fn detectors(stability: &StabilityReport) -> Sheet {
    let percent = |share: Option<f64>| Cell::number(share.map(|share| 100.0 * share), 0);
    let rows = stability.detectors.iter().map(|one| {
        vec![
            Cell::text(one.mode),
            match one.auroc {
                // Chance is 0.5.
                Some(auroc) => Cell::Judged(
                    auroc,
                    3,
                    (auroc - 0.95) * if auroc < 0.95 { 2.2 } else { 20.0 },
                ),
                None => Cell::Nothing,
            },
            Cell::count(one.harmed),
            Cell::count(one.unharmed),
            Cell::count(one.clean),
            percent(one.found),
            percent(one.false_alarms),
        ]
    });
    let columns = [
        "corruption",
        "AUROC",
        "harmed",
        "not harmed",
        "clean",
        "harmed that are called harmful %",
        "clean that are called harmful %",
    ];
    Sheet {
        stem: "detectors",
        caption: format!(
            "What a shot says about itself, held against what was done to it. Harmed: the closed form's error grew more than {HARMED_GROWTH}×, any severity; AUROC: how surely the finding of that name is higher for a harmed capture than for a clean one (higher is better, 0.5 = chance; aim: 0.95). – = nothing was harmed."
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}
