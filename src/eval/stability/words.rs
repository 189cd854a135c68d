//! The stability run as text: for the terminal, and as CSV.

use super::{COMPARED, StabilityReport};
use crate::eval::csv::quoted;
use std::fmt::Write as _;

impl std::fmt::Display for StabilityReport {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            out,
            "Stability ({} captures, {} corruptions, seed {}): error growth at severity {COMPARED}, mean over corruptions",
            self.captures.len(),
            self.ways.len(),
            self.seed
        )?;
        for row in &self.growth {
            let name = format!("{} {}", row.label, row.name);
            write!(out, "  {name:44}")?;
            match (row.mean_growth, row.worst) {
                (Some(mean), Some((way, growth))) => {
                    write!(out, " {mean:.2}×, most by {way} ({growth:.2}×)")?;
                }
                _ => write!(out, " severity {COMPARED} was not measured")?,
            }
            let worse = row.worse_than_nothing.iter();
            let worse: Vec<String> = worse
                .map(|(way, severity)| format!("{way}:{severity}"))
                .collect();
            match worse.as_slice() {
                [] => writeln!(out, "; never worse than doing nothing")?,
                some => writeln!(out, "; worse than doing nothing from {}", some.join(", "))?,
            }
        }
        let scored = self
            .detectors
            .iter()
            .filter_map(|one| Some((one.mode, one.auroc?)));
        let scored: Vec<String> = scored
            .map(|(mode, auroc)| format!("{mode} {auroc:.2}"))
            .collect();
        if !scored.is_empty() {
            writeln!(
                out,
                "  AUROC of what shots say of themselves: {}",
                scored.join(", ")
            )?;
        }
        for way in &self.ways {
            if let Some(reason) = &way.first_refusal {
                writeln!(
                    out,
                    "  {}: {} states could not be developed, the first: {reason}",
                    way.name, way.refused
                )?;
            }
        }
        Ok(())
    }
}

/// `stability.csv`: one line per way, row and severity, means over captures.
pub(in crate::eval) fn csv(report: &StabilityReport) -> String {
    let mut text = String::from(
        "corruption,level,unit,row,severity,captures,linear_mse,growth,mean_of_growths,nothing_linear_mse,worse_captures\n",
    );
    for way in &report.ways {
        for row in &way.rows {
            for point in &row.points {
                let level = usize::from(point.severity).checked_sub(1);
                let level = level.map(|step| way.levels[step].to_string());
                let nothing = point.nothing_linear_mse.map(|mse| mse.to_string());
                _ = writeln!(
                    text,
                    "{},{},{},{},{},{},{},{},{},{},{}",
                    way.name,
                    level.unwrap_or_default(),
                    quoted(way.unit),
                    row.label,
                    point.severity,
                    point.captures,
                    point.linear_mse,
                    point.growth,
                    point.mean_of_growths,
                    nothing.unwrap_or_default(),
                    point.worse_captures
                );
            }
        }
    }
    text
}
