//! Relighting real photographed objects: the closed form against the matte row without shadow.
//!
//! The captures are other people's and stay outside the repository: the tests look for the folder
//! named by `CAPTURED_DATA`, else `../shared/data` beside the workspace, and skip without it.

use captured::eval::report::{CaptureReport, RelitReport};
use captured::eval::{EvalOptions, Extent, Ledger, Report, ReportFolder, Roster, evaluate};
use captured::folder;
use captured::relight::RelightOptions;
use std::path::PathBuf;

/// One object's report; `None`, with the reason printed, where its folder is absent.
fn evaluated(name: &str) -> Option<Report> {
    let data = std::env::var_os("CAPTURED_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let folder = data.join(name);
    if !folder.is_dir() {
        eprintln!(
            "skipped: {} is not there; set CAPTURED_DATA",
            folder.display()
        );
        return None;
    }
    let capture = folder::read(&folder).expect("a real capture folder is readable");
    let roster = Roster::standing(RelightOptions::default());
    let options = EvalOptions {
        development_runs: 1,
        ..EvalOptions::default()
    };
    let report = evaluate(&[capture], &roster, &options, &Ledger::none(), |_| {})
        .expect("a real capture can be evaluated");
    eprintln!("{report}");
    if let Some(folder) = std::env::var_os("CAPTURED_CHARTS") {
        let folder = PathBuf::from(folder);
        std::fs::create_dir_all(&folder).expect("the charts' folder can be made");
        ReportFolder::begin(&folder.join(name))
            .expect("the report has a place")
            .write(&report, Extent::Everything)
            .expect("the report can be written");
    }
    Some(report)
}

fn row(capture: &CaptureReport, number: u8) -> &RelitReport {
    capture
        .rows
        .iter()
        .find(|row| row.row == number)
        .and_then(|row| row.relit.as_ref())
        .expect("rows 1 to 3 are always run")
}

fn closed_form_beats_matte(name: &str) {
    let Some(report) = evaluated(name) else {
        return;
    };
    let capture = &report.captures[0];
    let (matte, closed) = (row(capture, 2), row(capture, 3));
    assert!(
        closed.mean.linear_psnr_db > matte.mean.linear_psnr_db,
        "{name}: closed form {} dB, matte {} dB",
        closed.mean.linear_psnr_db,
        matte.mean.linear_psnr_db
    );
}

#[test]
fn the_closed_form_beats_matte_without_shadow_on_the_bear() {
    closed_form_beats_matte("diligent_bear");
}

#[test]
fn the_closed_form_beats_matte_without_shadow_on_the_pig() {
    closed_form_beats_matte("harvard_pig");
}

#[test]
fn the_closed_form_beats_matte_without_shadow_on_the_owl() {
    closed_form_beats_matte("uw_owl");
}

#[test]
fn the_cast_shadows_of_the_bear_are_found() {
    let Some(report) = evaluated("diligent_bear") else {
        return;
    };
    let shadow = row(&report.captures[0], 3)
        .shadow
        .expect("shadows are derived for the bear");
    assert!(
        shadow.shadow_pixels > 5000,
        "only {} shadow pixels derived",
        shadow.shadow_pixels
    );
    let iou = shadow.iou.expect("there is shadow");
    assert!(iou >= 0.8, "IoU {iou:.3}");
}
