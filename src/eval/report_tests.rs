//! Claims about reports, their files and charts, and shadows derived from photographs.

use super::photometric::MatteFit;
use super::summary::RowFigures;
use super::*;
use crate::relight::RelightOptions;
use drivers::Plane;
use glam::Vec3;

/// A report without a capture.
fn empty_report() -> Report {
    let roster = Roster::standing(RelightOptions::default());
    evaluate(
        &[],
        &roster,
        &EvalOptions::default(),
        &Ledger::none(),
        |_| {},
    )
    .unwrap()
}

#[test]
fn every_row_stands_in_the_table_and_those_without_figures_say_why() {
    let report = empty_report();
    let numbers: Vec<u8> = report.rows.iter().map(|row| row.row).collect();
    assert_eq!(numbers, [1, 2, 3, 4, 4, 4, 5, 6, 7, 8, 8, 8, 8]);
    let text = report.to_string();
    for row in &report.rows {
        let RowFigures::Missing { reason } = &row.figures else {
            panic!("row {} has figures without a capture", row.row)
        };
        assert!(!reason.is_empty());
        assert!(text.contains(&format!("{} {}", row.label, row.name)) && text.contains(reason));
    }
}

#[test]
fn reports_and_charts_are_written_in_every_format() {
    let report = empty_report();
    let folder = tempfile::tempdir().unwrap();
    ReportFolder::begin(folder.path())
        .unwrap()
        .write(&report, Extent::Everything)
        .unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&read("report.json")).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), 13);
    assert_eq!(json["rows"][3]["status"], "missing");
    let table: serde_json::Value = serde_json::from_slice(&read("table.json")).unwrap();
    assert_eq!(table["rows"], json["rows"]);
    assert_eq!(table["published"][0]["noisy"]["shadow"], 5.53e-2);
    for name in ["report.csv", "table.csv"] {
        let csv = String::from_utf8(read(name)).unwrap();
        let mut lines = csv.lines().map(fields);
        let columns = lines.next().unwrap();
        assert!(lines.clone().count() >= 13 && lines.all(|fields| fields == columns));
    }
    for stem in ["rows", "speed_accuracy", "angle_curves"] {
        let svg = String::from_utf8(read(&format!("{stem}.svg"))).unwrap();
        for row in &report.rows {
            let name = row.name.replace('\'', "&apos;");
            assert!(
                svg.contains(&name) || svg.contains(&row.name),
                "{stem}.svg lacks {name}"
            );
        }
        let png = read(&format!("{stem}.png"));
        let decoder = png::Decoder::new(std::io::Cursor::new(&png));
        let mut picture = decoder.read_info().unwrap();
        let mut pixels = vec![0; picture.output_buffer_size().unwrap()];
        picture.next_frame(&mut pixels).unwrap();
        let dark = pixels.iter().filter(|value| **value < 100).count();
        assert!(dark > 1000, "{stem}.png has no text: {dark} dark values");
    }
}

/// Fields of a CSV line.
fn fields(line: &str) -> usize {
    let outside = line.split('"').step_by(2);
    1 + outside.map(|part| part.matches(',').count()).sum::<usize>()
}

#[test]
fn an_earlier_report_is_replaced_whole_and_anything_else_is_left_alone() {
    let report = empty_report();
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("report");
    ReportFolder::begin(&folder)
        .unwrap()
        .write(&report, Extent::Everything)
        .unwrap();
    std::fs::write(
        folder.join("hemisphere_gone.svg"),
        "of a capture of last time",
    )
    .unwrap();
    ReportFolder::begin(&folder)
        .unwrap()
        .write(&report, Extent::Everything)
        .unwrap();
    assert!(!folder.join("hemisphere_gone.svg").exists());

    std::fs::write(folder.join("thesis.txt"), "mine").unwrap();
    let Err(refused) = ReportFolder::begin(&folder) else {
        panic!("a stranger's file does not matter");
    };
    assert!(refused.to_string().contains("thesis.txt"), "{refused}");
    assert!(folder.join("report.json").exists());
    assert_eq!(std::fs::read_dir(parent.path()).unwrap().count(), 1);
    let Err(refused) = ReportFolder::begin(&parent.path().join("gone/report")) else {
        panic!("there is no folder to put it in");
    };
    assert!(refused.to_string().contains("gone"), "{refused}");
}

#[test]
fn a_dark_patch_on_a_surface_that_faces_the_lamp_is_cast_shadow() {
    const SIZE: usize = 24;
    let normal = Plane::filled(SIZE, SIZE, Vec3::NEG_Z);
    let counts = Plane::filled(SIZE, SIZE, true);
    let in_patch = |x: usize, y: usize| (8..14).contains(&x) && (6..18).contains(&y);
    let photographs: Vec<(Vec3, Plane<f32>)> = (0..8)
        .map(|light| {
            let angle = light as f32;
            let toward = Vec3::new(0.5 * angle.cos(), 0.5 * angle.sin(), -1.0).normalize();
            let picture = Plane::from_fn(SIZE, SIZE, |x, y| {
                let shadow = if light == 3 && in_patch(x, y) {
                    0.1
                } else {
                    1.0
                };
                0.6 * -toward.z * shadow
            });
            (toward, picture)
        })
        .collect();
    let fit = MatteFit::new(&normal, &photographs, &counts).unwrap();
    for (light, (toward, picture)) in photographs.iter().enumerate() {
        let shadow = fit.cast_shadow(&normal, *toward, picture);
        for y in 0..SIZE {
            for x in 0..SIZE {
                let expected = if light == 3 && in_patch(x, y) {
                    0.0
                } else {
                    1.0
                };
                assert_eq!(shadow[(x, y)], expected, "light {light} at ({x}, {y})");
            }
        }
    }
    assert!((fit.reflectance()[(12, 12)] - 0.6).abs() < 1e-5);
    let behind = fit.cast_shadow(&normal, Vec3::Z, &photographs[0].1);
    assert!(behind.samples().iter().all(|lit| lit.is_nan()));
    assert!(MatteFit::new(&normal, &photographs[..4], &counts).is_none());
}

#[test]
fn every_file_that_a_page_names_is_there_however_much_is_kept() {
    let report = empty_report();
    for extent in [Extent::Everything, Extent::Summary] {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("report");
        let begun = ReportFolder::begin(&folder).unwrap();
        begun.write(&report, extent).unwrap();
        let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
        let links: Vec<&str> = page.split("href=\"").skip(1).collect();
        let files = links.iter().filter_map(|rest| rest.split('"').next());
        let files: Vec<&str> = files.filter(|link| !link.starts_with('#')).collect();
        assert!(files.len() > 10, "{files:?}");
        for file in files {
            assert!(folder.join(file).exists(), "{extent:?}: {file}");
        }
        let detailed = folder.join("report.json").exists();
        assert_eq!(detailed, extent == Extent::Everything);
    }
}
