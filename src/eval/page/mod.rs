//! A report as one page that needs nothing but itself, and its tables as files.

mod html;
mod sheet;
mod light_set_table;
mod stability_tables;
mod tables;

use super::report::Report;
use super::report_folder::Extent;
use super::savings::Savings;
use super::stability::{COMPARED, StabilityReport};
use super::summary::RowFigures;
use html::escaped;
use sheet::Sheet;

const STYLE: &str = include_str!("style.css");
/// What detectors are to reach.
const GOOD_AUROC: f64 = 0.95;
/// Captures that are listed in the open; of more, the list is folded.
const OPEN_CAPTURES: usize = 16;

/// `index.html`, and every table of it as CSV and JSON: name and contents. `charts` are the files
/// of the report's charts.
pub(super) fn files(
    report: &Report,
    charts: &[(String, Vec<u8>)],
    extent: Extent,
) -> Vec<(String, Vec<u8>)> {
    let page = Page {
        report,
        charts,
        extent,
    };
    let (body, sheets) = page.body();
    let title = escaped(&page.title());
    let html = format!(
        "<!doctype html>\n<html lang=en>\n<head>\n<meta charset=utf-8>\n\
         <meta name=viewport content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    );
    let mut files = vec![("index.html".to_owned(), html.into_bytes())];
    files.extend(sheets.iter().flat_map(Sheet::files));
    files
}

/// Stems of all tables of the page.
pub(super) const TABLES: [&str; 9] = [
    "methods",
    "errors",
    "growth",
    "growth_by_corruption",
    "detectors",
    "light_sets",
    "regions",
    "captures",
    "savings",
];

struct Page<'a> {
    report: &'a Report,
    charts: &'a [(String, Vec<u8>)],
    extent: Extent,
}

