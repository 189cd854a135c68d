//! What is done to a store in every test, and what must hold afterwards whatever went wrong.

use captured::{
    output::{Existing, FRAMES, FileSystem, Manifest, Staging, manifest::MANIFEST},
    store::{Condition, Recovered, Store, StoreError, check},
};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Bytes of the small files that stand for a shot's.
pub const FILES: [(&str, usize); 3] = [(FRAMES, 700), ("relit_000.png", 300), ("albedo.exr", 500)];

/// What was acknowledged.
#[derive(Debug, Default, Clone)]
pub struct Acknowledged {
    pub committed: BTreeSet<String>,
    /// Asked to be deleted; `true` once that was acknowledged.
    pub deleted: Vec<(String, bool)>,
}

impl Acknowledged {
    /// Reads what [`run`] told.
    pub fn hear(&mut self, said: &str) {
        let (what, id) = said.split_once(' ').unwrap();
        match what {
            "committed" => {
                self.committed.insert(id.to_owned());
            }
            "deleting" => self.deleted.push((id.to_owned(), false)),
            _ => self.deleted.last_mut().unwrap().1 = true,
        }
    }
}

/// Writes one shot as the daemon does.
pub fn commit(disk: &dyn FileSystem, folder: &Path, id: &str) -> Result<(), String> {
    let said = |error: captured::output::CommitError| error.to_string();
    let mut staging = Staging::begin(disk, &folder.join(id), Existing::Refuse, |_| false)
        .and_then(Staging::journaled)
        .map_err(said)?;
    for (number, (name, bytes)) in FILES.iter().enumerate() {
        let contents: Vec<u8> = (0..*bytes)
            .map(|byte| (byte * (number + 3)) as u8 ^ id.as_bytes()[id.len() - 1])
            .collect();
        staging.put(name, &contents).map_err(said)?;
    }
    let manifest = Manifest {
        format: 1,
        program: "test".into(),
        source: "test".into(),
        width: 1,
        height: 1,
        scale_known: true,
        png_white: 1.0,
        timings_ms: Vec::new(),
        report: serde_json::Value::Null,
        lights: Vec::new(),
        warnings: Vec::new(),
        files: staging.files().to_vec(),
        blake3: String::new(),
    };
    let (_, bytes) = manifest.seal().unwrap();
    staging.put(MANIFEST, &bytes).map_err(said)?;
    staging.commit().map_err(said)
}

/// Opens the store, commits two shots, deletes the older one and commits a third; `tell` hears
/// what is acknowledged at the moment it is. Goes on after an error, as the daemon does.
pub fn run(disk: &Arc<dyn FileSystem>, folder: &Path, tell: &mut dyn FnMut(&str)) -> Vec<String> {
    let mut errors = Vec::new();
    let store = match Store::on(Arc::clone(disk), folder.to_owned()) {
        Ok((store, _)) => store,
        Err(error) => return vec![error.to_string()],
    };
    let mut shoot = |errors: &mut Vec<String>| {
        let (id, _) = store.next(std::time::SystemTime::now());
        match commit(&**disk, folder, &id) {
            Ok(()) => tell(&format!("committed {id}")),
            Err(error) => errors.push(error),
        }
        id
    };
    let first = shoot(&mut errors);
    shoot(&mut errors);
    shoot(&mut errors);
    tell(&format!("deleting {first}"));
    match store.delete(&first) {
        Ok(()) => tell(&format!("deleted {first}")),
        // It was never there.
        Err(StoreError::NoShot { .. }) => {}
        Err(error) => errors.push(error.to_string()),
    }
    errors
}

/// What is wrong with the store now, once it has been opened again on a healthy disk.
pub fn violations(
    disk: &Arc<dyn FileSystem>,
    folder: &Path,
    told: &Acknowledged,
) -> Result<Vec<Recovered>, String> {
    let (store, recovered) =
        Store::on(Arc::clone(disk), folder.to_owned()).map_err(|error| error.to_string())?;
    let ids: BTreeSet<String> = store.ids().unwrap().into_iter().collect();
    for found in check(&**disk, folder).unwrap() {
        let fine = match found.condition {
            Condition::Whole => true,
            Condition::Salvaged => !told.committed.contains(&found.name),
            Condition::Unfinished => true,
            Condition::Damaged | Condition::Deleted | Condition::Foreign => false,
        };
        if !fine {
            return Err(format!("{found:?}"));
        }
    }
    for id in &told.committed {
        match told.deleted.iter().find(|(deleted, _)| deleted == id) {
            None if !ids.contains(id) => return Err(format!("{id} was acknowledged and is lost")),
            Some((_, true)) if ids.contains(id) => return Err(format!("{id} is back")),
            _ => {}
        }
    }
    Ok(recovered)
}

/// Where the shots lie on a disk in memory.
pub fn shots() -> PathBuf {
    PathBuf::from("/shots")
}
