//! The tables of the page.

use super::sheet::{Cell, Sheet};
use crate::eval::mse_table::COLUMNS;
use crate::eval::region_means::region_means;
use crate::eval::regions::Region;
use crate::eval::report::Report;
use crate::eval::savings::{Savings, TERMS};
use crate::eval::summary::{Figures, RowFigures};

/// Every row: how good, how fast, or why it is missing.
pub(super) fn methods(report: &Report) -> Sheet {
    let mut columns = vec!["row", "name", "PSNR dB, clean depth"];
    if report.noisy.is_some() {
        columns.push("PSNR dB, noisy depth");
    }
    columns.extend([
        "worst light dB",
        "SSIM",
        "shadow IoU",
        "shadow MSE ×1e-2",
        "ms a light",
        "remark",
    ]);
    let rows = report.rows.iter().map(|row| {
        let figures = row.figures.present();
        let psnr = |figures: Option<&Figures>| Some(figures?.mean?.linear_psnr_db.0);
        let mut cells = vec![
            Cell::text(&row.label),
            Cell::text(&row.name),
            Cell::number(psnr(figures), 2),
        ];
        let noisy = row.noisy.as_ref().and_then(RowFigures::present);
        if report.noisy.is_some() {
            cells.push(Cell::number(psnr(noisy), 2));
        }
        let of = |value: fn(&Figures) -> Option<f64>| figures.and_then(value);
        cells.extend([
            Cell::number(of(|row| Some(row.worst_linear_psnr_db?.0)), 2),
            Cell::number(of(|row| row.mean?.srgb_ssim), 3),
            Cell::number(of(|row| row.shadow_iou), 3),
            Cell::number(of(|row| Some(100.0 * row.shadow_mse?)), 2),
            Cell::number(of(|row| row.relight_ms), 2),
            Cell::text(remark(&row.figures, row.noisy.as_ref())),
        ]);
        cells
    });
    Sheet {
        stem: "methods",
        caption: "Every row of the comparison; PSNR, SSIM and IoU: higher is better; MSE and time: lower is better. Rows that are missing say why.".to_owned(),
        columns: columns.into_iter().map(str::to_owned).collect(),
        rows: rows.collect(),
    }
}

/// Why a row is missing, what its means lack, where it is worst.
fn remark(clean: &RowFigures, noisy: Option<&RowFigures>) -> String {
    let mut remarks = Vec::new();
    match clean {
        RowFigures::Missing { reason } => remarks.push(format!("missing: {reason}")),
        RowFigures::Present(figures) => {
            remarks.extend(figures.shortfall());
            let worst = figures.worst_direction;
            remarks.extend(worst.map(|worst| format!("worst direction: {worst}")));
        }
    }
    match (clean, noisy) {
        (RowFigures::Present(_), Some(RowFigures::Missing { reason })) => {
            remarks.push(format!("noisy depth: missing: {reason}"));
        }
        (_, Some(RowFigures::Present(figures))) => {
            remarks.extend(
                figures
                    .shortfall()
                    .map(|words| format!("noisy depth: {words}")),
            );
        }
        _ => {}
    }
    remarks.join("; ")
}

/// Mean squared errors beside those that were published.
pub(super) fn errors(report: &Report) -> Sheet {
    let mut columns = vec!["row".to_owned(), "name".to_owned(), "depth".to_owned()];
    columns.extend(COLUMNS.iter().map(|column| {
        let [what, range] = column.head;
        format!("{what} {range}").trim_end().to_owned()
    }));
    let shown = |value: Option<f64>| Cell::number(value.map(|value| 100.0 * value), 2);
    let mut rows = Vec::new();
    for row in &report.rows {
        for (depth, figures) in [("clean", Some(&row.figures)), ("noisy", row.noisy.as_ref())] {
            let Some(figures) = figures.and_then(RowFigures::present) else {
                continue;
            };
            let mut cells = vec![
                Cell::text(&row.label),
                Cell::text(&row.name),
                Cell::text(depth),
            ];
            cells.extend(COLUMNS.iter().map(|column| shown((column.value)(figures))));
            rows.push(cells);
        }
    }
    for paper in &report.published {
        for (depth, errors) in [
            ("clean", Some(&paper.clean)),
            ("noisy", paper.noisy.as_ref()),
        ] {
            let Some(errors) = errors else {
                continue;
            };
            let name = format!("as published, other data: {}", paper.name);
            let mut cells = vec![Cell::text(""), Cell::text(name), Cell::text(depth)];
            cells.extend(
                COLUMNS
                    .iter()
                    .map(|column| shown((column.published)(errors))),
            );
            rows.push(cells);
        }
    }
    Sheet {
        stem: "errors",
        caption: "Mean squared errors ×1e-2 of surfaces, shadows and relit light (lower is better). The published figures are of other data, their value ranges are not stated.".to_owned(),
        columns,
        rows,
    }
}

