//! `--tier` and what runs its networks: every way not to have a network is said in words, and the
//! closed form goes on.

use crate::{capture::Capture, capturectl, names_in, recording};

const LIGHT: [&str; 4] = ["--light", "0.6,0.5,0.62", "--out", "relit"];

#[test]
fn without_its_models_the_papers_tier_says_so_and_the_closed_form_still_answers() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let relight = |more: &[&str]| {
        let words = ["relight", desk.to_str().unwrap()];
        capturectl(folder.path(), &[&words, &LIGHT[..], more].concat())
    };
    let refused = relight(&["--tier", "paper", "--models", "/nonexistent/models"]);
    refused.refuses(3, &["decompose", "--tier closed"]);
    let refused = relight(&["--tier", "compact", "--models", "/nonexistent/models"]);
    refused.refuses(3, &["compact-surfaces", "--tier closed"]);
    assert!(names_in(folder.path()).is_empty());
    relight(&["--tier", "closed"]).succeeds();
    let shot = folder.path().join("relit/shot.json");
    let shot: serde_json::Value = serde_json::from_slice(&std::fs::read(shot).unwrap()).unwrap();
    assert_eq!(shot["report"]["tier"], "closed");
    assert!(shot["report"]["networks"].is_null());
}

#[test]
fn the_compact_networks_answer_without_anything_to_fetch_and_say_what_they_took() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let words = ["relight", desk.to_str().unwrap(), "--tier", "compact"];
    capturectl(folder.path(), &[&words, &LIGHT[..]].concat()).succeeds();
    let shot = std::fs::read(folder.path().join("relit/shot.json")).unwrap();
    let shot: serde_json::Value = serde_json::from_slice(&shot).unwrap();
    assert_eq!(shot["report"]["tier"], "compact");
    let networks = shot["report"]["networks"].as_array().unwrap();
    let asked = networks
        .iter()
        .map(|network| (network["name"].as_str(), network["runs"].as_u64()));
    assert!(
        asked.eq([(Some("surfaces"), Some(1)), (Some("light"), Some(1))]),
        "{networks:?}"
    );
}

#[test]
fn surfaces_are_exported_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let export = |more: &[&str]| {
        let words = ["export", desk.to_str().unwrap()];
        capturectl(folder.path(), &[&words, more].concat())
    };
    export(&["--out", "desk.obj"]).refuses(2, &["--out desk.obj", ".glb, .ply, .exr or .ptm"]);
    let models = ["--models", "/nonexistent/models"];
    let refused = export(&[&["--out", "desk.ply"][..], &models].concat());
    refused.refuses(3, &["compact-surfaces"]);
    assert!(names_in(folder.path()).is_empty());
    export(&[&["--out", "desk.ply", "--closed"][..], &models].concat()).succeeds();
    let file = std::fs::read(folder.path().join("desk.ply")).unwrap();
    assert!(file.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    // What is there is not replaced.
    export(&["--out", "desk.ply", "--closed"]).refuses(5, &["desk.ply"]);
    assert_eq!(std::fs::read(folder.path().join("desk.ply")).unwrap(), file);
}

#[test]
fn tiers_that_make_no_sense_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    struct Case(&'static [&'static str], &'static [&'static str]);
    for Case(arguments, words) in [
        Case(
            &["--tier", "fast"],
            &["--tier", "auto, closed, compact or paper"],
        ),
        Case(
            &["--tier", "paper", "--variant", "odd"],
            &["--variant", "clean or noisy"],
        ),
        Case(&["--variant", "noisy"], &["--variant", "--tier paper"]),
        Case(&["--tier", "paper", "--threads", "0"], &["--threads"]),
        Case(&["--budget", "50"], &["--budget", "50ms"]),
        Case(&["--budget=-3ms"], &["--budget", "above 0"]),
        Case(&["--budget", "fastms"], &["--budget", "no number"]),
        Case(
            &["--budget", "50ms", "--tier", "closed"],
            &["--budget", "another tier"],
        ),
        // Nothing can be answered in a microsecond.
        Case(&["--budget", "0.001ms"], &["budget", "cheapest"]),
    ] {
        let words_before = ["relight", desk.to_str().unwrap()];
        let all = [&words_before, &LIGHT[..], arguments].concat();
        capturectl(folder.path(), &all).refuses(2, words);
    }
    let shot = capturectl(folder.path(), &["shoot", "--tier", "paper"]);
    shot.refuses(2, &["--tier", "--relight"]);
}

#[test]
fn what_a_shot_was_modelled_with_and_why_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let desk = recording("desk.mcap");
    let words = [
        "relight",
        desk.to_str().unwrap(),
        "--models",
        "/nonexistent",
    ];
    let ran = capturectl(folder.path(), &[&words, &LIGHT[..]].concat());
    ran.succeeds();
    // Things stand on the desk: their shadows are swept although no network corrects them.
    assert!(
        ran.err.contains("closed forms are not corrected"),
        "{ran:#?}"
    );
    let shot = std::fs::read(folder.path().join("relit/shot.json")).unwrap();
    let shot: serde_json::Value = serde_json::from_slice(&shot).unwrap();
    let report = &shot["report"];
    assert_eq!(report["tier"], "auto");
    let model = &report["model"];
    assert_eq!(model["plan"]["terms"]["shadow"], "swept", "{model}");
    let changes = &model["glance"]["changes"];
    let (tolerance, unshadowed) = (&model["glance"]["tolerance"], &changes["shadow"][0]);
    assert!(unshadowed.as_f64() > tolerance.as_f64(), "{model}");
    assert!(model["by_one_standard_error"].is_object() && model["by_bic"].is_object());
}

#[test]
fn rows_of_networks_that_are_not_there_say_why() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("capture"));
    let report = |more: &[&str]| {
        let words = ["eval", "--json", "capture"];
        let report = capturectl(folder.path(), &[&words, more].concat());
        report.succeeds().json()
    };
    for (more, reason) in [
        (&["--no-networks"][..], "--no-networks"),
        (&["--models", "/nonexistent/models"], "models"),
    ] {
        let report = report(more);
        let rows = report["rows"].as_array().unwrap();
        let of_networks = rows.iter().filter(|row| row["row"] == 4 || row["row"] == 5);
        let reasons: Vec<String> = of_networks.map(ToString::to_string).collect();
        assert_eq!(reasons.len(), 4, "{rows:?}");
        assert!(
            reasons.iter().all(|said| said.contains(reason)),
            "{reasons:?}"
        );
    }
}

#[test]
fn how_to_get_the_library_is_said_without_getting_it() {
    let folder = tempfile::tempdir().unwrap();
    let said = capturectl(folder.path(), &["runtime", "fetch"]);
    for word in [
        "pip install",
        "npm install",
        "libonnxruntime.so",
        "runtime status",
    ] {
        assert!(said.succeeds().out.contains(word), "{word}: {said:#?}");
    }
    assert!(names_in(folder.path()).is_empty());
}
