//! The table that stands beside the paper's: mean squared errors ×10⁻² of surfaces, shadows and
//! relit light, clean and noisy depth side by side.

use super::published::PublishedErrors;
use super::report::Report;
use super::summary::{Figures, RowFigures};
use std::fmt::{Formatter, Result, Write as _};

const NAME: usize = 44;
/// Width of one number.
const CELL: usize = 6;

/// A quantity of the table.
pub(super) struct Column {
    /// What and on which range.
    pub(super) head: [&'static str; 2],
    /// Name in the CSV.
    field: &'static str,
    pub(super) value: fn(&Figures) -> Option<f64>,
    /// What the paper prints for it, where it can be looked at in this column.
    pub(super) published: fn(&PublishedErrors) -> Option<f64>,
}

pub(super) const COLUMNS: [Column; 8] = [
    Column {
        head: ["albedo", "linear"],
        field: "albedo_linear_mse",
        value: |row| row.surfaces.albedo_linear_mse,
        published: |paper| Some(paper.albedo),
    },
    Column {
        head: ["albedo", "sRGB"],
        field: "albedo_srgb_mse",
        value: |row| row.surfaces.albedo_srgb_mse,
        published: |_| None,
    },
    Column {
        head: ["normal", "[0,1]"],
        field: "normal_unsigned_mse",
        value: |row| row.surfaces.normal_unsigned_mse,
        published: |paper| Some(paper.normal),
    },
    Column {
        head: ["normal", "[-1,1]"],
        field: "normal_signed_mse",
        value: |row| row.surfaces.normal_signed_mse,
        published: |_| None,
    },
    Column {
        head: ["roughness", ""],
        field: "roughness_mse",
        value: |row| row.surfaces.roughness_mse,
        published: |paper| Some(paper.roughness),
    },
    Column {
        head: ["shadow", ""],
        field: "shadow_mse",
        value: |row| row.shadow_mse,
        published: |paper| paper.shadow,
    },
    Column {
        head: ["relit", "linear"],
        field: "relit_linear_mse",
        value: |row| Some(row.mean?.linear_mse),
        published: |paper| paper.relit,
    },
    Column {
        head: ["relit", "sRGB"],
        field: "relit_srgb_mse",
        value: |row| Some(row.mean?.srgb_mse),
        published: |_| None,
    },
];

/// Writes the table for the terminal.
pub(super) fn write(out: &mut Formatter<'_>, report: &Report) -> Result {
    let noisy = report.noisy.is_some();
    let group = if noisy { 2 * CELL + 1 } else { CELL + 3 };
    writeln!(out, "Mean squared error ×1e-2")?;
    for line in 0..2 {
        write!(out, "  {:NAME$}", ["", "row"][line])?;
        for column in &COLUMNS {
            write!(out, "  {:>group$}", column.head[line])?;
        }
        writeln!(out)?;
    }
    if noisy {
        write!(out, "  {:NAME$}", "")?;
        for _ in &COLUMNS {
            write!(out, "  {:>CELL$} {:>CELL$}", "clean", "noisy")?;
        }
        writeln!(out)?;
    }
    for row in &report.rows {
        let name = format!("{} {}", row.label, row.name);
        let figures = [Some(&row.figures), row.noisy.as_ref()];
        if let [
            Some(RowFigures::Missing { reason }),
            None | Some(RowFigures::Missing { .. }),
        ] = figures
        {
            writeln!(out, "  {name:NAME$}  missing: {reason}")?;
            continue;
        }
        write!(out, "  {name:NAME$}")?;
        for column in &COLUMNS {
            let value = |figures: Option<&RowFigures>| (column.value)(figures?.present()?);
            cells(out, noisy, figures.map(value))?;
        }
        writeln!(out)?;
    }
    writeln!(
        out,
        "  as published (Qiu et al. 2020), of other data, value ranges not stated"
    )?;
    for paper in &report.published {
        write!(out, "    {:1$}", paper.name, NAME - 2)?;
        for column in &COLUMNS {
            let clean = (column.published)(&paper.clean);
            let noisy_value = paper.noisy.as_ref().and_then(column.published);
            cells(out, noisy, [clean, noisy_value])?;
        }
        writeln!(out)?;
    }
    notes(out, report)
}

fn cells(out: &mut Formatter<'_>, noisy: bool, [clean, dirty]: [Option<f64>; 2]) -> Result {
    let shown = |value: Option<f64>| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{:.2}", 100.0 * value))
    };
    if noisy {
        write!(out, "  {:>CELL$} {:>CELL$}", shown(clean), shown(dirty))
    } else {
        write!(out, "  {:>1$}", shown(clean), CELL + 3)
    }
}

