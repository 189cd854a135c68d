//! A table that is shown as HTML and kept as CSV and JSON.

use super::html::escaped;
use crate::eval::csv::quoted;

/// Letters from which on a text is given room.
const LONG: usize = 24;

/// One table of the page.
pub(super) struct Sheet {
    /// Name of its files, without ending.
    pub(super) stem: &'static str,
    /// What it shows, in one sentence.
    pub(super) caption: String,
    pub(super) columns: Vec<String>,
    pub(super) rows: Vec<Vec<Cell>>,
}

/// One field of a table.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Text(String),
    /// A number and how many digits after the point are shown.
    Number(f64, usize),
    /// A number with how good it is, from −1 (bad) to 1 (good), for its color.
    Judged(f64, usize, f64),
    /// Not known.
    Nothing,
}

impl Cell {
    pub(super) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// A number that is known, finite or not.
    pub(super) fn number(value: Option<f64>, digits: usize) -> Self {
        value.map_or(Self::Nothing, |value| Self::Number(value, digits))
    }

    pub(super) fn count(value: usize) -> Self {
        Self::Number(value as f64, 0)
    }

    fn html(&self) -> String {
        match self {
            Self::Text(text) if text.chars().count() > LONG => {
                format!("<td class=w>{}</td>", escaped(text))
            }
            Self::Text(text) => format!("<td>{}</td>", escaped(text)),
            Self::Nothing => "<td class=n>–</td>".to_owned(),
            Self::Number(value, digits) => format!("<td class=n>{}</td>", shown(*value, *digits)),
            Self::Judged(value, digits, good) => {
                let hue = if *good < 0.0 { "213,94,0" } else { "0,158,115" };
                let share = 0.55 * good.abs().min(1.0);
                format!(
                    "<td class=n style=\"background:rgba({hue},{share:.2})\">{}</td>",
                    shown(*value, *digits)
                )
            }
        }
    }

    fn csv(&self) -> String {
        match self {
            Self::Text(text) => quoted(text),
            Self::Number(value, _) | Self::Judged(value, ..) if value.is_finite() => {
                value.to_string()
            }
            _ => String::new(),
        }
    }

    fn json(&self) -> serde_json::Value {
        match self {
            Self::Text(text) => text.clone().into(),
            Self::Number(value, _) | Self::Judged(value, ..) => (*value).into(),
            Self::Nothing => serde_json::Value::Null,
        }
    }
}

/// A number with its digits; one that is not finite is a perfect answer, which has no decibel.
fn shown(value: f64, digits: usize) -> String {
    if value.is_finite() {
        format!("{value:.digits$}")
    } else {
        "exact".to_owned()
    }
}

impl Sheet {
    /// The table in a box that scrolls, with links to its files.
    pub(super) fn html(&self) -> String {
        let heads = self.columns.iter().map(|column| {
            let column = escaped(column);
            format!("<th scope=col>{column}</th>")
        });
        let rows = self.rows.iter().map(|row| {
            let cells: String = row.iter().map(Cell::html).collect();
            format!("<tr>{cells}</tr>\n")
        });
        format!(
            "<figure><figcaption>{} <small>(<a href=\"{stem}.csv\">CSV</a>, <a href=\"{stem}.json\">JSON</a>)</small></figcaption>\n\
             <div class=scroll tabindex=0><table><thead><tr>{}</tr></thead><tbody>\n{}</tbody></table></div></figure>\n",
            escaped(&self.caption),
            heads.collect::<String>(),
            rows.collect::<String>(),
            stem = self.stem
        )
    }

    /// Both files: name and contents.
    pub(super) fn files(&self) -> [(String, Vec<u8>); 2] {
        let line = |fields: Vec<String>| fields.join(",") + "\n";
        let mut csv = line(self.columns.iter().map(|column| quoted(column)).collect());
        for row in &self.rows {
            csv.push_str(&line(row.iter().map(Cell::csv).collect()));
        }
        let rows = self.rows.iter().map(|row| {
            let fields = self.columns.iter().zip(row);
            let fields = fields.map(|(column, cell)| (column.clone(), cell.json()));
            fields.collect::<serde_json::Map<_, _>>().into()
        });
        let json = serde_json::json!({
            "caption": self.caption,
            "rows": rows.collect::<Vec<serde_json::Value>>(),
        });
        [
            (format!("{}.csv", self.stem), csv.into_bytes()),
            (
                format!("{}.json", self.stem),
                format!("{json:#}\n").into_bytes(),
            ),
        ]
    }
}
