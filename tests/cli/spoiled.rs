//! Captures made worse on purpose: whatever is wrong with a shot, `--tier auto` answers no worse than
//! the photograph itself would.

use crate::{capturectl, recording};

#[test]
fn auto_is_never_worse_than_doing_nothing_however_the_shot_is_spoiled() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let report = capturectl(
        folder.path(),
        &[
            "eval",
            desk.to_str().unwrap(),
            "--no-networks",
            "--corrupt",
            "all",
            "--severities",
            "3,5",
            "--json",
        ],
    );
    let report = report.succeeds().json();
    let stability = &report["stability"];
    let rows = stability["growth"].as_array().unwrap();
    let auto = rows.iter().find(|row| row["name"] == "ours, auto").unwrap();
    let ways = stability["ways"].as_array().unwrap();
    assert_eq!(ways.len(), 18);
    let worse: Vec<&serde_json::Value> = ways
        .iter()
        .filter(|way| {
            let rows = way["rows"].as_array().unwrap();
            let row = rows
                .iter()
                .find(|row| row["label"] == auto["label"])
                .unwrap();
            !row["worse_than_nothing_from"].is_null()
        })
        .map(|way| &way["name"])
        .collect();
    assert!(worse.is_empty(), "{worse:?}");
    // Of the project's own target for severity 3, 1.35.
    let growth = auto["mean_growth"].as_f64().unwrap();
    assert!(growth < 1.35, "{growth}");
}