impl Page<'_> {
    fn title(&self) -> String {
        let captures = self.report.captures.len();
        let plural = if captures == 1 { "" } else { "s" };
        format!("Relighting measured on {captures} capture{plural}")
    }

    /// The whole page, and its tables.
    fn body(&self) -> (String, Vec<Sheet>) {
        let Self { report, .. } = self;
        let savings = Savings::of(report);
        let stability = report.stability.as_ref();
        let mut text = self.head(&savings);
        let mut sheets = Vec::new();
        let mut show = |text: &mut String, sheet: Sheet| {
            text.push_str(&sheet.html());
            sheets.push(sheet);
        };

        section(&mut text, "methods", "Who relights best");
        show(&mut text, tables::methods(report));
        text.push_str(&self.missing());
        text.push_str("<details><summary>Errors of surfaces, shadows and light, beside the published ones</summary>\n");
        show(&mut text, tables::errors(report));
        text.push_str("</details>\n");

        section(&mut text, "speed", "Speed against accuracy");
        text.push_str(&self.chart("speed_accuracy"));

        section(&mut text, "stability", "Stability");
        match stability {
            None => text.push_str(
                "<p>Missing: no capture was made worse (<code>--corrupt all</code>).</p>\n",
            ),
            Some(stability) if stability.captures.is_empty() => text.push_str(
                "<p>Missing: no capture has true pictures, so that none was made worse.</p>\n",
            ),
            Some(stability) => {
                show(&mut text, stability_tables::growth(stability));
                text.push_str(&self.chart("stability"));
                show(&mut text, stability_tables::growth_by_corruption(stability));
                show(&mut text, stability_tables::detectors(stability));
            }
        }

        section(&mut text, "parsimony", "Parsimony");
        text.push_str(&self.chart("parsimony"));
        if !savings.captures.is_empty() {
            text.push_str("<details><summary>Terms of every capture</summary>\n");
            show(&mut text, tables::savings(&savings));
            text.push_str("</details>\n");
        }

        section(&mut text, "environments", "Environments by few lights");
        if report.light_sets.is_empty() {
            text.push_str(
                "<p>Missing: no sets of lights were compared (<code>--light-sets</code>).</p>\n",
            );
        } else {
            text.push_str(&self.chart("light_sets"));
            show(&mut text, light_set_table::light_sets(&report.light_sets));
        }

        section(&mut text, "directions", "Where the light stands");
        text.push_str(&self.chart("polar_maps"));
        text.push_str(&self.chart("angle_curves"));
        text.push_str(&self.hemispheres());

        section(&mut text, "regions", "Where in the picture");
        text.push_str(&self.chart("regions"));
        show(&mut text, tables::regions(report));

        section(&mut text, "captures", "Capture by capture");
        let folded = report.captures.len() > OPEN_CAPTURES;
        if folded {
            text.push_str("<details><summary>All captures</summary>\n");
        }
        show(&mut text, tables::captures(report));
        if folded {
            text.push_str("</details>\n");
        }

        section(&mut text, "protocol", "How it was measured");
        text.push_str("<ul>\n");
        for line in &report.protocol {
            text.push_str(&format!("<li>{}</li>\n", escaped(line)));
        }
        text.push_str("</ul>\n");
        text.push_str(match self.extent {
            Extent::Everything => "<p>Everything measured, light by light: <a href=\"report.json\">report.json</a>, <a href=\"report.csv\">report.csv</a>.</p>\n",
            Extent::Summary => "<p>Figures light by light are not kept; the command above makes them without <code>--summary</code>.</p>\n",
        });
        (text, sheets)
    }

    /// Title, what was measured where and how, and the figures that stand out.
    fn head(&self, savings: &Savings) -> String {
        let Report { machine, made, .. } = self.report;
        let build = if machine.release_build {
            "release build"
        } else {
            "development build"
        };
        let processor = machine.processor.as_deref().unwrap_or("processor unknown");
        let mut text = format!(
            "<h1>{}</h1>\n<p class=made>captured {}, {}, {}, {}, {} threads, {build}</p>\n",
            escaped(&self.title()),
            escaped(made.version),
            escaped(&made.at),
            escaped(processor),
            escaped(&machine.target),
            machine.threads
        );
        if !made.command.is_empty() {
            let command = escaped(&made.command);
            text.push_str(&format!("<pre><code>{command}</code></pre>\n"));
        }
        text.push_str("<ul class=key>\n");
        for (figure, words) in self.key_figures(savings) {
            text.push_str(&format!(
                "<li><b>{}</b> {}</li>\n",
                escaped(&figure),
                escaped(&words)
            ));
        }
        text.push_str("</ul>\n<nav aria-label=Contents>");
        for (anchor, words) in [
            ("methods", "Methods"),
            ("speed", "Speed"),
            ("stability", "Stability"),
            ("parsimony", "Parsimony"),
            ("environments", "Environments"),
            ("directions", "Directions"),
            ("regions", "Regions"),
            ("captures", "Captures"),
            ("protocol", "Protocol"),
        ] {
            text.push_str(&format!("<a href=\"#{anchor}\">{words}</a>"));
        }
        text.push_str("</nav>\n");
        text
    }

    fn key_figures(&self, savings: &Savings) -> Vec<(String, String)> {
        let mut found = Vec::new();
        let relit = self.report.rows.iter().filter_map(|row| {
            let mean = row.figures.present()?.mean?;
            Some((row, mean.linear_psnr_db))
        });
        if let Some((row, psnr)) = relit.max_by(|a, b| a.1.0.total_cmp(&b.1.0)) {
            let words = format!("mean PSNR of the best row, {} {}", row.label, row.name);
            found.push((format!("{psnr} dB"), words));
        }
        let stability = self.report.stability.iter().flat_map(ours);
        for (row, growth) in stability {
            let words = format!(
                "error growth at severity {COMPARED} of row {} {}",
                row.0, row.1
            );
            found.push((format!("{growth:.2}×"), words));
        }
        if let Some(stability) = &self.report.stability {
            let scored = || stability.detectors.iter().filter_map(|one| one.auroc);
            let good = scored().filter(|auroc| *auroc >= GOOD_AUROC).count();
            if scored().next().is_some() {
                found.push((
                    format!("{good} of {}", scored().count()),
                    format!("corruptions that harm are told from clean captures with an AUROC of {GOOD_AUROC} or more"),
                ));
            }
        }
        if let Some((saved, lost)) = savings.mean {
            let change = if lost < 0.0 { "gained" } else { "lost" };
            let words = if saved < 0.0 {
                "more time"
            } else {
                "of the time saved"
            };
            found.push((
                format!("{:.0} %", saved.abs()),
                format!(
                    "{words} by choosing terms per capture, {:.2} dB {change}",
                    lost.abs()
                ),
            ));
        }
        found
    }

    /// Which rows have no figures, in one sentence each.
    fn missing(&self) -> String {
        let missing = self
            .report
            .rows
            .iter()
            .filter_map(|row| match &row.figures {
                RowFigures::Missing { reason } => Some(format!(
                    "<li>{} {}: {}</li>\n",
                    escaped(&row.label),
                    escaped(&row.name),
                    escaped(reason)
                )),
                RowFigures::Present(_) => None,
            });
        let missing: String = missing.collect();
        if missing.is_empty() {
            return String::new();
        }
        format!("<p>Rows that are missing, and why:</p>\n<ul>\n{missing}</ul>\n")
    }

    /// A chart in its card, with links to its files.
    fn chart(&self, stem: &str) -> String {
        let file = format!("{stem}.svg");
        let found = self.charts.iter().find(|(name, _)| *name == file);
        let Some(svg) = found.and_then(|(_, bytes)| std::str::from_utf8(bytes).ok()) else {
            return String::new();
        };
        let stem = escaped(stem);
        let mut parts = svg.split('"').skip_while(|part| !part.ends_with(" width="));
        let width = parts.nth(1).unwrap_or("1000");
        let open = format!("<svg role=img aria-label=\"{stem}\" style=\"max-width:{width}px\" ");
        let svg = svg.replacen("<svg ", &open, 1);
        format!(
            "<figure><div class=chart tabindex=0>{svg}</div><small><a href=\"{stem}.png\">PNG</a>, <a href=\"{stem}.svg\">SVG</a></small></figure>\n"
        )
    }

    /// Links to the detailed maps of every row.
    fn hemispheres(&self) -> String {
        let maps = self.charts.iter().filter_map(|(name, _)| {
            let label = name.strip_prefix("hemisphere_")?.strip_suffix(".svg")?;
            let label = escaped(label);
            Some(format!("<a href=\"hemisphere_{label}.svg\">{label}</a>"))
        });
        let maps: Vec<String> = maps.collect();
        if maps.is_empty() {
            return String::new();
        }
        format!(
            "<p>Maps with every cell's figure, clean and noisy depth, of row {}.</p>\n",
            maps.join(", ")
        )
    }
}

/// Label, name and mean growth of our own rows: the closed form and the one that chooses.
fn ours(stability: &StabilityReport) -> Vec<((&str, &str), f64)> {
    let rows = stability
        .growth
        .iter()
        .filter(|row| row.label == "3" || row.name == super::roster::OURS_AUTO);
    rows.filter_map(|row| Some(((row.label.as_str(), row.name.as_str()), row.mean_growth?)))
        .collect()
}

fn section(text: &mut String, anchor: &str, title: &str) {
    text.push_str(&format!("<h2 id=\"{anchor}\">{}</h2>\n", escaped(title)));
}
