//! The rules of the house that a compiler does not hold: who may use whom, and what must be absent.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// One source file, without comments, strings and its test module.
struct Source {
    path: PathBuf,
    /// First path component under `src/`: the room.
    room: String,
    code: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every `.rs` file under `folder` of the repository.
fn sources(folder: &str) -> Vec<Source> {
    let base = root().join(folder);
    let mut waiting = vec![base.clone()];
    let mut found = Vec::new();
    while let Some(folder) = waiting.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                waiting.push(path);
            } else if path.extension().is_some_and(|kind| kind == "rs") {
                let inside = path.strip_prefix(&base).unwrap();
                let first = Path::new(inside.components().next().unwrap().as_os_str());
                let room = first.file_stem().unwrap().to_str().unwrap().to_owned();
                let code = code_of(&std::fs::read_to_string(&path).unwrap());
                found.push(Source { path, room, code });
            }
        }
    }
    assert!(!found.is_empty(), "no source under {folder}");
    found
}

/// The text without comments and without the contents of strings, up to its test module.
fn code_of(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap();
    let mut code = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(next) = rest.chars().next() {
        if rest.starts_with("//") {
            rest = &rest[rest.find('\n').unwrap_or(rest.len())..];
        } else if rest.starts_with("/*") {
            rest = &rest[rest.find("*/").map_or(rest.len(), |end| end + 2)..];
        } else if rest.starts_with("'\"'") {
            rest = &rest[3..];
        } else if next == '"' {
            let mut escaped = false;
            let end = rest[1..].find(|c| {
                let closes = c == '"' && !escaped;
                escaped = c == '\\' && !escaped;
                closes
            });
            rest = &rest[end.map_or(rest.len(), |end| end + 2)..];
            code.push_str("\"\"");
        } else {
            code.push(next);
            rest = &rest[next.len_utf8()..];
        }
    }
    code
}

/// Every path in `code` that begins with `start::`, with the braces of `use` trees spread out.
fn paths_from(code: &str, start: &str) -> BTreeSet<String> {
    let opening = format!("{start}::");
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices(&opening) {
        let word_begins =
            !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
        if word_begins {
            let tree: String = code[at + opening.len()..]
                .chars()
                .filter(|c| !c.is_whitespace())
                .take(2000)
                .collect();
            spread(&tree, String::new(), &mut found);
        }
    }
    found
}

/// Walks one use tree (or plain path) and returns how many bytes of `tree` it took.
fn spread(tree: &str, before: String, found: &mut BTreeSet<String>) -> usize {
    let mut taken = 0;
    if tree.starts_with('{') {
        taken += 1;
        while !tree[taken..].is_empty() && !tree[taken..].starts_with('}') {
            taken += spread(&tree[taken..], before.clone(), found).max(1);
            if tree[taken..].starts_with(',') {
                taken += 1;
            }
        }
        return taken + 1;
    }
    let length = tree
        .find(|c: char| !(c.is_alphanumeric() || c == '_'))
        .unwrap_or(tree.len());
    let path = if before.is_empty() {
        tree[..length].to_owned()
    } else {
        format!("{before}::{}", &tree[..length])
    };
    found.insert(path.clone());
    taken += length;
    if tree[taken..].starts_with("::") {
        taken += 2;
        taken += spread(&tree[taken..], path, found);
    }
    taken
}

/// The modules that a `lib.rs` names, in its order, and how many stand above the mark.
fn rooms(lib: &str) -> (Vec<String>, usize) {
    let text = std::fs::read_to_string(root().join(lib)).unwrap();
    let mut rooms = Vec::new();
    let mut pure = 0;
    for line in text.lines() {
        if line.contains("above: pure") {
            pure = rooms.len();
        }
        if let Some(room) = line
            .strip_prefix("pub mod ")
            .and_then(|rest| rest.strip_suffix(';'))
        {
            rooms.push(room.to_owned());
        }
    }
    (rooms, pure)
}

#[test]
fn a_module_uses_only_those_above_it() {
    let (rooms, pure) = rooms("src/lib.rs");
    assert!(
        pure > 0 && pure < rooms.len(),
        "the mark between pure and IO is missing"
    );
    for source in sources("src")
        .iter()
        .filter(|source| rooms.contains(&source.room))
    {
        let place = rooms.iter().position(|room| *room == source.room);
        for path in paths_from(&source.code, "crate") {
            let used = rooms
                .iter()
                .position(|room| *room == path.split("::").next().unwrap());
            assert!(
                used <= place,
                "{} uses crate::{path}, which stands below it",
                source.path.display()
            );
        }
    }
}