/// PSNR inside each region.
pub(super) fn regions(report: &Report) -> Sheet {
    let mut columns = vec!["row".to_owned(), "name".to_owned(), "depth".to_owned()];
    columns.extend(Region::ALL.map(|region| region.name().to_owned()));
    let rows = region_means(report).into_iter().flat_map(|row| {
        [("clean", row.clean), ("noisy", row.noisy)]
            .into_iter()
            .filter(|(_, decibels)| decibels.iter().any(Option::is_some))
            .map(|(depth, decibels)| {
                let mut cells = vec![
                    Cell::text(&row.label),
                    Cell::text(&row.name),
                    Cell::text(depth),
                ];
                cells.extend(decibels.map(|decibel| Cell::number(decibel, 2)));
                cells
            })
            .collect::<Vec<_>>()
    });
    Sheet {
        stem: "regions",
        caption: "PSNR of relit light by region, dB, linear light (higher is better).".to_owned(),
        columns,
        rows: rows.collect(),
    }
}

/// PSNR of every row on every capture.
pub(super) fn captures(report: &Report) -> Sheet {
    let answered: Vec<&str> = report
        .rows
        .iter()
        .filter(|row| row.figures.present().is_some_and(|row| row.mean.is_some()))
        .map(|row| row.label.as_str())
        .collect();
    let mut columns = vec!["capture".to_owned(), "pixels".to_owned()];
    columns.extend(answered.iter().map(|label| format!("row {label}")));
    columns.push("remark".to_owned());
    let rows = report.captures.iter().map(|capture| {
        let mut cells = vec![
            Cell::text(&capture.name),
            Cell::text(format!("{}×{}", capture.width, capture.height)),
        ];
        for label in &answered {
            let row = capture.rows.iter().find(|row| row.label == *label);
            let relit = row.and_then(|row| row.relit.as_ref());
            cells.push(Cell::number(
                relit.map(|relit| relit.mean.linear_psnr_db.0),
                2,
            ));
        }
        let mut remarks = capture.remarks.clone();
        if !capture.scale_known {
            remarks.push("compared after the best global scale".to_owned());
        }
        let silent = capture.silent.iter();
        remarks.extend(silent.map(|row| format!("row {}: {}", row.label, row.reason)));
        cells.push(Cell::text(remarks.join("; ")));
        cells
    });
    Sheet {
        stem: "captures",
        caption: "Every capture as it came: mean PSNR over its lights, dB, linear light (higher is better).".to_owned(),
        columns,
        rows: rows.collect(),
    }
}

/// Terms chosen per capture.
pub(super) fn savings(savings: &Savings) -> Sheet {
    let mut columns = vec!["capture".to_owned(), "terms used, 0 to 8".to_owned()];
    columns.extend(TERMS.map(|(name, _)| name.to_owned()));
    columns.extend([
        "time saved %".to_owned(),
        "with 4 lights %".to_owned(),
        "PSNR lost dB".to_owned(),
    ]);
    let rows = savings.captures.iter().map(|saving| {
        let mut cells = vec![Cell::text(&saving.capture), Cell::count(saving.terms())];
        for ((_, words), level) in TERMS.iter().zip(saving.levels) {
            cells.push(Cell::text(words[usize::from(level)]));
        }
        cells.push(Cell::Number(saving.saved_percent, 0));
        cells.push(Cell::Number(saving.saved_with_few_percent, 0));
        cells.push(Cell::Number(saving.lost_db, 2));
        cells
    });
    Sheet {
        stem: "savings",
        caption:
            "Terms chosen for every capture, and what choosing saved and cost against every term."
                .to_owned(),
        columns,
        rows: rows.collect(),
    }
}