/// What a row lacks, and where it is worst.
fn notes(out: &mut Formatter<'_>, report: &Report) -> Result {
    for row in &report.rows {
        let both = [("clean", Some(&row.figures)), ("noisy", row.noisy.as_ref())];
        let mut notes = Vec::new();
        for (depth, figures) in both {
            match figures {
                Some(RowFigures::Present(figures)) => {
                    let worst = figures
                        .worst_direction
                        .map(|worst| format!("worst {worst}"));
                    let found = [figures.shortfall(), worst].into_iter().flatten();
                    notes.extend(found.map(|note| format!("{depth}: {note}")));
                }
                Some(RowFigures::Missing { reason }) if depth == "noisy" => {
                    notes.push(format!("noisy: missing: {reason}"));
                }
                _ => {}
            }
        }
        let missing =
            |figures: Option<&RowFigures>| figures.is_none_or(|row| row.present().is_none());
        if !missing(Some(&row.figures)) || !missing(row.noisy.as_ref()) {
            for note in notes {
                writeln!(out, "  {}: {note}", row.label)?;
            }
        }
    }
    Ok(())
}

/// `table.csv`: one line per row and depth; empty fields are unknown. Errors are as they are, not
/// ×10⁻².
pub(super) fn csv(report: &Report) -> String {
    let mut text = String::from("row,name,depth,status,captures,absent_captures,absent_lights");
    for column in &COLUMNS {
        text.push(',');
        text.push_str(column.field);
    }
    text.push_str(",relit_linear_psnr_db,worst_linear_psnr_db,shadow_iou,relight_ms,remark\n");
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    for row in &report.rows {
        let both = [("clean", Some(&row.figures)), ("noisy", row.noisy.as_ref())];
        for (depth, figures) in both {
            let Some(figures) = figures else {
                continue;
            };
            let mut fields = vec![
                row.label.clone(),
                super::csv::quoted(&row.name),
                depth.into(),
            ];
            match figures {
                RowFigures::Missing { reason } => {
                    fields.push("missing".to_owned());
                    fields.extend(vec![String::new(); COLUMNS.len() + 7]);
                    fields.push(super::csv::quoted(reason));
                }
                RowFigures::Present(figures) => {
                    fields.push("present".to_owned());
                    let counts = [
                        figures.captures,
                        figures.absent_captures,
                        figures.absent_lights,
                    ];
                    fields.extend(counts.map(|count| count.to_string()));
                    fields.extend(COLUMNS.iter().map(|column| number((column.value)(figures))));
                    fields.extend([
                        number(figures.mean.map(|mean| mean.linear_psnr_db.0)),
                        number(figures.worst_linear_psnr_db.map(|worst| worst.0)),
                        number(figures.shadow_iou),
                        number(figures.relight_ms),
                        super::csv::quoted(&figures.shortfall().unwrap_or_default()),
                    ]);
                }
            }
            text.push_str(&fields.join(","));
            text.push('\n');
        }
    }
    for paper in &report.published {
        let name = format!("as published, other data: {}", paper.name);
        for (depth, errors) in [
            ("clean", Some(&paper.clean)),
            ("noisy", paper.noisy.as_ref()),
        ] {
            let Some(errors) = errors else {
                continue;
            };
            _ = write!(text, ",{},{depth},published,,,", super::csv::quoted(&name));
            for column in &COLUMNS {
                _ = write!(text, ",{}", number((column.published)(errors)));
            }
            text.push_str(",,,,,value ranges not stated\n");
        }
    }
    text
}
