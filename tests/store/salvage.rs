//! What is found after a crash is kept and said, and nothing is deleted unasked.

use crate::scenario::{self, FILES};
use captured::{
    config::Shots,
    output::{Disk, Existing, Manifest, Staging},
    store::{Condition, Recovered, Store, StoreError, check},
};
use std::path::Path;

fn cut_short(state: &Path, id: &str, files: usize) {
    let folder = state.join("shots").join(id);
    let mut staging = Staging::begin(&Disk, &folder, Existing::Refuse, |_| false)
        .and_then(Staging::journaled)
        .unwrap();
    for (name, bytes) in &FILES[..files] {
        staging.put(name, &vec![7; *bytes]).unwrap();
    }
    // As a process that is killed leaves it.
    std::mem::forget(staging);
}

#[test]
fn the_whole_files_of_a_shot_that_was_cut_short_are_kept_and_marked() {
    let state = tempfile::tempdir().unwrap();
    drop(Store::open(state.path()).unwrap());
    cut_short(state.path(), "shot-5", 2);
    cut_short(state.path(), "shot-6", 0);
    let shots = state.path().join("shots");
    // The last file in work is torn, and so is the manifest.
    let partial = |id: &str| {
        let names = std::fs::read_dir(&shots).unwrap();
        names
            .map(|entry| entry.unwrap().path())
            .find(|path| path.to_string_lossy().contains(&format!(".partial-{id}-")))
            .unwrap()
    };
    std::fs::write(partial("shot-5").join("albedo.exr"), "to").unwrap();
    std::fs::write(partial("shot-5").join("shot.json"), "{\"form").unwrap();

    let (store, recovered) = Store::open(state.path()).unwrap();
    assert!(recovered.contains(&Recovered::Salvaged {
        id: "shot-5".into(),
        whole: 2
    }));
    assert!(
        matches!(&recovered[1], Recovered::Unfinished { .. }),
        "{recovered:?}"
    );
    assert_eq!(store.ids().unwrap(), ["shot-5"]);
    let manifest = Manifest::verify(&shots.join("shot-5")).unwrap();
    assert_eq!(manifest.files.len(), 2);
    assert!(
        manifest.warnings[0].contains("relit_000.png"),
        "{manifest:?}"
    );
    for kept in ["albedo.exr", "shot.json.torn-1"] {
        assert!(
            shots.join("shot-5").join(kept).exists(),
            "{kept} was deleted"
        );
    }
    let found = check(&Disk, &shots).unwrap();
    let of = |name: &str| {
        let found = found.iter().find(|found| found.name.contains(name));
        found.unwrap().condition
    };
    assert_eq!(of("shot-5"), Condition::Salvaged);
    assert_eq!(of("shot-6"), Condition::Unfinished);
}

#[test]
fn a_changed_byte_is_found_and_named() {
    let state = tempfile::tempdir().unwrap();
    drop(Store::open(state.path()).unwrap());
    let shots = state.path().join("shots");
    scenario::commit(&Disk, &shots, "shot-1").unwrap();
    scenario::commit(&Disk, &shots, "shot-2").unwrap();
    let file = shots.join("shot-2/albedo.exr");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[17] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    let found = check(&Disk, &shots).unwrap();
    assert_eq!(found[1].condition, Condition::Whole);
    assert_eq!(found[0].condition, Condition::Damaged);
    assert!(found[0].problem.as_ref().unwrap().contains("albedo.exr"));
}

#[test]
fn a_shot_that_may_not_fit_is_refused_beforehand_and_none_is_deleted_unasked() {
    let state = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(state.path()).unwrap();
    let unlimited = Shots {
        keep_free_bytes: 0,
        ..Shots::default()
    };
    store.reserve(&unlimited).unwrap();
    for _ in 0..4 {
        let (id, _) = store.next(std::time::SystemTime::now());
        scenario::commit(&Disk, store.folder(), &id).unwrap();
        assert!(store.count(&id, &unlimited).unwrap().is_empty());
    }
    let one = store.used_bytes() / 4;
    let quota = |quota_bytes| Shots {
        quota_bytes: Some(quota_bytes),
        ..unlimited.clone()
    };
    store.reserve(&quota(5 * one)).unwrap();
    assert!(matches!(
        store.reserve(&quota(5 * one - 1)),
        Err(StoreError::Quota { .. })
    ));
    let full = Shots {
        keep_free_bytes: 1 << 50,
        ..unlimited.clone()
    };
    assert!(matches!(
        store.reserve(&full),
        Err(StoreError::Space { .. })
    ));
    let two = Shots {
        keep_newest: Some(2),
        ..unlimited
    };
    let ids = store.ids().unwrap();
    assert_eq!(store.retain(&two).unwrap(), ids[2..]);
    assert_eq!(store.ids().unwrap(), ids[..2]);
    assert_eq!(store.used_bytes(), 2 * one);
}