#[test]
fn everything_down_to_develop_is_pure() {
    const IMPURE: [&str; 14] = [
        "fs",
        "env",
        "thread",
        "net",
        "io",
        "process",
        "os",
        "time::Instant",
        "time::SystemTime",
        "sync::mpsc",
        "sync::Mutex",
        "sync::RwLock",
        "sync::Condvar",
        "sync::atomic",
    ];
    let (rooms, pure) = rooms("src/lib.rs");
    for source in sources("src")
        .iter()
        .filter(|source| rooms[..pure].contains(&source.room))
    {
        for path in paths_from(&source.code, "std") {
            let banned = IMPURE
                .iter()
                .any(|impure| path == *impure || path.starts_with(&format!("{impure}::")));
            assert!(!banned, "{} uses std::{path}", source.path.display());
        }
        for crate_name in [
            "tokio",
            "rustix",
            "image",
            "exr",
            "indicatif",
            "tracing",
            "ort",
            "ort_tract",
        ] {
            let used = paths_from(&source.code, crate_name);
            assert!(
                used.is_empty(),
                "{} uses {crate_name}::{used:?}",
                source.path.display()
            );
        }
    }
}

#[test]
fn unsafe_lives_only_in_drivers() {
    for source in sources("src")
        .iter()
        .chain(&sources("tests"))
        .chain(&sources("benches"))
    {
        assert!(!holds(&source.code, "unsafe"), "{}", source.path.display());
    }
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    assert!(lib.contains("#![forbid(unsafe_code)]"));
}

/// Whether `code` holds `word` as a word of its own.
fn holds(code: &str, word: &str) -> bool {
    code.split(|c: char| !(c.is_alphanumeric() || c == '_'))
        .any(|found| found == word)
}

#[test]
fn image_decoders_stand_behind_the_gate() {
    // What a camera sends as JPEG inside a frame is no file; its header is looked at first.
    const FRAMES: [&str; 1] = ["src/radiometry/jpeg.rs"];
    const DECODERS: [&str; 6] = [
        "zune_jpeg",
        "Decoder",
        "ImageDecoder",
        "ImageReader",
        "load_from_memory",
        "ChunksReader",
    ];
    let gate = root().join("src/folder/decode");
    let mut gated = 0;
    for source in &sources("src") {
        // A module of tests in a file of its own.
        if source.path.to_string_lossy().ends_with("tests.rs") {
            continue;
        }
        let frame = FRAMES.iter().any(|path| source.path == root().join(path));
        for decoder in DECODERS {
            let found = holds(&source.code, decoder);
            if source.path.starts_with(&gate) {
                gated += usize::from(found);
            } else if !frame {
                assert!(!found, "{} uses {decoder}", source.path.display());
            }
        }
    }
    assert!(gated >= 3, "the gate's own decoders were not recognised");
}

#[test]
fn the_daemon_holds_the_only_lock() {
    for source in sources("src").iter().chain(&sources("drivers/src")) {
        for lock in ["Mutex", "RwLock", "Condvar"] {
            let allowed = lock == "Mutex" && source.path == root().join("src/daemon/networks.rs");
            let found = holds(&source.code, lock);
            assert!(allowed || !found, "{} has a {lock}", source.path.display());
        }
    }
}

#[test]
fn drivers_never_use_each_other() {
    const VOCABULARY: [&str; 14] = [
        "plane",
        "frame",
        "calibration",
        "device",
        "lamp",
        "admission",
        "rig_file",
        "contract",
        "recording",
        "chance",
        // Lamps are parts of devices, not devices.
        "flash",
        "clock",
        "trigger",
        "witness",
    ];
    // `open` knows every driver by name, and `wire` their readers of bytes.
    const ABOVE_ALL: [&str; 2] = ["open", "wire"];
    let (modules, _) = rooms("drivers/src/lib.rs");
    let drivers: Vec<_> = modules
        .iter()
        .filter(|name| !VOCABULARY.contains(&name.as_str()) && !ABOVE_ALL.contains(&name.as_str()))
        .collect();
    assert!(
        drivers.len() >= 2,
        "the drivers were not found: {modules:?}"
    );
    for source in sources("drivers/src") {
        if source.room == "lib" || ABOVE_ALL.contains(&source.room.as_str()) {
            continue;
        }
        for path in paths_from(&source.code, "crate") {
            let first = path.split("::").next().unwrap();
            let foreign = first != source.room && drivers.iter().any(|driver| *driver == first);
            assert!(!foreign, "{} uses crate::{path}", source.path.display());
        }
    }
}

#[test]
fn the_test_reads_paths_as_the_compiler_does() {
    let code = code_of(
        "use crate::{a::{b, c::d}, e}; // crate::f\nfn g() { crate::h::i(); mycrate::j(); let s = \"crate::k\"; }\n\
         #[cfg(test)]\nmod tests { use crate::l; }",
    );
    let paths = paths_from(&code, "crate");
    for path in ["a::b", "a::c::d", "e", "h::i"] {
        assert!(paths.contains(path), "{path} is missing from {paths:?}");
    }
    for path in ["f", "j", "k", "l"] {
        assert!(!paths.contains(path), "{path} is wrongly in {paths:?}");
    }
}
